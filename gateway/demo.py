"""`shadow demo`: the whole story on recordings that ship, offline.

replay → compare → diagnose → add → compare on a voyage that the diagnosis never saw
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from gateway.bus import BusSettings, open_session
from gateway.offline.add import AdditionResult, add_effects
from gateway.offline.compare import compare_logs
from gateway.offline.diagnose import DiagnosisResult, diagnose_logs, save_diagnosis
from gateway.offline.replay import ReplayOptions, replay
from gateway.shipped import RECORDINGS, VESSELS
from gateway.terminal.comparison import show_comparisons
from gateway.terminal.console import progress, status
from gateway.terminal.diagnosis import show_addition, show_diagnosis
from gateway.terminal.runs import show_replay
from gateway.vessel_file import load_vessel
from sim.comparison.compare import Comparison

AUTOPILOT, OTTER = RECORDINGS / "otter_piece.tlog", VESSELS / "otter.toml"
VOYAGE, TWIN = RECORDINGS / "voyage_1.tlog", RECORDINGS / "voyage_2.tlog"
DEMO_BOAT = VESSELS / "demo_boat.toml"

Say = Callable[[str], None]


def run_demo(out: Path) -> None:
    """Five steps; each says what it does and where the files are."""
    say = Console(highlight=False).print
    _shadow(out, say)
    say("[bold]2. Is the model right?[/bold] A voyage of another boat, with something hidden in it")
    _compare([VOYAGE], [DEMO_BOAT], out / "voyage_1")
    say("\n[bold]3. What is missing?[/bold] Every effect of the catalogue is tried")
    found = _diagnose(out)
    better = _add(found, out, say)
    if better is None:
        return
    say("\n[bold]5. Was that it?[/bold] Another voyage, which the diagnosis never saw")
    twin = _compare([TWIN], [DEMO_BOAT, better], out / "voyage_2", refit=bool(found.voyage_effects))
    before, after = twin[0].nrmse, twin[1].nrmse
    say(
        f"\n[bold]{TWIN.name}: error {before:.3f} before, {after:.3f} after[/bold] "
        f"(noise alone shows {twin[0].noise_floor_nrmse:.3f})"
    )


def _shadow(out: Path, say: Say) -> None:
    """A recording of a real autopilot through the shadow, heard on zenoh by somebody else."""
    say("[bold]1. A digital shadow[/bold] of a boat steered by a real autopilot (in simulation)")
    with _listener() as heard, progress(f"replaying {AUTOPILOT.name}") as tell:
        summary = replay(AUTOPILOT, load_vessel(OTTER), None, ReplayOptions(out), tell)
    show_replay(summary)
    say(f"zenoh: a second session heard {sum(heard.values())} samples on {len(heard)} keys\n")


def _diagnose(out: Path) -> DiagnosisResult:
    with status("diagnosing") as tell:
        found = diagnose_logs([VOYAGE], DEMO_BOAT, tell=tell)
        save_diagnosis(found, save=_json(out), pictures=out / "diagnosis", tell=tell)
    show_diagnosis(found, _json(out), None, out / "diagnosis")
    return found


def _add(found: DiagnosisResult, out: Path, say: Say) -> Path | None:
    """The better vessel file; None where nothing was found."""
    names, better = found.diagnosis.effects, out / "demo_boat-better.toml"
    if not names:
        return None
    say(f"\n[bold]4. Put it in[/bold]: shadow add {' '.join(names)}")
    done: AdditionResult = add_effects(names, DEMO_BOAT, _json(out), better)
    show_addition(done, names, DEMO_BOAT, better)
    return better


def _json(out: Path) -> Path:
    return out / "diagnosis.json"


def _compare(
    logs: Sequence[Path], vessels: Sequence[Path], pictures: Path, refit: bool = False
) -> list[Comparison]:
    with status("comparing") as tell:
        found = compare_logs(logs, vessels, pictures=pictures, progress=tell, refit=refit)
    show_comparisons(found, pictures)
    return found


@contextmanager
def _listener() -> Iterator[Counter[str]]:
    """A zenoh session of its own that counts what it hears, by key."""
    heard: Counter[str] = Counter()

    def count(sample: Any) -> None:
        heard[str(sample.key_expr)] += 1

    with open_session(BusSettings()) as session:
        session.declare_subscriber("shadow/**", count)
        yield heard
