"""The scorer's figures as text, Markdown that is also readable in a terminal, and one picture."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.hidden import score
from benchmarks.hidden.score import SINGLE, Row

COLUMNS = (
    "cases", "top-1", "exact", "top-3", "confounded", "with", "absorbed", "failed",
    "before", "after", "oracle", "within", "error", "covered", "width",
)  # fmt: skip
STRANGERS = {
    "unlisted": "ten more kinds", "unheard": "ten again", "unnamed": "a third ten",
    "untold": "a fourth ten", "unasked": "a fifth ten",
}  # fmt: skip
COUNTS, PLAIN = ("cases", "failed"), ("before", "after", "oracle", "width")
GOALS: Mapping[str, tuple[str, float, bool]] = {  # what, figure, whether more is better
    "excitation top-1": ("strict top-1 on excitations", 0.90, True),
    "mission top-1": ("strict top-1 on missions", 0.85, True),
    "excitation with": ("with `confounded`, excitations", 0.96, True),
    "mission with": ("with `confounded`, missions", 0.92, True),
    "confounded": ("`confounded` share, excitations and missions", 0.15, False),
    "base_off top-1": ("top-1, base off by 10 %", 0.85, True),
    "weak top-1": ("top-1 at 40 % of the strength", 0.80, True),
    "alarms": ("false alarms on complete models", 0.04, False),
    "both": ("both of a pair", 0.85, True),
    "unknown": ("unknown recognised", 0.80, True),
    "within": ("other voyage within 1.25 × of the oracle's", 0.90, True),
    "covered": ("95 % intervals hold the truth", 0.85, True),
    "width": ("their width over the oracle's, median", 3.0, False),
}


def report(rows: Sequence[Row], heading: str) -> str:
    """Everything, as Markdown."""
    by = {
        f: [r for r in rows if r.truth["family"] == f]
        for f in (*SINGLE, "pair", "none", "unknown", *STRANGERS, "day", "sea")
    }
    parts = [
        f"# {heading}",
        goals(figures(by)),
        "## Single effects\n" + families(by),
        "## Pairs, complete models, strangers\n" + others(by),
        "## Which effects are missed\n" + missed(rows),
        "## Nature's own forms\n" + own_forms(rows),
        "## Stated probability against truth\n" + calibration(rows),
        "## Hidden, and named first\n" + confusions(rows),
        "## Time\n" + seconds(rows),
        (score.__doc__ or "").strip(),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def figures(by: Mapping[str, Sequence[Row]]) -> dict[str, float]:
    """What the goals are about."""
    lines = {f: score.family_line(f, by[f]) for f in SINGLE}
    single = [row for f in SINGLE for row in by[f]]
    both = [*by["excitation"], *by["mission"]]
    return {
        **{f"{f} {key}": lines[f][key] for f in SINGLE for key in ("top-1", "with")},
        "confounded": score.share(both, score.confounded),
        "alarms": score.share(by["none"], score.alarm),
        "both": score.share(by["pair"], score.both),
        "unknown": score.share(by["unknown"], score.recognised),
        "within": score.errors([*single, *by["pair"]])["within"],
        **{key: score.intervals(single)[key] for key in ("covered", "width")},
    }


def goals(found: Mapping[str, float]) -> str:
    """Goal by goal: asked for, reached."""
    lines = []
    for key, (says, goal, more) in GOALS.items():
        value = found[key]
        good = value >= goal if more else value <= goal
        mark = "–" if math.isnan(value) else "yes" if good else "**no**"
        asked = f"{'≥' if more else '≤'} {_said(key, goal)}"
        lines.append([says, asked, _said(key, value), mark])
    return grid(["goal", "asked", "reached", ""], lines)


def families(by: Mapping[str, Sequence[Row]]) -> str:
    """A line for each family of single effects."""
    lines = [score.family_line(f, by[f]) for f in SINGLE if by[f]]
    return grid(
        ["family", *COLUMNS], [[x["family"], *(_said(c, x[c]) for c in COLUMNS)] for x in lines]
    )


def others(by: Mapping[str, Sequence[Row]]) -> str:
    """Pairs, nothing hidden, and what no catalogue holds."""
    none, day, sea = by["none"], by["day"], by["sea"]
    clean, off = ([r for r in none if r.truth["misjudged"] == wrong] for wrong in (False, True))
    lines = [
        ["pairs: both, and nothing else", len(by["pair"]), score.share(by["pair"], score.both)],
        ["pairs: at least one", len(by["pair"]), score.share(by["pair"], score.some)],
        ["pairs: within 1.25 × of the oracle", len(by["pair"]), score.errors(by["pair"])["within"]],
        ["complete models: false alarms", len(none), score.share(none, score.alarm)],
        ["… files exact", len(clean), score.share(clean, score.alarm)],
        ["… files off by 10 %", len(off), score.share(off, score.alarm)],
        ["strangers: `unknown`", len(by["unknown"]), score.share(by["unknown"], score.recognised)],
        *(
            [f"… {name}", len(by[family]), score.share(by[family], score.recognised)]
            for family, name in STRANGERS.items()
        ),
        ["days: all causes named", len(day), score.share(day, score.all_named)],
        ["days: something invented", len(day), score.share(day, score.invented)],
        ["days: confounded", len(day), score.share(day, score.confounded)],
        ["seas: what is beside, waves or not", len(sea), score.share(sea, score.beside_the_sea)],
        ["seas: something invented", len(sea), score.share(sea, score.invented_at_sea)],
    ]
    return grid(["", "cases", "share"], [[a, str(n), _percent(x)] for a, n, x in lines])


def side_by_side(who: Mapping[str, Sequence[Row]]) -> str:
    """Top-1 by family for all that were tested on the same cases, and where others win."""
    known = [{r.truth["name"]: r for r in rows} for rows in who.values()]
    common = set.intersection(*(set(k) for k in known))
    each = {name: [k[c] for c in sorted(common)] for name, k in zip(who, known, strict=True)}
    first, lines = next(iter(each)), []
    for what, families, right in SIDES:
        some = [r for r in each[first] if r.truth["family"] in families]
        if some:
            of = [[r for r in rows if r.truth["family"] in families] for rows in each.values()]
            shares = [_percent(score.share(rows, right)) for rows in of]
            lines.append([what, str(len(some)), *shares])
    won = [
        f"- {name} is right on {', '.join(theirs.truth['effects']) or 'nothing hidden'} "
        f"({theirs.truth['family']}, {theirs.truth['name']}), {first} is not"
        for name, rows in each.items()
        for mine, theirs in zip(each[first], rows, strict=True)
        if theirs.truth["family"] in SINGLE and score.top_1(theirs) and not score.top_1(mine)
    ]
    return "\n\n".join([grid(["", "cases", *each], lines), "\n".join(won)])


SIDES: tuple[tuple[str, tuple[str, ...], Callable[[Row], bool]], ...] = (
    *((f"top-1, {family}", (family,), score.top_1) for family in SINGLE),
    ("both of a pair", ("pair",), score.both),
    ("false alarms", ("none",), score.alarm),
)


def missed(rows: Sequence[Row]) -> str:
    """Effects that were not named first, with what was said instead."""
    wrong = [r for r in rows if r.truth["family"] in SINGLE and not score.top_1(r)]
    said: dict[str, list[str]] = {}
    for row in wrong:
        what = row.named[0] if row.named else row.verdict
        said.setdefault(row.truth["effects"][0], []).append(f"{what} ({row.truth['family']})")
    return "\n".join(f"- {e}: {', '.join(w)}" for e, w in sorted(said.items())) or "none"


def own_forms(rows: Sequence[Row]) -> str:
    """Parameters where nature's form is the catalogue's, and where it is not."""
    single = [r for r in rows if r.truth["family"] in SINGLE]
    keys = ("error", "covered", "width")
    return grid(
        ["", *keys],
        [
            [says, *(_said(k, score.intervals(single, other)[k]) for k in keys)]
            for says, other in (("the catalogue's form", False), ("a form of its own", True))
        ],
    )


def calibration(rows: Sequence[Row]) -> str:
    """The reliability table."""
    lines = [
        [f"{b['from']:g}–{b['to']:g}", str(b["cases"]), _percent(b["stated"]), _percent(b["true"])]
        for b in score.reliability(rows)
    ]
    return grid(["probability", "entries", "stated", "true"], lines)


def confusions(rows: Sequence[Row]) -> str:
    """One line per hidden effect: named how often as what."""
    by: dict[str, Counter[str]] = {}
    for (hidden, said), n in score.confusion(rows).items():
        by.setdefault(hidden, Counter())[said] += n
    lines = [
        [hidden, str(c.total()), ", ".join(f"{said} {n}" for said, n in c.most_common())]
        for hidden, c in sorted(by.items())
    ]
    return grid(["hidden", "cases", "named first, or the verdict"], lines)


def seconds(rows: Sequence[Row]) -> str:
    """How long a case took."""
    took = np.array([row.result["seconds"] for row in rows]) if rows else np.array([math.nan])
    middle, high = np.percentile(took, [50, 90])
    return (
        f"median {middle:.0f} s a case, nine of ten below {high:.0f} s, at most {took.max():.0f} s"
    )


def picture(rows: Sequence[Row], file: Path) -> None:
    """The confusion matrix as a picture; none where there is nothing to confuse."""
    found = score.confusion(rows)
    if not found:
        return
    hidden = sorted({h for h, _ in found})
    said = sorted({s for _, s in found}, key=lambda s: (s not in hidden, s))
    table = np.array([[found[h, s] for s in said] for h in hidden], dtype=float)
    size = (2.5 + 0.24 * len(said), 2.2 + 0.22 * len(hidden))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(table / np.maximum(table.sum(axis=1, keepdims=True), 1.0), cmap="cividis", vmin=0.0)
    for (i, j), n in np.ndenumerate(table):
        if n:
            axes.text(j, i, f"{n:.0f}", ha="center", va="center", fontsize=7, color="white")
    axes.set_xticks(range(len(said)), said, rotation=90, fontsize=7)
    axes.set_yticks(range(len(hidden)), hidden, fontsize=7)
    axes.set_xlabel("named first, or the verdict")
    axes.set_ylabel("hidden")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


def grid(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose columns are as wide as they need to be."""
    rows = [list(head), *(list(line) for line in lines)]
    wide = [max(len(row[i]) for row in rows) for i in range(len(head))]

    def said(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, wide, strict=True)) + " |"

    rule = "|" + "|".join("-" * (w + 2) for w in wide) + "|"
    return "\n".join([said(rows[0]), rule, *(said(row) for row in rows[1:])])


def _said(column: str, value: Any) -> str:
    if column in COUNTS:
        return str(value)
    return f"{value:.3g}" if column in PLAIN else _percent(value)


def _percent(value: float) -> str:
    return "–" if math.isnan(value) else f"{100.0 * value:.0f} %"
