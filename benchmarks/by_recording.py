"""Is one boat known better from many recordings, and is the odd one named?

    python -m benchmarks.by_recording FOLDER [--seed 2] [--seconds 120] [--recordings 6]
    python -m benchmarks.by_recording --draws 200 [--seed 2]
    python -m benchmarks.by_recording --lake [--data FOLDER]

Recordings of the blind test's generator (`benchmarks.hidden`: physics that shares no code with
`sim`), each in a current of its own that no vessel file knows; the last one of the boat with a port
thruster that gives a fifth less. Then two more of a second boat of the type, whose thrusters both
give 12 % less. Printed: how far the numbers are from the truth, in per cent and in their stated
standard deviations, put together and as the mean of all recordings; who is named; the second boat's
thrusters. Seed 1 is for tuning.

`--draws` makes numbers instead of recordings, so many times in each of three fleets: how often
intervals hold the truth, a recording that agrees is named, and one whose third number is 40 % off.

`--lake` fits the BlueBoat's lake runs (`benchmarks.blueboat`), wired as they say, without two that
judge: error of free runs over these, of the vessel file, of runs put together, and of one fit.
"""

import argparse
import os
from pathlib import Path

import numpy as np

from benchmarks.blueboat import BESIDE, JUDGE, judged, labelled, runs_in
from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.talk import MODEST
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage
from gateway.files import VESSELS
from gateway.offline.trials import DEFAULT_TRIALS, usable_trials
from gateway.vessel_file import load_vessel
from sim.identification import BASE, IdentifySettings
from sim.identification.by_recording import (
    ByRecording,
    RecordingFit,
    identify_by_recording,
    pooled,
)
from sim.identification.identify import identify
from sim.identification.wiring import rewired, wiring_of
from sim.model import parameters_of

ODD, WEAK, SECOND = 0.8, 0.88, 2
THRUSTS = ("left.ahead", "left.astern", "right.astern")


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


NAMES, TRUE = ("m11", "X_u", "N_r"), np.array([120.0, -25.0, -100.0])
CORRELATED = np.array([[1.0, 0.0, 0.0], [0.7, 0.7, 0.0], [0.2, 0.3, 0.9]])
FLEETS = ((8, 0.03, 0.03), (6, 0.02, 0.05), (5, 0.03, 0.0))  # recordings, noise, scatter
OFF, SAID_95 = 1.4, 1.96


def drawn(
    random: np.random.Generator, count: int, noise: float, scatter: float, off: float = 1.0
) -> list[RecordingFit]:
    """What `count` recordings might say; the first one's last number `off` times as large."""
    root = noise * np.abs(TRUE)[:, None] * CORRELATED
    value = TRUE * (1.0 + scatter * random.normal(size=(count, 3)))
    value += random.normal(size=(count, 3)) @ root.T
    value[0, 2] *= off
    return [RecordingFit(f"r{k}", "", NAMES, v, root @ root.T, {}) for k, v in enumerate(value)]


def draws(number: int, seed: int) -> None:
    """The table of the three fleets."""
    vessel = load_vessel(VESSELS / "wam-v.toml")
    print(
        "recordings, own noise, scatter: one that agrees is named, intervals hold, 40 % off alone"
    )
    for row, fleet in enumerate(FLEETS):
        random = np.random.default_rng([seed, row])
        named, alone, held = 0, 0, list[bool]()
        for _ in range(number):
            found = pooled(drawn(random, *fleet), vessel)
            named += bool(found.disagreements)
            pairs = zip(found.numbers, TRUE, strict=True)
            held += [one.ci95[0] < true < one.ci95[1] for one, true in pairs]
            odd = pooled(drawn(random, *fleet, OFF), vessel).disagreements
            alone += [one.recording for one in odd] == ["r0"]
        count, noise, scatter = fleet
        print(f"{count}, {noise:.0%}, {scatter:.0%}: {named / number:.1%}, "
              f"{np.mean(held):.1%}, {alone / number:.1%}")  # fmt: skip


def lake(folder: Path) -> None:
    """Errors over the two runs that judge, RMSE of u, v, r."""
    runs = runs_in(folder)
    fit = [run.trial for run in runs if run.number not in JUDGE]
    vessel = rewired(labelled(), wiring_of([run.trial for run in runs], labelled()))
    whole = IdentifySettings((*BASE, *THRUSTS), method="simulation")
    vessels = {"vessel file": vessel}
    for label, settings in (("shooting", IdentifySettings()), ("simulation, thrust free", whole)):
        found = identify_by_recording(fit, vessel, settings)
        print("\n".join((*found.notices, *(one.text for one in found.disagreements))))
        vessels[f"by recording, {label}"] = found.vessels[""]
        vessels[f"one fit, {label}"] = identify(fit, vessel, settings).vessel
    for label, one in vessels.items():
        error = np.mean([judged(one, run)[0] for run in runs if run.number in JUDGE], axis=0)
        print(f"{label:42}" + "".join(f"{e:8.3f}" for e in error))


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/by-recording"))
    parser.add_argument("--draws", type=int)
    parser.add_argument("--lake", action="store_true")
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("SHADOW_BLUEBOAT", BESIDE))
    )
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--recordings", type=int, default=6)
    given = parser.parse_args()
    if given.draws is not None:
        draws(given.draws, given.seed)
        return 0
    if given.lake:
        if not given.data.is_dir():
            print(f"skipped: no BlueBoat runs in {given.data} (--data FOLDER, or $SHADOW_BLUEBOAT)")
            return 0
        lake(given.data)
        return 0
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
