"""Do the stated 95 % intervals hold? Identification of voyages whose parameters are known.

    python -m benchmarks.identification [--voyages 8] [--seconds 600] [--seed 100] [--write]

Voyages of `benchmarks.hidden` (physics that shares no code with `sim`, sensor errors that wander),
as MAVLink logs, from vessel files whose nine numbers are each about 10 % off. 100 voyages take a
quarter of an hour. Per parameter: share of the voyages whose interval holds the truth, median
half-width in per cent of the truth, median error, and the half-width as a multiple of the ideal:
what the sensors as they are would allow someone who knew their noise, all commands to the tick,
and without offsets between streams. Instrumental variables and least squares as in the paper stand
beside it. `--write` keeps the table in benchmarks/results/identification.md.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.hidden.boats import BOATS, Boat
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage
from gateway.offline.trials import load_trials
from gateway.vessel_file import load_vessel
from sim.identification import BASE, METHODS, IdentifySettings
from sim.identification.identify import Identification, identify
from sim.identification.noise import Noise
from sim.identification.parameters import unknowns_of
from sim.identification.shooting import information
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial

TITLE = "Do the stated 95 % intervals hold?"
RESULTS = Path(__file__).resolve().parent / "results" / "identification.md"
PILOTS = ("excitation", "excitation", "gentle", "survey")
# Errors of the generator's sensors as means over 0.4 s: velocities wander over 2 s (0.025 m/s), and
# sway is off by the heading's error too; twenty readings of the gyro, white 0.002 rad/s each, and
# its wandering bias of 0.0005 make 0.0007.
SENSORS = Noise(np.array([0.025, 0.027, 0.0007]), np.array([0.82, 0.82, 0.5]))
LONG = IdentifySettings(horizons=(30.0,), growth=100.0, offsets=False)


@dataclass(frozen=True)
class Case:
    """One voyage: truth (9,), ideal standard deviation (9,), what each method found."""

    truth: Floats
    ideal: Floats
    found: dict[str, Identification]
    seconds: dict[str, float]


def case(folder: Path, boat: Boat, pilot: str, seed: int, seconds: float) -> Case:
    """Sail, record, decode, smooth, identify."""
    log = folder / "voyage.tlog"
    write_voyage(log, boat, [], pilot, seed, seconds)
    (folder / "true.toml").write_text(vessel_toml(boat), encoding="utf-8")
    (folder / "off.toml").write_text(vessel_toml(boat.misjudged(seed)), encoding="utf-8")
    trials = load_trials(log)
    true, start = Model.of(load_vessel(folder / "true.toml")), load_vessel(folder / "off.toml")
    found, took = {}, {}
    for method in METHODS:
        begun = time.perf_counter()
        # judged on the same voyage: a second fit for blocks held out would tell nothing here
        found[method] = identify(trials, start, IdentifySettings(method=method), trials)
        took[method] = time.perf_counter() - begun
    truth = np.array([true.theta[true.names.index(name)] for name in BASE])
    return Case(truth, ideal(true, trials[0]), found, took)


def ideal(true: Model, trial: Trial) -> Floats:
    """Standard deviations (9,) at the truth with known noise of the sensors."""
    unknowns = unknowns_of(true, 1, LONG)
    H = information(unknowns, trial, unknowns.start, SENSORS, LONG)
    return np.sqrt(np.diag(np.linalg.inv(H + unknowns.assumed_information)))


def table(cases: Sequence[Case], method: str) -> list[str]:
    """Lines of the table of one method."""
    lines = [f"{method}, median {np.median([c.seconds[method] for c in cases]):.1f} s a voyage"]
    lines.append(f"{'':6}{'told':>6}{'covered':>9}{'± %':>8}{'error %':>9}{'× ideal':>9}")
    for i, name in enumerate(BASE):
        told = [(c, c.found[method].estimates[i]) for c in cases]
        told = [(c, e) for c, e in told if e.identifiable]
        if not told:
            continue
        half = np.array([0.5 * (e.ci95[1] - e.ci95[0]) for _, e in told])
        truth = np.array([c.truth[i] for c, _ in told])
        error = np.array([e.value for _, e in told]) - truth
        times = half / np.array([1.96 * c.ideal[i] for c, _ in told])
        lines.append(
            f"{name:6}{len(told) / len(cases):6.0%}{np.mean(np.abs(error) <= half):9.0%}"
            f"{np.median(half / np.abs(truth)):8.1%}{np.median(error / truth):+9.1%}"
            f"{np.median(times):9.1f}"
        )
    return lines


def told(a: argparse.Namespace, cases: Sequence[Case]) -> str:
    """All tables, and how often the cross-check spoke."""
    spoke = sum(bool(c.found["shooting"].cross_check) for c in cases)
    text = "\n\n".join("\n".join(table(cases, method)) for method in METHODS)
    text += (
        f"\n\nThe cross-check spoke on {spoke} of {len(cases)} voyages; no model lacks anything."
    )
    return f"{len(cases)} voyages of {a.seconds:g} s, seeds from {a.seed}\n\n{text}\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification")
    parser.add_argument("--voyages", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--write", action="store_true", help=f"into {RESULTS.name}")
    a = parser.parse_args(arguments)
    boats, cases = list(BOATS.values()), []
    with tempfile.TemporaryDirectory() as folder:
        for i in range(a.voyages):
            boat, pilot = boats[i % len(boats)], PILOTS[i // len(boats) % len(PILOTS)]
            cases.append(case(Path(folder), boat, pilot, a.seed + i, a.seconds))
            print(f"{i + 1}/{a.voyages} {boat.name}, {pilot}", file=sys.stderr)
            if a.write:  # again and again: a run that is stopped has not been for nothing
                RESULTS.parent.mkdir(exist_ok=True)
                RESULTS.write_text(f"# {TITLE}\n\n```\n{told(a, cases)}```\n", encoding="utf-8")
    print(told(a, cases))
    return 0


if __name__ == "__main__":
    sys.exit(main())
