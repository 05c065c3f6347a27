"""Is one boat known better from many recordings, and is the odd one named?

    python -m benchmarks.by_recording FOLDER [--seed 2] [--seconds 120] [--recordings 6]

Recordings of the blind test's generator (`benchmarks.hidden`: physics that shares no code with
`sim`), each in a current of its own that no vessel file knows; the last one of the boat with a port
thruster that gives a fifth less. Then two more of a second boat of the type, whose thrusters both
give 12 % less. Printed: how far the numbers are from the truth, in per cent and in their stated
standard deviations, put together and as the mean of all recordings; who is named; the second boat's
thrusters. Seed 1 is for tuning.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.talk import MODEST
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage
from gateway.offline.trials import DEFAULT_TRIALS, usable_trials
from gateway.vessel_file import load_vessel
from sim.identification.by_recording import ByRecording, identify_by_recording
from sim.model import parameters_of

ODD, WEAK, SECOND = 0.8, 0.88, 2


def made(folder: Path, seed: int, seconds: float, recordings: int) -> list[Path]:
    """The recordings, the odd one last, then those of the second boat."""
    boat, random = BOATS["grebe"], np.random.default_rng([seed, 17])
    folder.mkdir(parents=True, exist_ok=True)
    off = boat.misjudged(seed)
    (folder / "boat.toml").write_text(vessel_toml(off), encoding="utf-8")
    (folder / "truth.toml").write_text(vessel_toml(boat), encoding="utf-8")
    files = []
    for i in range(recordings + SECOND):
        speed, towards = float(random.uniform(0.0, 0.25)), float(random.uniform(-3.0, 3.0))
        hidden = [Hidden("steady_current", {"speed": speed, "direction": towards})]
        if i == recordings - 1:
            hidden.append(Hidden("thruster_imbalance", {"port_gain": ODD}))
        if i >= recordings:
            for motor in boat.motors:
                weak = {"channel": float(motor.channel), "gain": WEAK, "time": -100.0}
                hidden.append(Hidden("thruster_fault", weak))
        name = "first" if i < recordings else "second"
        files.append(folder / f"{name}-{i}.tlog")
        if not files[-1].exists():
            write_voyage(files[-1], boat, hidden, "excitation", 300 * seed + i, seconds, MODEST)
    return files


def show(title: str, found: ByRecording, truth: dict[str, float]) -> None:
    """The table of one fit."""
    print(f"\n{title}")
    print(f"{'number':14}{'boat':8}{'file':>9}{'truth':>9}{'found':>9}{'off %':>7}{'sigmas':>8}"
          f"{'scatter %':>10}{'mean %':>8}")  # fmt: skip
    for one in found.numbers:
        gain = WEAK if one.boat == "second" else 1.0
        true = gain * truth[one.name]
        std = (one.ci95[1] - one.ci95[0]) / (2.0 * 1.96)
        said = [
            fit.value[fit.names.index(one.name)]
            for fit in found.fits
            if one.name in fit.names and one.boat in ("", fit.boat)
        ]
        off, mean = (100.0 * (value / true - 1.0) for value in (one.value, float(np.mean(said))))
        print(
            f"{one.name:14}{one.boat:8}{one.before:9.2f}{true:9.2f}{one.value:9.2f}{off:7.1f}"
            f"{(one.value - true) / std:8.2f}{100.0 * one.scatter / abs(true):10.1f}{mean:8.1f}"
        )
    for fit, weight in zip(found.fits, found.weight, strict=True):
        print(f"  {fit.recording}: weight {weight:.2f}")
    for each in found.disagreements:
        print(f"  {each.text}")


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--recordings", type=int, default=6)
    given = parser.parse_args()
    files = made(given.folder, given.seed, given.seconds, given.recordings)
    vessel = load_vessel(given.folder / "boat.toml")
    truth = parameters_of(load_vessel(given.folder / "truth.toml"))
    trials = usable_trials(files, DEFAULT_TRIALS, lambda text: None)
    one, n = trials[: given.recordings], given.recordings
    show(f"one boat, {n} recordings, the last one odd", identify_by_recording(one, vessel), truth)
    boats = ["first"] * (n - 1) + ["second"] * SECOND
    both = [*trials[: n - 1], *trials[n:]]
    show("two boats of one type", identify_by_recording(both, vessel, boats=boats), truth)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
