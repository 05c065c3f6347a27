"""A real boat: fit on BlueBoat lake runs, free runs on others that the fit never saw.

    python -m benchmarks.blueboat [--data FOLDER] [--effects astern_stall …] [--leave-one-out]
        [--groups]

FOLDER holds fixed_NNNNNNNN.csv (default: $SHADOW_BLUEBOAT, else shared/data/blueboat-lake/runs
beside the checkout); without it the benchmark is skipped. Nothing is told that a user would have to
read elsewhere: the mapping takes the columns at their word, the vessel file the labels of the
channels; what is wrong with either is what the software finds, and the wiring it says is the one
that is used. Figures are RMSE of one free run over the whole recording, from its first sample,
against the motion that the smoother makes of positions and headings, and, in brackets, against the
velocities of the table as they stand. "zero" is what predicting nothing leaves. `--groups`: all
recordings shuffled once (`GROUPS_SEED`, chosen before any result was seen) and left out three by
three, each group judged by a fit on all others; the means over the groups.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gateway.ingest.csv.log import CsvLog
from gateway.offline.notices import notices_of
from gateway.offline.trials import load_trials
from gateway.samples import Quantity
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import EFFECTS
from sim.identification import BASE, IdentifySettings
from sim.identification.identify import Identification, identify
from sim.identification.wiring import rewired, wiring_of
from sim.model import Model
from sim.prediction.free_runs import free_run
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

ROOT = Path(__file__).parent.parent
MAPPING = ROOT / "configs" / "csv" / "blueboat-lake.toml"
VESSEL = ROOT / "configs" / "vessels" / "blueboat.toml"
BESIDE = ROOT.parent / "shared" / "data" / "blueboat-lake" / "runs"
JUDGE = ("232", "234")
MIXED = ("220", "224", "230", "232", "234")
FREE = ("left.ahead", "left.astern", "right.astern", "x_g", "curve")
GROUPS_SEED, OF_A_GROUP = 0, 3
BAR = np.array([0.18, np.inf, 0.080])  # u m/s, r rad/s
ANY = np.full(3, 1e9)  # no error is so large that it ends a run


@dataclass(frozen=True)
class Run:
    """One recording: all of it counts; `said` (T, 3) are the table's own velocities."""

    number: str
    trial: Trial
    said: Floats


def runs_in(folder: Path) -> list[Run]:
    """All recordings, in order."""
    found = []
    for file in sorted(folder.glob("*.csv")):
        (trial,) = load_trials(file, mapping=MAPPING)
        found.append(Run(file.stem[-3:], trial, _said(file, trial)))
    return found


def _said(file: Path, trial: Trial) -> Floats:
    """The table's surge, sway and yaw rate on the trial's grid (T, 3)."""
    log = CsvLog.from_bytes(file.read_bytes(), str(file), MAPPING)
    columns = {s.quantity: s for s in log.samples()}
    at = trial.start_time_ns * 1e-9 + trial.time
    body, rate = columns[Quantity.BODY_VELOCITY], columns[Quantity.YAW_RATE]
    pairs = ((body, 0), (body, 1), (rate, 0))
    return np.stack([np.interp(at, s.vehicle_time_ns * 1e-9, s.values[:, i]) for s, i in pairs], 1)


def labelled() -> Vessel:
    """The boat as the table labels it: left on channel 1 runs backwards on a high pulse."""
    vessel = load_vessel(VESSEL)
    left, right = vessel.thrusters
    return replace(
        vessel, thrusters=(replace(left, servo=replace(left.servo, reversed=True)), right)
    )


def fitted(
    runs: Sequence[Run], others: Sequence[Run], effects: Sequence[AddedEffect]
) -> Identification:
    """One vessel with effects from some recordings, wired as they say."""
    trials = [run.trial for run in runs]
    vessel = labelled()
    vessel = rewired(vessel, wiring_of(trials, vessel)).with_effects(*effects)
    free = (*BASE, *FREE, *(f"{added.effect.name}.*" for added in effects))
    settings = IdentifySettings(free, method="simulation")
    return identify(trials, vessel, settings, [run.trial for run in others])


def starts_of(names: Sequence[str]) -> list[AddedEffect]:
    """Effects by their names, where a fit begins; what all days may have alike as the boat's."""
    known = {e.name: e.of_the_boat if e.alike else e for e in EFFECTS}
    return [AddedEffect(known[n], {p.name: p.start for p in known[n].parameters}) for n in names]


