"""`shadow demo`: the story so far on recordings that ship, offline."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

import gateway
from gateway.bus import BusSettings, open_session
from gateway.errors import BadInput
from gateway.pipelines.compare import compare_logs
from gateway.pipelines.replay import ReplayOptions, replay
from gateway.show.compare import show_comparisons
from gateway.show.progress import progress, status
from gateway.show.replay import show_replay
from gateway.vessel_file import load_vessel

HOME = Path(gateway.__file__).resolve().parent.parent
AUTOPILOT, OTTER = HOME / "recordings/otter_piece.tlog", HOME / "configs/vessels/otter.toml"
COMPLETE, VOYAGE = HOME / "recordings/voyage_3.tlog", HOME / "recordings/voyage_1.tlog"
DEMO_BOAT = HOME / "configs/vessels/demo_boat.toml"


def run_demo(out: Path) -> None:
    """Replay, record, publish, compare; each step says what it does and where the files are."""
    for file in (AUTOPILOT, OTTER, COMPLETE, VOYAGE, DEMO_BOAT):
        if not file.is_file():
            raise BadInput(f"{file}: the demo needs the project's folder: clone it, see README")
    say = Console().print
    say("[bold]1. A digital shadow[/bold] of a boat steered by a real autopilot (in simulation)")
    with _listener() as heard, progress(f"replaying {AUTOPILOT.name}") as tell:
        summary = replay(AUTOPILOT, load_vessel(OTTER), None, ReplayOptions(out), tell)
    show_replay(summary)
    say(f"zenoh: a second session heard {sum(heard.values())} samples on {len(heard)} keys\n")
    say("[bold]2. Is its model right?[/bold] Published numbers of the hull against the recording")
    _compare([AUTOPILOT], OTTER, out)
    say("\n[bold]3. A complete model[/bold] shows nothing but noise")
    _compare([COMPLETE], DEMO_BOAT, out)
    say("\n[bold]4. Something is missing[/bold]: the same model, a voyage with a hidden effect")
    _compare([VOYAGE], DEMO_BOAT, out)
    say(
        "\nthe error is far above the floor, and where it is says what to look for: "
        "`shadow effects` lists the causes that a vessel file may contain"
    )


def _compare(logs: list[Path], vessel: Path, out: Path) -> None:
    with status("comparing") as tell:
        found = compare_logs(logs, [vessel], pictures=out / "pictures", progress=tell)
    show_comparisons(found, out / "pictures")


@contextmanager
def _listener() -> Iterator[Counter[str]]:
    """A zenoh session of its own that counts what it hears, by key."""
    heard: Counter[str] = Counter()

    def count(sample: Any) -> None:
        heard[str(sample.key_expr)] += 1

    with open_session(BusSettings()) as session:
        session.declare_subscriber("shadow/**", count)
        yield heard
