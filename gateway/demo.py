"""`shadow demo`: all steps on recordings that ship, offline.

replay → compare → diagnose → add → compare on a voyage that the diagnosis never saw
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from gateway.bus import BusSettings, open_session
from gateway.files import RECORDINGS, VESSELS, pictures_there
from gateway.offline.add import add_effects
from gateway.offline.compare import compare_logs
from gateway.offline.diagnose import DiagnosisResult, diagnose_logs, save_diagnosis
from gateway.offline.replay import ReplayOptions, replay
from gateway.terminal import SafeConsole, progress_bar, status_line
from gateway.terminal.comparison import show_comparisons
from gateway.terminal.diagnosis import show_addition, show_diagnosis
from gateway.terminal.recordings import show_replay
from gateway.vessel_file import load_vessel
from sim.comparison.compare import Comparison

AUTOPILOT, OTTER = RECORDINGS / "otter_piece.tlog", VESSELS / "otter.toml"
VOYAGE, TWIN = RECORDINGS / "voyage_1.tlog", RECORDINGS / "voyage_2.tlog"
DEMO_BOAT = VESSELS / "demo_boat.toml"


def demo_files(out: Path) -> list[Path]:
    """What the demo writes into its folder, as far as that is known before."""
    named = [f"{AUTOPILOT.stem}-shadow.mcap", "diagnosis.json", "demo_boat-better.toml"]
    figures = {log.stem: [log.stem] for log in (VOYAGE, TWIN)}
    figures["diagnosis"] = ["ladder", "ranking", "timeline", "evidence"]
    drawn = [f for name, begin in figures.items() for f in pictures_there(out / name, begin)]
    return [*(out / name for name in named), *drawn]


def run_demo(out: Path) -> None:
    """Run five steps; each prints what it does and where the files are."""
    console = SafeConsole(highlight=False)
    _shadow(out, console)
    console.print(
        "[bold]2. Is the model right?[/bold] A voyage of another boat, with something hidden in it"
    )
    _compare([VOYAGE], [DEMO_BOAT], out / "voyage_1")
    console.print("\n[bold]3. What is missing?[/bold] Every effect of the catalogue is tried")
    saved = out / "diagnosis.json"
    found = _diagnose(out, saved)
    names, better = found.diagnosis.effects, out / "demo_boat-better.toml"
    if not names:
        return
    console.print(f"\n[bold]4. Put it in[/bold]: shadow add {' '.join(names)}")
    show_addition(add_effects(names, DEMO_BOAT, saved, better), names, DEMO_BOAT, better)
    console.print("\n[bold]5. Was that it?[/bold] Another voyage, which the diagnosis never saw")
    refit = bool(found.voyage_effects)
    before, after = _compare([TWIN], [DEMO_BOAT, better], out / "voyage_2", refit)[:2]
    console.print(
        f"\n[bold]{TWIN.name}: error {before.nrmse:.3f} before, {after.nrmse:.3f} after[/bold] "
        f"(noise alone shows {before.noise_floor_nrmse:.3f})"
    )


def _shadow(out: Path, console: Console) -> None:
    """Replay a recording of a real autopilot while a second zenoh session listens."""
    console.print(
        "[bold]1. A digital shadow[/bold] of a boat steered by a real autopilot (in simulation)"
    )
    with _listener() as samples, progress_bar(f"replaying {AUTOPILOT.name}") as share_done:
        summary = replay(AUTOPILOT, load_vessel(OTTER), None, ReplayOptions(out), share_done)
    show_replay(summary)
    count = sum(samples.values())
    console.print(f"zenoh: a second session heard {count} samples on {len(samples)} keys\n")


def _diagnose(out: Path, saved: Path) -> DiagnosisResult:
    pictures = out / "diagnosis"
    with status_line("diagnosing") as show:
        found = diagnose_logs([VOYAGE], DEMO_BOAT, progress=show)
        save_diagnosis(found, save=saved, pictures=pictures, progress=show)
    show_diagnosis(found, saved, None, pictures)
    return found


def _compare(
    logs: Sequence[Path], vessels: Sequence[Path], pictures: Path, refit: bool = False
) -> list[Comparison]:
    with status_line("comparing") as show:
        found = compare_logs(logs, vessels, pictures=pictures, progress=show, refit=refit)
    show_comparisons(found, pictures)
    return found


@contextmanager
def _listener() -> Iterator[Counter[str]]:
    """A zenoh session of its own that counts the samples it receives, by key."""
    samples: Counter[str] = Counter()

    def count(sample: Any) -> None:
        samples[str(sample.key_expr)] += 1

    with open_session(BusSettings()) as session:
        session.declare_subscriber("shadow/**", count)
        yield samples
