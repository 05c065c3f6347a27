"""The cases of the blind test: which boat sails how, what is hidden, and what the owner believes.

Ten sets that share no seed: `tuning` to build with, `reporting` for the figures, `small` for
`make test-slow`, and `second` to `eighth` for figures once those before have been looked at. A
case stays the same when other families grow. Its name says nothing.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np
from numpy.random import Generator as Dice

from benchmarks.hidden.boats import EVERY, Boat
from benchmarks.hidden.causes import Hidden, is_strange
from benchmarks.hidden.strengths import (
    CHANGES,
    GROUPS,
    IN_A_SEA,
    LASTING,
    LATER,
    OF_A_VOYAGE,
    PLAYS,
    RECIPES,
    SCALES,
    SEAS,
    STRANGE,
    UNLISTED,
    WHOLE,
    boats_for,
    strong,
)
from benchmarks.hidden.talk import RATES
from benchmarks.hidden.unasked import UNASKED
from benchmarks.hidden.unheard import UNHEARD
from benchmarks.hidden.unnamed import UNNAMED
from benchmarks.hidden.untold import UNTOLD
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage

OPEN_LOOP, MISSIONS = ("excitation", "drills"), ("survey", "wander")
BRAKES = frozenset({"astern_stall", "reverse_loss"})  # who never brakes cannot see these
ALL_PILOTS = ("excitation", "gentle", "survey", "wander")
FULL, WEAK, FAINT = 1.0, 0.4, 0.2
SEEDS = {
    "tuning": 10_000, "reporting": 50_000, "small": 90_000, "second": 130_000, "third": 170_000,
    "fourth": 210_000, "fifth": 250_000, "sixth": 290_000,
    "seventh": 330_000, "eighth": 370_000,
}  # fmt: skip
LIGHT_FROM = {  # first light hull, by a set's seed
    10_000: 0, 50_000: 10, 90_000: 20, 130_000: 24, 170_000: 34, 210_000: 44,
    250_000: 54, 290_000: 64, 330_000: 74, 370_000: 84,
}  # fmt: skip
OF_A_DAY = OF_A_VOYAGE | set(SEAS)  # another day has its own
APART = 300  # seeds between families: one that grows does not change the others
LONG, SHORT = 600.0, 300.0  # s
LOG, TWIN, COMPLETE, VESSEL = "voyage.tlog", "twin.tlog", "complete.tlog", "vessel.toml"


@dataclass(frozen=True)
class Voyage:
    """One recording: who steers, with what hidden."""

    pilot: str
    seed: int
    seconds: float
    rates: str
    hidden: tuple[Hidden, ...]

    def write(self, file: Path, boat: Boat) -> None:
        """Sail it."""
        rates = RATES[self.rates]
        write_voyage(file, boat, self.hidden, self.pilot, self.seed, self.seconds, rates)


@dataclass(frozen=True)
class Case:
    """A voyage to diagnose, and its twin: the same boat on another day, to be judged on.

    share       of the full strength of what is hidden
    misjudged   the vessel file's nine numbers are each about 10 % off
    """

    name: str
    family: str
    boat: str
    share: float
    misjudged: bool
    voyage: Voyage
    twin: Voyage

    @property
    def vessel(self) -> str:
        """The vessel file that the diagnosis is given."""
        boat = EVERY[self.boat]
        return vessel_toml(boat.misjudged(self.voyage.seed) if self.misjudged else boat)


@dataclass(frozen=True)
class Plan:
    """What a family hides, on what pilots, and whether the owner misjudged the boat."""

    hidden: tuple[str, ...]
    pilots: tuple[str, ...]
    share: float = FULL
    misjudged: bool = False
    boat: str = ""  # else one of those on which it shows


def cases(name: str) -> list[Case]:
    """All cases of a set, in a fixed order."""
    number = count(1)
    plans = SMALL if name == "small" else FAMILIES
    seconds = SHORT if name == "small" else LONG
    return [
        _case(f"{name}-{next(number):03d}", family, plan, SEEDS[name] + APART * f + i, seconds)
        for f, (family, of) in enumerate(plans.items())
        for i, plan in enumerate(of(SEEDS[name]))
    ]


def materialise(case: Case, folder: Path) -> None:
    """The log and the vessel file, all that a diagnosis may see, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / VESSEL).write_text(case.vessel, encoding="utf-8")
    case.voyage.write(folder / LOG, EVERY[case.boat])


