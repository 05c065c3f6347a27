"""The scorer: what was said against what is true, as tables. It diagnoses nothing.

    top-1       the first effect that the answer names is a hidden one
    exact       the verdict is `explained`, by the hidden effects and no others
    top-3       a hidden one is among the first three of the ranking
    confounded  share of that verdict; `with`: or the truth is among at most three that it names
    before, after, oracle   error on another voyage: as given, as found, by who knew
    within      share of cases that are within 1.25 × of who knew
    error       of the true effects' parameters, as a share of their distance from doing nothing
    covered     share of the stated 95 % intervals that hold the truth
    width       of those intervals over those of who knew

Where a re-fitted base absorbs an effect (who knows it gains less than 1.2 ×), `adequate` is right.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden.run import read_json
from sim.effects.catalogue import named
from sim.effects.effect import Kind

ABSORBED = 1.2  # gain of who knows, below which nothing needs to be found
NEAR = 1.25  # errors within so many times that of who knows are as good
MOST_NAMED = 3
BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)
SINGLE = ("excitation", "mission", "weak", "faint", "base_off")
# nature's own form: the catalogue's number has no exact counterpart
OTHER_FORM = frozenset({
    "varying_current", "steady_wind", "wave_motion", "crossing_waves", "payload_change",
    "thruster_deadband",
    "thruster_lag", "advance_loss", "astern_stall", "current_change", "wind_change",
})  # fmt: skip
WAVES = frozenset({"wave_motion", "crossing_waves"})  # trains of a sea

Json = Mapping[str, Any]


@dataclass(frozen=True)
class Row:
    """One case: what is true, what was said (None: it failed), what judging took."""

    truth: Json
    result: Json
    oracle: Json = field(default_factory=dict)
    judged: Json = field(default_factory=dict)

    @property
    def said(self) -> Json | None:
        """The diagnosis; None where it failed."""
        return self.result.get("diagnosis")

    @property
    def verdict(self) -> str:
        """One of four, or `failed`."""
        return str(self.said["verdict"]) if self.said else "failed"

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that the answer stands by, the first first."""
        if not self.said or self.verdict not in ("explained", "confounded"):
            return ()
        return tuple(self.said["effects"]) or self.ranked[:1]

    @property
    def ranked(self) -> tuple[str, ...]:
        """The ranking."""
        return tuple(r["effect"] for r in self.said["ranking"]) if self.said else ()

    @property
    def alternatives(self) -> frozenset[str]:
        """All that a confounded answer names."""
        if not self.said or self.verdict != "confounded":
            return frozenset(self.named)
        first = [r for r in self.said["ranking"] if r["effect"] in self.named]
        return frozenset(self.named).union(*(r.get("confounded_with", ()) for r in first))

    @property
    def needed(self) -> frozenset[str]:
        """The hidden effects that a re-fitted base, or the others, do not absorb."""
        worth = self.oracle.get("worth", {})
        if self.absorbed:
            return frozenset()
        return frozenset(e for e in self.truth["effects"] if worth.get(e, math.inf) >= ABSORBED)

    @property
    def absorbed(self) -> bool:
        """There is nothing left to be found once the base is re-fitted."""
        if self.truth["unknown"]:
            floor = self.oracle.get("complete", 0.0)
            return bool(floor and self.oracle["refit"] < ABSORBED * floor)
        return bool(self.truth["effects"]) and self.oracle.get("gain", math.inf) < ABSORBED


def top_1(row: Row) -> bool:
    """The first effect named is a hidden one; nothing named is right where the base absorbs it."""
    if row.absorbed and row.verdict == "adequate":
        return True
    return bool(row.named) and row.named[0] in row.truth["effects"]


def exact(row: Row) -> bool:
    """Explained, by what is hidden and nothing else."""
    if row.absorbed and row.verdict == "adequate":
        return True
    return row.verdict == "explained" and set(row.named) == set(row.truth["effects"])


def top_3(row: Row) -> bool:
    """A hidden one among the first three of the ranking."""
    return top_1(row) or bool(set(row.ranked[:3]) & set(row.truth["effects"]))


def confounded(row: Row) -> bool:
    """It said that it cannot tell."""
    return row.verdict == "confounded"


def with_confounded(row: Row) -> bool:
    """Right, or undecided among at most three with the truth among them."""
    if top_1(row):
        return True
    among = row.alternatives & set(row.truth["effects"])
    return confounded(row) and bool(among) and len(row.alternatives) <= MOST_NAMED


def both(row: Row) -> bool:
    """All that is hidden, as far as the others do not absorb it, is named, and nothing else."""
    return all_named(row) and not invented(row)


def some(row: Row) -> bool:
    """At least one of what is hidden is named."""
    return bool(set(row.named) & set(row.truth["effects"])) or not row.needed


def alarm(row: Row) -> bool:
    """Something is said to be missing, or nothing is said at all."""
    return row.verdict != "adequate"


def recognised(row: Row) -> bool:
    """Something is missing that the catalogue does not hold, and it says so."""
    return row.verdict == "unknown" or (row.absorbed and row.verdict == "adequate")


def beside_the_sea(row: Row) -> bool:
    """What is hidden beside a sea is named, and nothing else but waves."""
    return set(row.named) - WAVES == set(row.truth["effects"]) - {"sea"}


def all_named(row: Row) -> bool:
    """All that is hidden, as far as the others do not absorb it, is named, beside others or not."""
    return row.needed <= set(row.named)


def invented(row: Row) -> bool:
    """Something is named that is not hidden."""
    return not set(row.named) <= set(row.truth["effects"])


def invented_at_sea(row: Row) -> bool:
    """Something else than what is hidden, and than waves, is named."""
    return bool(set(row.named) - WAVES - set(row.truth["effects"]))


