"""Real boats improved step by step: which effects the software names, and what the error does.

    python -m benchmarks.ladders [blueboat] [short] [groups] [otter] [--data FOLDER]

blueboat   lake runs without 232 and 234: the plain vessel is identified, the diagnosis names what
           is missing, each rung is fitted anew on the same runs and run freely over the two others
short      three lake runs alone, as a newcomer would: identified, diagnosed, and each step of the
           ladder compared on 232 and 234
groups     lake runs again, with four groups of three left out in turn, drawn before anything was
           fitted; not done where nothing is asked for
otter      ArduPilot's SITL Otter (another author's hull): the vessel file that `shadow init` gives,
           diagnosed on the first 400 s, each rung judged on the last 100

Without the data a part is skipped. Effects are the software's own choice: nothing is named here.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import blueboat
from gateway.offline.diagnose import DIAGNOSIS_TRIALS
from gateway.offline.trials import TrialOptions, load_trials
from gateway.offline.vessel import init_vessel
from gateway.vessel_file import load_vessel
from sim.comparison.compare import compare
from sim.diagnosis.answer import Diagnosis
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.effects.effect import Scope
from sim.identification import IdentifySettings
from sim.identification.identify import identify
from sim.identification.wiring import rewired, wiring_of
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import Vessel

OTTER = blueboat.ROOT.parent / "shared" / "data" / "sitl" / "otter_calm.tlog"
SIZE = {"length": 2.0, "beam": 1.08, "mass": 55.0, "thrust": 120.0}
SEEN_S = 400.0
SHORT = ("220", "224", "230")
GROUPS, GROUPS_SEED = 4, 1
GUESSED = 1.0  # share that numbers guessed from a boat's size may be off by


def blueboat_ladder(folder: Path, left_out: Sequence[str] = blueboat.JUDGE) -> Floats:
    """Fit, diagnose on what was fitted, judge each rung on runs that nothing saw.

    RMSE (3, 3) of the last, as `blueboat.judged`, mean of those runs.
    """
    runs = blueboat.runs_in(folder)
    fit = [run for run in runs if run.number not in left_out]
    judges = [run for run in runs if run.number in left_out]
    plain = blueboat.fitted(fit, [], []).vessel
    print(f"\nidentified plain vessel, {len(fit)} runs; then judged on {' and '.join(left_out)}")
    figures = _judged(plain, judges)
    begun = time.perf_counter()
    trials = [
        trial
        for run in fit
        for trial in load_trials(
            folder / f"fixed_00000{run.number}.csv", None, DIAGNOSIS_TRIALS, blueboat.MAPPING
        )
    ]
    found = diagnose(trials, plain)
    _told(found, time.perf_counter() - begun)
    for k in range(1, len(found.effects) + 1):
        print(f"\nwith {', '.join(found.effects[:k])}, all fitted anew")
        figures = _judged(blueboat.fitted(fit, [], found.vessel.effects[:k]).vessel, judges)
    return figures


def blueboat_groups(folder: Path) -> None:
    """Groups of three left out in turn."""
    numbers = [file.stem[-3:] for file in sorted(folder.glob("*.csv"))]
    drawn = np.random.default_rng(GROUPS_SEED).permutation(numbers)
    groups = [[str(n) for n in sorted(drawn[k : k + 3])] for k in range(0, 3 * GROUPS, 3)]
    figures = [blueboat_ladder(folder, group) for group in groups]
    print("\nthe last of each")
    names = ["+".join(group) for group in groups]
    print("\n".join(blueboat.lines(list(zip(names, figures, strict=True)))))


def short_ladder(folder: Path) -> None:
    """What three short runs can carry: the steps of their ladder on two runs that nothing saw."""

    def trials_of(number: str, options: TrialOptions) -> list[Trial]:
        return load_trials(folder / f"fixed_00000{number}.csv", None, options, blueboat.MAPPING)

    fine = [trial for number in SHORT for trial in trials_of(number, TrialOptions())]
    vessel = blueboat.labelled()
    vessel = identify(fine, rewired(vessel, wiring_of(fine, vessel)), IdentifySettings()).vessel
    begun, cpu = time.perf_counter(), time.process_time()
    coarse = [trial for number in SHORT for trial in trials_of(number, DIAGNOSIS_TRIALS)]
    found = diagnose(coarse, vessel)
    _told(found, time.perf_counter() - begun)
    print(f"  CPU {time.process_time() - cpu:.0f} s")
    for refusal in found.refused:
        print(f"  not judged: {refusal.effect}: {refusal.reason}")
    models = [Model.of(rung.vessel) for rung in found.ladder]
    for number in blueboat.JUDGE:
        (trial,) = trials_of(number, TrialOptions())
        for rung, one in zip(found.ladder, compare(trial, models), strict=True):
            name = " + ".join(rung.effects) or rung.base
            print(f"{number}  {name:40} nrmse {one.nrmse:.3f} (noise {one.noise_floor_nrmse:.3f})")


def _judged(vessel: Vessel, judges: Sequence[blueboat.Run]) -> Floats:
    """Figures of the vessel on other days: without what was of the days it was fitted to."""
    of_the_boat = tuple(a for a in vessel.effects if a.effect.scope is Scope.BOAT)
    vessel = replace(vessel, effects=of_the_boat)
    rows = [(run.number, blueboat.judged(vessel, run)) for run in judges]
    print("\n".join(blueboat.lines(rows)), flush=True)
    return np.asarray(np.mean([figures for _, figures in rows], axis=0))


def otter_ladder(log: Path) -> None:
    """From what `shadow init` guesses."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "init.toml"
        init_vessel(log, file, None, SIZE, None, True)
        vessel = load_vessel(file)
    (whole,) = load_trials(log, None, DIAGNOSIS_TRIALS)
    seen = replace(whole, usable=whole.usable & (whole.time < SEEN_S))
    begun = time.perf_counter()
    found = diagnose([seen], vessel, DiagnoseSettings(prior=GUESSED))
    _told(found, time.perf_counter() - begun)
    (fine,) = load_trials(log, None, TrialOptions())
    last = replace(fine, usable=fine.usable & (fine.time >= SEEN_S))
    models = [Model.of(rung.vessel) for rung in found.ladder]
    print(f"\non the last {float(last.usable.sum()) * last.dt:.0f} s, free runs of 10 s")
    for rung, one in zip(found.ladder, compare(last, models), strict=True):
        name = " + ".join(rung.effects) or rung.base
        cells = "  ".join(f"{c} {one.scores.rmse[c]:.4f}" for c in "uvr")
        print(f"{name:40} nrmse {one.nrmse:.3f} (noise {one.noise_floor_nrmse:.3f})  {cells}")


