"""What the paper did on the water: drive both boats, look through instruments, identify.

Everything that the tables need, made once. Seeds are fixed: the same numbers every time.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.hidden.sail import Truth
from benchmarks.paper import excitations
from benchmarks.paper.boats import Pair, iacquabot, wam_v
from benchmarks.paper.instruments import ALL, Instruments
from benchmarks.paper.voyage import clock_offset_s, logged, sailed, trial_of, true_at
from sim.identification.identify import Identification, identify
from sim.identification.regression import Regression, fit_by_regression
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import Vessel

# Dice whose runs vary most as the paper's figures imply (√(RMSE² / (1 − R²))), found by simulation
# among 200 and 600, before anything was identified: the paper prints no commands.
DRIVER, JUDGE = 46, 477
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Lengths:
    """How long each run is [s]; `seed` of excitations, sensors and first guesses."""

    identification: float = 500.0
    validation: float = 120.0
    joystick: float = 120.0
    seed: int = 7


@dataclass(frozen=True)
class Study:
    """One boat seen through one set of instruments."""

    pair: Pair
    instruments: Instruments
    found: Identification
    printed: Regression
    consistent: Regression
    validation: Trial
    true_validation: Floats  # (T, 6) at the trial's rows

    @property
    def identified(self) -> Vessel:
        """The vessel that the default found."""
        return self.found.vessel


@dataclass(frozen=True)
class Campaign:
    """Both boats, all instruments."""

    lengths: Lengths
    boats: tuple[Pair, Pair]  # IAcquaBot, WAM-V
    instruments: tuple[Instruments, ...]
    validation: tuple[Truth, Truth]
    studies: Mapping[tuple[str, str], Study]  # boat, instruments
    driven: Floats  # (K, 2) the joystick's commands
    joystick: Truth  # of IAcquaBot

    def study(self, boat: int, instruments: Instruments) -> Study:
        """Of the first or second boat."""
        return self.studies[self.boats[boat].name, instruments.name]


def run(
    lengths: Lengths,
    folder: Path,
    tell: Tell = lambda _: None,
    seen_through: Sequence[Instruments] = ALL,
) -> Campaign:
    """Sail, record, decode, smooth, identify."""
    pairs = iacquabot(), wam_v()
    fit = excitations.identification(
        lengths.identification, np.random.default_rng([lengths.seed, 1])
    )
    judge = excitations.validation(lengths.validation, np.random.default_rng([JUDGE, 2]))
    drive = excitations.joystick(lengths.joystick, np.random.default_rng([DRIVER, 3]))
    truths, studies = [], {}
    for number, pair in enumerate(pairs):
        tell(f"sailing {pair.name}")
        long, short = sailed(pair.boat, fit), sailed(pair.boat, judge)
        truths.append(short)
        for i, carried in enumerate(seen_through):
            tell(f"identifying {pair.name} through {carried.name}")
            seed = 1000 * lengths.seed + 100 * number + 10 * i
            studies[pair.name, carried.name] = studied(pair, carried, long, short, folder, seed)
    joystick = sailed(pairs[0].boat, drive)
    return Campaign(
        lengths, pairs, tuple(seen_through), (truths[0], truths[1]), studies, drive, joystick
    )


def studied(
    pair: Pair, carried: Instruments, long: Truth, short: Truth, folder: Path, seed: int
) -> Study:
    """One boat through one set of instruments, from two logs."""
    fit = logged(folder / "identification.tlog", pair.boat, long, carried, seed)
    judge = logged(folder / "validation.tlog", pair.boat, short, carried, seed + 1)
    trials, other = [trial_of(fit, carried)], trial_of(judge, carried)
    start = pair.guessed(seed)
    model = Model.of(start)
    times = other.time + other.start_time_ns * 1e-9 - clock_offset_s(judge)
    return Study(
        pair, carried,
        identify(trials, start, others=[other]),
        fit_by_regression(trials, model, printed=True), fit_by_regression(trials, model),
        other, true_at(short, times),
    )  # fmt: skip