def within(row: Row) -> bool:
    """As good on the other voyage as who knew."""
    return bool(row.judged["after"] <= NEAR * row.judged["oracle"])


def rows_of(out: Path, names: Iterable[str], by: str = "diagnosed") -> list[Row]:
    """All cases that `by` has a result of, from a run's folder."""

    def maybe(part: str, name: str) -> Json:
        file = out / part / f"{name}.json"
        return read_json(file) if file.exists() else {}

    parts = ("answers", f"results/{by}", "oracle", f"judged/{by}")
    return [
        Row(*(maybe(part, name) for part in parts))
        for name in names
        if (out / "results" / by / f"{name}.json").exists()
    ]


def share(rows: Sequence[Row], what: Callable[[Row], bool]) -> float:
    """Share of the rows of which it is true; NaN without any."""
    return float(np.mean([what(row) for row in rows])) if rows else math.nan


def family_line(name: str, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures of one family of single effects."""
    return {
        "family": name, "cases": len(rows), "top-1": share(rows, top_1),
        "exact": share(rows, exact), "top-3": share(rows, top_3),
        "confounded": share(rows, confounded), "with": share(rows, with_confounded),
        "absorbed": share(rows, lambda row: row.absorbed),
        "failed": sum(row.verdict == "failed" for row in rows), **errors(rows),
        **intervals(rows),
    }  # fmt: skip


def errors(rows: Sequence[Row]) -> dict[str, float]:
    """Medians on the other voyage, and the share that is as good as who knew."""
    ok = [row for row in rows if "after" in row.judged]
    middle = {
        key: float(np.median([row.judged[key] for row in ok])) if ok else math.nan
        for key in ("before", "after", "oracle")
    }
    return {**middle, "within": share(ok, within)}


@dataclass(frozen=True)
class Told:
    """One parameter of a true effect that was found: what was said against what is true."""

    effect: str
    name: str
    error: float  # of the truth's distance from doing nothing
    covered: bool
    width: float  # times the interval of who knew; NaN where that has none


def told(row: Row) -> list[Told]:
    """All parameters of the true effects that the answer stands by."""
    out = []
    step = final_step(row)
    for effect in set(row.named) & set(row.truth["effects"]):
        all_said = step.get("parameters", {}).get(effect, {})
        all_true = _as_said(row.oracle.get("truth", {}).get(effect, {}), all_said)
        for p in named(effect).parameters:
            said, true = all_said.get(p.name), all_true.get(p.name)
            if said is None or true is None or p.kind is Kind.CHOICE:
                continue
            turn = 2.0 * math.pi if p.kind is Kind.CIRCLE else math.inf
            off = math.remainder(said["value"] - true, turn)
            low, high = (end - said["value"] for end in said.get("ci95") or (math.nan,) * 2)
            size = 1.0 if turn < math.inf else max(abs(true - (p.neutral or 0.0)), p.scale)
            known = row.oracle.get("parameters", {}).get(f"{effect}.{p.name}")
            own = known["ci95"][1] - known["ci95"][0] if known else math.nan
            wide = (high - low) / own if own > 0.0 else math.nan
            out.append(Told(effect, p.name, abs(off) / size, bool(low <= -off <= high), wide))
    return out


def _as_said(true: Mapping[str, float], said: Json) -> Mapping[str, float]:
    """The truth in the words of an answer: a current that turns about, half a period later."""
    if "direction" not in said or not {"direction", "phase"} <= set(true):
        return true
    if math.cos(said["direction"]["value"] - true["direction"]) > 0.0 or "omega" in true:
        return true  # a wave that runs the other way is another wave
    return {**true, **{key: true[key] + math.pi for key in ("direction", "phase")}}


def final_step(row: Row) -> Json:
    """The step of the ladder with the effects that the answer stands by."""
    steps = (
        [s for s in row.said["ladder"] if set(s["effects"]) == set(row.named)] if row.said else []
    )
    return steps[-1] if steps else {}


def intervals(rows: Sequence[Row], other: bool = False) -> dict[str, float]:
    """Parameter error, coverage and width where the catalogue's form is nature's (or `other`)."""
    all_told = [t for row in rows for t in told(row) if (t.effect in OTHER_FORM) == other]
    widths = [t.width for t in all_told if math.isfinite(t.width)]
    return {
        "error": float(np.median([t.error for t in all_told])) if all_told else math.nan,
        "covered": float(np.mean([t.covered for t in all_told])) if all_told else math.nan,
        "width": float(np.median(widths)) if widths else math.nan,
    }


def reliability(rows: Sequence[Row]) -> list[dict[str, float]]:
    """Stated probabilities of single effects against how often they are true, in bins."""
    pairs = [
        (float(r["probability"]), r["effect"] in row.truth["effects"])
        for row in rows
        if row.said and not row.truth["unknown"] and len(row.truth["effects"]) < 2
        for r in row.said["ranking"]
    ]
    out = []
    for low, high in pairwise(BINS):
        inside = [(p, t) for p, t in pairs if low <= p < high or (p == high == BINS[-1])]
        if inside:
            p, t = np.array(inside, dtype=float).T
            out.append({"from": low, "to": high, "cases": len(inside),
                        "stated": float(p.mean()), "true": float(t.mean())})  # fmt: skip
    return out


def confusion(rows: Sequence[Row]) -> Counter[tuple[str, str]]:
    """(what is hidden, what was named first or else the verdict) -> how often."""
    return Counter(
        (row.truth["effects"][0] if row.truth["effects"] else "nothing",
         row.named[0] if row.named else row.verdict)
        for row in rows
        if len(row.truth["effects"]) < 2
    )  # fmt: skip