def _told(found: Diagnosis, seconds: float) -> None:
    print(f"\n{found.verdict}, {seconds:.0f} s: {found.summary}")
    for rung in found.ladder:
        name = " + ".join(rung.effects) or rung.base
        others = f", recordings left out {rung.left_out.nrmse:.3f}" if rung.left_out else ""
        print(f"  {name:40} held-out nrmse {rung.heldout.nrmse:.3f}{others}")
    for effect, numbers in found.ladder[-1].parameters.items():
        told = ", ".join(f"{e.name.rpartition('.')[2]} {e.value:.3g}" for e in numbers[:4])
        print(f"  {effect}: {told}")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ladders")
    parser.add_argument("boats", nargs="*", default=["blueboat", "short", "otter"])
    parser.add_argument("--data", type=Path, help="folder of the BlueBoat runs")
    a = parser.parse_args(arguments)
    np.set_printoptions(precision=3)
    folder = a.data or Path(os.environ.get("SHADOW_BLUEBOAT", blueboat.BESIDE))
    if "blueboat" in a.boats:
        print("BlueBoat on a lake")
        blueboat_ladder(folder) if folder.is_dir() else print(f"skipped: no runs in {folder}")
    if "short" in a.boats and folder.is_dir():
        print("\nBlueBoat, three short runs")
        short_ladder(folder)
    if "groups" in a.boats and folder.is_dir():
        print("\nBlueBoat, groups of three left out")
        blueboat_groups(folder)
    if "otter" in a.boats:
        print("\nOtter in ArduPilot's simulation")
        otter_ladder(OTTER) if OTTER.is_file() else print(f"skipped: no {OTTER.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