def judged(vessel: Vessel, run: Run) -> Floats:
    """RMSE (3, 3) of u, v, r: against the smoother, against the table, and of predicting zero."""
    whole = replace(run.trial, usable=np.ones(len(run.trial), np.bool_))
    free = free_run(whole, Model.of(vessel), ANY)
    count = len(free.error)
    against = (free.error[:, 3:], run.said[:count] - free.model[:, 3:], whole.nu[:count])
    return np.array([np.sqrt(np.nanmean(error**2, axis=0)) for error in against])


def groups(runs: Sequence[Run]) -> list[tuple[str, list[Run]]]:
    """Recordings in threes, by their numbers; the one that is over is in none."""
    order = np.random.default_rng(GROUPS_SEED).permutation(len(runs))
    threes = [order[i : i + OF_A_GROUP] for i in range(0, len(runs) - OF_A_GROUP + 1, OF_A_GROUP)]
    left = [[runs[k] for k in sorted(three)] for three in threes]
    return [(" ".join(run.number for run in some), some) for some in left]


def _mean(left: Sequence[Run], runs: Sequence[Run], effects: Sequence[str]) -> Floats:
    """Figures (3, 3) of recordings by a fit on all others, as their mean."""
    numbers = {run.number for run in left}
    others = [run for run in runs if run.number not in numbers]
    vessel = fitted(others, left, starts_of(effects)).vessel
    each = [judged(vessel, run) for run in left]
    for run, figures in zip(left, each, strict=True):
        print(f"  {run.number}: u {figures[0, 0]:.3f}, r {figures[0, 2]:.3f}", flush=True)
    return np.asarray(np.mean(each, axis=0))


def lines(rows: Sequence[tuple[str, Floats]]) -> list[str]:
    """The table, with means."""
    out = [f"{'':12}{'u m/s':>18}{'v m/s':>18}{'r rad/s':>18}{'zero u, v, r':>24}"]
    mean = np.mean([figures for _, figures in rows], axis=0)
    for name, figures in (*rows, ("mean", mean)):
        cells = "".join(f"{figures[0, i]:11.3f} ({figures[1, i]:.3f})" for i in range(3))
        zero = "".join(f"{figures[2, i]:8.3f}" for i in range(3))
        out.append(f"{name:12}{cells}{zero}")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; 1 where the bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blueboat")
    parser.add_argument("--data", type=Path)
    parser.add_argument("--effects", nargs="*", default=[])
    parser.add_argument("--leave-one-out", action="store_true")
    parser.add_argument("--groups", action="store_true")
    a = parser.parse_args(arguments)
    folder = a.data or Path(os.environ.get("SHADOW_BLUEBOAT", BESIDE))
    if not folder.is_dir():
        print(f"skipped: no BlueBoat runs in {folder} (--data FOLDER, or $SHADOW_BLUEBOAT)")
        return 0
    runs = runs_in(folder)
    for notice in notices_of([run.trial for run in runs], labelled()):
        print(f"! {notice}")
    fit = [run for run in runs if run.number not in JUDGE]
    judges = [run for run in runs if run.number in JUDGE]
    if a.groups:
        rows = [(name, _mean(left, runs, a.effects)) for name, left in groups(runs)]
        print("\n".join(lines(rows)))
        return 0
    begun = time.perf_counter()
    found = fitted(fit, judges, starts_of(a.effects))
    print(f"\nfit on {len(fit)} runs without {' and '.join(JUDGE)}, "
          f"{time.perf_counter() - begun:.0f} s")  # fmt: skip
    table = [(run.number, judged(found.vessel, run)) for run in judges]
    print("\n".join(lines(table)))
    print("\n".join(f"! {says}" for says in found.unconfirmed))
    if a.leave_one_out:
        print("\neach mixed run by a fit on all others")
        mixed = (run for run in runs if run.number in MIXED)
        rows = [(run.number, _mean([run], runs, a.effects)) for run in mixed]
        print("\n".join(lines(rows)))
    mean = np.mean([figures[:2] for _, figures in table], axis=0)
    return int(bool(np.any(mean > BAR)))


if __name__ == "__main__":
    sys.exit(main())
