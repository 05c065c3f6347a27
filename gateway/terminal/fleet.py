"""A fleet in the terminal: progress with what is left, a line a boat, what failed and why."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import PurePosixPath
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from gateway.errors import counted
from gateway.fleet.analysis import DONE, DUPLICATE, PARTLY
from gateway.fleet.run import FleetResult, Progress
from gateway.fleet.table import ESTIMATES_FILE, RECORDINGS_FILE
from gateway.fleet.wear import FleetWear
from gateway.terminal import ResultConsole, SafeConsole, result_table
from gateway.terminal.work_line import duration

MOST_SHOWN = 10  # reasons why recordings failed
MOST_NAMED = 3  # recordings of one reason


@contextmanager
def fleet_progress() -> Iterator[Callable[[Progress], None]]:
    """A bar on a terminal, else a line for each recording; both say what is left."""
    console = SafeConsole(stderr=True, highlight=False)
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting the workers", total=None)

        def show(now: Progress) -> None:
            bar.update(task, total=now.total, completed=now.done, description=_standing(now))
            if not console.is_terminal and now.worked:
                name = PurePosixPath(now.last["recording"]).name
                text = f"{now.done} of {now.total}: {name}: {now.last['state']}; {_standing(now)}"
                console.print(text, markup=False, soft_wrap=True)

        yield show


def _standing(now: Progress) -> str:
    """What is left, and how many failed."""
    left, failed = now.seconds_left, f", {now.failed} failed" if now.failed else ""
    return failed.lstrip(", ") if left is None else f"about {duration(left)} left{failed}"


def show_fleet(result: FleetResult, wear: FleetWear) -> None:
    """A line a boat, what failed and why, what has changed, and where the table is."""
    console = ResultConsole()
    rows = list(result.rows.values())
    table = result_table(
        f"{counted(len(rows), 'recording')}, {result.known} of them known already", "boat",
        "used", "usable", "error", "noise floor", "from", "to",
    )  # fmt: skip
    for boat, own in by_boat(rows).items():
        table.add_row(boat, *_cells(own))
    console.print(table)
    failed = [row for row in rows if row["state"] not in (DONE, DUPLICATE)]
    problems = _problems(failed)
    more = [f"{len(problems) - MOST_SHOWN} more reasons, see `why` in the table"]
    console.bullets(problems[:MOST_SHOWN] + (more if len(problems) > MOST_SHOWN else []))
    console.bullets(
        f"{boat.name}: no recording fits {', '.join(boat.recordings)} (fleet file)"
        for boat in result.unused
    )
    if result.dropped:
        console.bullets([_dropped(result.dropped)])
    console.bullets(wear.sentences)
    console.path("recordings", result.folder / RECORDINGS_FILE)
    console.path("numbers", result.folder / ESTIMATES_FILE)


def _dropped(recordings: Sequence[str]) -> str:
    """What the table had before: it comes back when it is named again, without work."""
    first = ", ".join(PurePosixPath(name).name for name in recordings[:MOST_NAMED])
    more = ", …" if len(recordings) > MOST_NAMED else ""
    return (
        f"{counted(len(recordings), 'recording')} of the table before not named now, so not in it "
        f"any more ({first}{more}): results are kept for when they are named again"
    )


def show_wear(wear: FleetWear) -> None:
    """A line a number, then what has changed."""
    console = ResultConsole()
    table = result_table("the course over all recordings", "number", "recordings", "begins at",
                         "ends at", "scatter", unit=True)  # fmt: skip
    for one in wear.numbers:
        ends = [float(one.course.mean[end]) for end in (0, -1)]
        table.add_row(
            f"{one.boat}: {one.name}", str(len(one.dates)), *(f"{end:.4g}" for end in ends),
            scatter_text(one.course.scatter, max(map(abs, ends))), one.unit,
        )  # fmt: skip
    if wear.numbers:
        console.print(table)
    console.bullets(wear.sentences)


def scatter_text(scatter: float, size: float) -> str:
    """The scatter from recording to recording beyond their intervals; of less than a thousandth of
    the number there is none.
    """
    return "none" if scatter < 1e-3 * size else f"{scatter:.2g}"


def _problems(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Why recordings are not done, each reason once."""
    names: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        name = row["recording"]
        names[f"{row['state']}: {row['why'].removeprefix(f'{name}: ')}"].append(name)
    return [_named(some, why) for why, some in names.items()]


def _named(names: Sequence[str], why: str) -> str:
    """A recording and why it is not done; of several, how many and the first ones' names."""
    if len(names) == 1:
        return f"{names[0]}: {why}"
    first = ", ".join(PurePosixPath(name).name for name in names[:MOST_NAMED])
    return f"{len(names)} recordings {why} ({first}{', …' if len(names) > MOST_NAMED else ''})"


def by_boat(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Rows of each boat, by name; those that no entry names under an own heading."""
    out: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        out[row["boat"] or "no boat"].append(row)
    return dict(sorted(out.items()))


def _cells(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    good = [row for row in rows if row["state"] in (DONE, PARTLY)]
    compared = [row for row in good if row.get("nrmse") is not None]
    dates = sorted(row["started"][:10] for row in good if row["started"])

    def mean(key: str) -> str:
        return f"{sum(row[key] for row in compared) / len(compared):.3f}" if compared else "–"

    return [
        f"{len(good)} of {len(rows)}", f"{sum(row['usable_s'] for row in good) / 60.0:.0f} min",
        mean("nrmse"), mean("noise_floor_nrmse"), *(dates[:1] or ["–"]), *(dates[-1:] or ["–"]),
    ]  # fmt: skip


def fleet_as_dict(result: FleetResult) -> dict[str, Any]:
    """What `shadow fleet --json` prints."""
    return {
        "recordings": len(result.rows), "known": result.known,
        "states": {
            state: sum(row["state"] == state for row in result.rows.values())
            for state in sorted({row["state"] for row in result.rows.values()})
        },
        "unused": [boat.name for boat in result.unused], "dropped": list(result.dropped),
        "table": [str(result.folder / name) for name in (RECORDINGS_FILE, ESTIMATES_FILE)],
        "failed": [
            {"recording": row["recording"], "state": row["state"], "why": row["why"]}
            for row in result.rows.values() if row["state"] not in (DONE, DUPLICATE)
        ],
    }  # fmt: skip