def materialise_twin(case: Case, folder: Path) -> None:
    """The other voyage into a folder; with a stranger on board also one without it."""
    folder.mkdir(parents=True, exist_ok=True)
    case.twin.write(folder / TWIN, EVERY[case.boat])
    if is_strange(case.voyage.hidden):
        replace(case.voyage, hidden=()).write(folder / COMPLETE, EVERY[case.boat])


def _case(name: str, family: str, plan: Plan, seed: int, seconds: float) -> Case:
    """One plan carried out: dice of its own choose boat, strengths, pilots."""
    dice = np.random.default_rng([seed, 0xCA5E])
    boat = plan.boat or str(dice.choice(boats_for(plan.hidden)))
    hidden = [_hide(cause, boat, dice, plan.share, seconds) for cause in plan.hidden]
    braking = plan.pilots == OPEN_LOOP and BRAKES & set(plan.hidden)
    pilot = "drills" if braking else str(dice.choice(plan.pilots))
    rates = str(dice.choice(["raised", "raised", "modest"]))
    voyage = Voyage(pilot, seed, seconds, rates, tuple(hidden))
    other = str(dice.choice([p for p in ALL_PILOTS if p != pilot]))
    there = [
        _hide(h.name, boat, dice, plan.share, SHORT) if h.name in OF_A_DAY else h for h in hidden
    ]
    twin = Voyage(other, seed + 1_000_000, SHORT, rates, tuple(there))
    return Case(name, family, boat, plan.share, plan.misjudged, voyage, twin)


def _hide(name: str, boat: str, dice: Dice, share: float, seconds: float) -> Hidden:
    values = strong(name, EVERY[boat], dice, share, seconds)
    return Hidden(name, {key: _rounded(value) for key, value in values.items()})


def _rounded(value: float) -> float:
    """Four digits are enough, and read well."""
    return float(f"{value:.4g}") if math.isfinite(value) else value


def _all(pilots: tuple[str, ...], share: float = FULL) -> list[Plan]:
    """Every effect of the catalogue alone."""
    names = [n for n in RECIPES if share == FULL or n not in WHOLE]
    return [Plan((name,), pilots, share) for name in names]


def _base_off(seed: int) -> Iterator[Plan]:
    for i, name in enumerate(RECIPES):
        yield Plan((name,), OPEN_LOOP if i % 2 == 0 else MISSIONS, misjudged=True)


def _pairs(seed: int, number: int = 24) -> Iterator[Plan]:
    """Two effects of different groups, no two pairs the same; half of them on missions."""
    dice, seen = np.random.default_rng([seed, 0x9A125]), set[tuple[str, ...]]()
    while len(seen) < number:
        one, two = dice.choice(list(GROUPS), 2, replace=False)
        pair = tuple(str(dice.choice(GROUPS[str(group)])) for group in (one, two))
        if pair in seen or pair[::-1] in seen or WHOLE & set(pair) or not boats_for(pair):
            continue
        seen.add(pair)
        yield Plan(pair, OPEN_LOOP if len(seen) % 2 else MISSIONS)


def _none(seed: int, number: int = 60) -> Iterator[Plan]:
    """Complete models, half on missions; a third of the files are misjudged."""
    for i in range(number):
        pilots = MISSIONS if i % 2 else (*OPEN_LOOP, "gentle", "circles")
        yield Plan((), pilots, misjudged=i % 3 == 2)


def _unknown(seed: int, rounds: int = 3) -> Iterator[Plan]:
    for i in range(rounds):
        for name in STRANGE:
            yield Plan((name,), MISSIONS if i == rounds - 1 else OPEN_LOOP)


def _light(seed: int, hulls: int = 10) -> Iterator[Plan]:
    """Hulls that are unstable on course: complete models and single effects, half of them on
    missions, half of the files misjudged; no hull stands in two sets."""
    first = LIGHT_FROM[seed]
    causes = [n for n in RECIPES if n not in WHOLE and "teal" in boats_for((n,))]
    for i in range(hulls):
        boat = f"light-{first + i}"
        for pilots in (MISSIONS, OPEN_LOOP):
            for misjudged in (False, True):
                yield Plan((), pilots, misjudged=misjudged, boat=boat)
        for k in range(6):
            cause = causes[(6 * i + k) % len(causes)]
            pilots = OPEN_LOOP if k % 3 == 2 else MISSIONS
            yield Plan((cause,), pilots, misjudged=k >= 3, boat=boat)


def _day(seed: int, number: int = 40) -> Iterator[Plan]:
    """Two to four causes, one at least with a moment; half on missions, a quarter misjudged."""
    dice = np.random.default_rng([seed, 0xDA4])
    for i in range(number):
        changes = [str(c) for c in dice.choice(list(CHANGES), 1 + i % 2, replace=False)]
        beside = ["steady_current", "steady_wind", *LASTING]
        if "current_change" in changes:
            beside.remove("steady_current")
        if "wind_change" in changes:
            beside.remove("steady_wind")
        lasting = [str(c) for c in dice.choice(beside, 1 + i % 4 // 2, replace=False)]
        pilots = MISSIONS if i % 2 else (*OPEN_LOOP, "circles")
        yield Plan((*changes, *lasting), pilots, misjudged=i % 4 == 3)


def _sea(seed: int, number: int = 30) -> Iterator[Plan]:
    """A sea alone (every fifth), else with one effect beside; half on missions, a quarter
    misjudged."""
    dice = np.random.default_rng([seed, 0x5EA])
    for i in range(number):
        beside = () if i % 5 == 0 else (str(dice.choice(IN_A_SEA)),)
        pilots = MISSIONS if i % 2 else (*OPEN_LOOP, "circles")
        yield Plan(("sea", *beside), pilots, misjudged=i % 4 == 3)


def _later(seed: int) -> Iterator[Plan]:
    """Each effect that came later: every pilot, half of the files misjudged, then light hulls."""
    first = LIGHT_FROM[seed]
    for name in LATER:
        for i in range(6):
            yield Plan((name,), OPEN_LOOP if i % 2 else MISSIONS, misjudged=i % 4 > 1)
        for i in range(4):
            pilots = OPEN_LOOP if i % 2 else MISSIONS
            yield Plan((name,), pilots, misjudged=i > 1, boat=f"light-{first + i}")


def _scale(seed: int) -> Iterator[Plan]:
    """Motors and steering of another scale: all pilots, half of the files off, light hulls."""
    for name in SCALES:
        for i in range(8):
            yield Plan((name,), OPEN_LOOP if i % 2 else MISSIONS, misjudged=i % 4 > 1)
    for i in range(4):
        boat = f"light-{LIGHT_FROM[seed] + i}"
        yield Plan(("thrust_scale",), OPEN_LOOP if i % 2 else MISSIONS, misjudged=i > 1, boat=boat)


def _arm(seed: int) -> Iterator[Plan]:
    """Motors at another distance from the centre line than in the file; as `_scale`."""
    for i in range(8):
        yield Plan(("lever_arm",), OPEN_LOOP if i % 2 else MISSIONS, misjudged=i % 4 > 1)
    for i in range(4):
        boat = f"light-{LIGHT_FROM[seed] + i}"
        yield Plan(("lever_arm",), OPEN_LOOP if i % 2 else MISSIONS, misjudged=i > 1, boat=boat)


def _play(seed: int) -> Iterator[Plan]:
    """Steering that hangs loose, or is slow; all pilots, half of the files off."""
    for name in PLAYS:
        for i in range(8):
            yield Plan((name,), OPEN_LOOP if i % 2 else MISSIONS, misjudged=i % 4 > 1)


def _once_each(names: Iterable[str]) -> list[Plan]:
    """More kinds of strangers, each open loop and on a mission."""
    return [Plan((name,), pilots) for pilots in (OPEN_LOOP, MISSIONS) for name in names]


Family = Callable[[int], Iterator[Plan] | list[Plan]]
FAMILIES: Mapping[str, Family] = {
    "excitation": lambda seed: _all(OPEN_LOOP),
    "mission": lambda seed: _all(MISSIONS),
    "weak": lambda seed: _all(OPEN_LOOP, WEAK),
    "faint": lambda seed: _all(OPEN_LOOP, FAINT)[::2],
    "base_off": _base_off,
    "pair": _pairs,
    "none": _none,
    "unknown": _unknown,
    "light": _light,
    "day": _day,
    "sea": _sea,
    "unlisted": lambda seed: _once_each(UNLISTED),
    "unheard": lambda seed: _once_each(UNHEARD),
    "unnamed": lambda seed: _once_each(UNNAMED),
    "later": _later,
    "untold": lambda seed: _once_each(UNTOLD),
    "unasked": lambda seed: _once_each(UNASKED),
    "scale": _scale,
    "arm": _arm,
    "play": _play,
}
SMALL: Mapping[str, Family] = {
    "excitation": lambda seed: _all(OPEN_LOOP)[::4],
    "mission": lambda seed: _all(MISSIONS)[1::8],
    "base_off": lambda seed: list(_base_off(seed))[4::12],
    "pair": lambda seed: _pairs(seed, 1),
    "none": lambda seed: _none(seed, 5),
    "unknown": lambda seed: list(_unknown(seed, 1))[1::3],
}
