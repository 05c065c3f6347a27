"""Where a live model is wrong: what its errors have in common, over the last minutes.

Every second has a heading, a speed, a turn and a throttle; each bin keeps how much error and how
much time fell into it, forgotten over minutes. The worst is the one with the most error beyond its
share of time, as in `where`.

When to speak up about a model that is wrong: at the start, when a cause shows, at the end.

What explains the misfit may waver from second to second. It is told when it has stayed the same
for a while, and not more often than once a minute.

What a live diagnosis found, in a sentence: m/s, degrees, N.
"""

from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import numpy as np

from sim.comparison.regimes import COMPASS
from sim.monitoring.consistency import Misfit
from sim.monitoring.disturbances import Cause, Estimator, Outlook
from sim.monitoring.live_second import Air, Moment, velocity
from sim.state import Floats, Nu

FORGET_S = 300.0
NEEDED_S = 5.0  # in a bin, before it is named
EXCESS = 0.15  # share of the error beyond the share of the time
VISITED_S = 3.0  # a heading that counts
HEADINGS = tuple(f"heading {name}" for name in COMPASS)
SPEEDS_MPS = (0.3, 0.8, 1.5, 2.5, 4.0)
SPEEDS = (
    f"slower than {SPEEDS_MPS[0]:g} m/s",
    *(f"at {a:g} to {b:g} m/s" for a, b in pairwise(SPEEDS_MPS)),
    f"faster than {SPEEDS_MPS[-1]:g} m/s",
)
SHARP_RADPS = 0.1
TURNS = ("turning to port", "going straight", "turning to starboard")
PUSHES = (-0.05, 0.05, 0.5)  # of the thrust full ahead
THROTTLES = ("with thrust astern", "without thrust", "at low throttle", "at high throttle")
PLACES = (*HEADINGS, *SPEEDS, *TURNS, *THROTTLES)
STARTS = np.cumsum([0, len(HEADINGS), len(SPEEDS), len(TURNS)])


@dataclass(frozen=True)
class ErrorByRegime:
    """error, seconds (n,) of each of `PLACES`; every second is in four of them."""

    error: Floats
    seconds: Floats

    @classmethod
    def start(cls) -> "ErrorByRegime":
        """Nothing seen yet."""
        return cls(np.zeros(len(PLACES)), np.zeros(len(PLACES)))

    def observe(self, moment: Moment, z: float, ahead: float) -> "ErrorByRegime":
        """One more second with that error; `ahead` [N] is the thrust of full throttle."""
        kept = 1.0 - 1.0 / FORGET_S
        error, seconds = kept * self.error, kept * self.seconds
        here = places_of(moment, ahead)
        error[here] += z
        seconds[here] += 1.0
        return ErrorByRegime(error, seconds)

    @property
    def headings(self) -> int:
        """How many of the eight headings were sailed."""
        return int(np.count_nonzero(self.seconds[: len(HEADINGS)] >= VISITED_S))

    @property
    def worst(self) -> str:
        """The place that holds most error beyond its time; empty where there is none."""
        total, time = self.error.sum() / 4.0, self.seconds.sum() / 4.0
        if total <= 0.0 or time <= 0.0:
            return ""
        excess = np.where(self.seconds >= NEEDED_S, self.error / total - self.seconds / time, 0.0)
        k = int(np.argmax(excess))
        return PLACES[k] if excess[k] > EXCESS else ""


def places_of(moment: Moment, ahead: float) -> list[int]:
    """Heading, speed, turn and throttle of a second, as numbers of `PLACES`."""
    nu = moment.nu
    sector = round(moment.yaw / (np.pi / 4.0)) % 8
    speed = int(np.searchsorted(SPEEDS_MPS, np.hypot(nu[Nu.U], nu[Nu.V])))
    turn = int(np.searchsorted((-SHARP_RADPS, SHARP_RADPS), nu[Nu.R]))
    push = int(np.searchsorted(PUSHES, moment.commanded[0] / ahead)) if ahead > 0.0 else 1
    return [int(start) + k for start, k in zip(STARTS, (sector, speed, turn, push), strict=True)]


HORIZONS_S = (5, 10)
STEADY_S = 15.0  # an explanation must last that long
APART_S = 60.0  # between two explanations that are told
MOVED = 0.5  # of what was told, and …
SIGMAS = 4.0  # … of the present standard deviation: it is told again
ENOUGH_S = 120  # seconds before it is said that nothing explains it
FEW = 2  # headings: on so few, water and air are not told apart


class News(Enum):
    """What became of the model."""

    WRONG = "model_wrong"
    EXPLAINED = "model_explained"
    RIGHT = "model_right"


@dataclass(frozen=True)
class Alarm:
    """Everything that a live diagnosis remembers.

    told      verdict that was told last, with what is outside (2,); when one was explained
    hinted    explanation of the last seconds, and since when
    """

    outlook: Outlook
    misfit: Misfit
    haunts: ErrorByRegime
    told: tuple[Cause, bool] = (Cause.NOTHING, False)
    outside: Floats | None = None
    told_at: float = -np.inf
    hinted: tuple[Cause, bool] = (Cause.NOTHING, False)
    hinted_at: float = -np.inf

    @classmethod
    def start(cls, estimator: Estimator) -> "Alarm":
        """Nothing seen yet."""
        return cls(estimator.start(), Misfit(), ErrorByRegime.start())

    def observe(self, estimator: Estimator, moment: Moment) -> tuple["Alarm", News | None]:
        """One more second -> what is known after it, and what there is to tell."""
        outlook, balance = estimator.observe(self.outlook, moment)
        if not np.isfinite(balance.rate).all() or not np.isfinite(outlook.boat.mean).all():
            return self.broken(), None
        misfit = self.misfit.observe(moment, balance, HORIZONS_S)
        haunts = self.haunts
        if np.isfinite(misfit.z):
            ahead = sum(t.thrust[1] for t in estimator.model.vessel.thrusters)
            haunts = haunts.observe(moment, misfit.z, ahead)
        now = replace(self, outlook=outlook, misfit=misfit, haunts=haunts)._hint(moment.time)
        if misfit.wrong != self.misfit.wrong:
            return now._told(now.told_at), News.WRONG if misfit.wrong else News.RIGHT
        if misfit.wrong and now._explains(moment.time):
            return now._told(moment.time), News.EXPLAINED
        return now, None

    def broken(self) -> "Alarm":
        """The estimate jumped or fell silent."""
        return replace(self, misfit=self.misfit.broken())

    @property
    def because(self) -> Cause:
        """The explanation, with its doubts on few headings."""
        because = self.outlook.because
        if self.few_headings and because in (Cause.CURRENT, Cause.WIND):
            return Cause.EITHER
        return because

    @property
    def few_headings(self) -> bool:
        """Too few to tell water, air and the boat itself apart."""
        return self.haunts.headings <= FEW

    @property
    def too_early(self) -> bool:
        """Is it no wonder that nothing explains it yet?"""
        return self.few_headings or self.outlook.count < ENOUGH_S

    @property
    def verdict(self) -> tuple[Cause, bool]:
        """The explanation; where there is none, also whether that means anything."""
        because = self.because
        return because, because is Cause.NOTHING and not self.too_early

    def _hint(self, time: float) -> "Alarm":
        if self.verdict == self.hinted:
            return self
        return replace(self, hinted=self.verdict, hinted_at=time)

    def _told(self, time: float) -> "Alarm":
        return replace(self, told=self.verdict, outside=self._outside(), told_at=time)

    def _explains(self, time: float) -> bool:
        """Is there another explanation, that has lasted, or has the same one moved?"""
        if time - self.hinted_at < STEADY_S or time - self.told_at < APART_S:
            return False
        return self.verdict != self.told or self._moved()

    def _outside(self) -> Floats | None:
        belief = {Cause.CURRENT: self.outlook.water, Cause.WIND: self.outlook.air}
        return belief[self.because].outside if self.because in belief else None

    def _moved(self) -> bool:
        now = self._outside()
        if now is None or self.outside is None:
            return False
        belief = self.outlook.water if self.because is Cause.CURRENT else self.outlook.air
        change, size = now - self.outside, float(np.hypot(*self.outside))
        sigmas = float(change @ np.linalg.solve(belief.spread, change))
        return sigmas > SIGMAS**2 and float(np.hypot(*change)) > MOVED * size


CHANNELS = (("ahead", "m/s", 1.0), ("sideways", "m/s", 1.0), ("in turning", "°/s", 180.0 / np.pi))


def sentence(news: News, alarm: Alarm, air: Air, since: str) -> str:
    """What there is to tell; `since` is when it began, as people say it."""
    if news is News.RIGHT:
        return f"the model is right again; it was wrong since {since}"
    where = f" when {worst}" if (worst := alarm.haunts.worst) else ""
    if where.startswith((" when at", " when with", " when slower", " when faster")):
        where = where.removeprefix(" when")
    return f"since {since} the model is wrong{where} ({_size(alarm.misfit)}): {cause(alarm, air)}"


def cause(alarm: Alarm, air: Air) -> str:
    """What explains it, as far as that can be told."""
    water, wind = alarm.outlook.water.outside, alarm.outlook.air.outside
    match alarm.because:
        case Cause.CURRENT:
            return f"looks like {current(water)}"
        case Cause.WIND:
            return f"looks like {blown(wind, air)}"
        case Cause.EITHER:
            return f"looks like current or wind ({current(water)}, or {blown(wind, air)}): " + HINT
    if alarm.too_early:
        return "too little seen so far to tell current or wind from an error of the boat's own"
    return "neither a current nor a wind explains it"


HINT = "other headings tell"


def current(outside: Floats) -> str:
    """North, east (2,) [m/s] -> speed and where it flows to."""
    return f"{np.hypot(*outside):.2g} m/s of current towards {_degrees(outside)}"


def blown(g: Floats, air: Air) -> str:
    """g of the air (2,) -> a wind and where it comes from, or a force."""
    if air.has_areas:
        return f"{np.hypot(*velocity(g)):.0f} m/s of wind from {_degrees(-g)}"
    return f"a force of {np.hypot(*g):.2g} N towards {_degrees(g)}, as of wind"


def _degrees(north_east: Floats) -> str:
    degrees = round(float(np.degrees(np.arctan2(north_east[1], north_east[0])))) % 360
    return f"{degrees:03d}°"


def _size(misfit: Misfit) -> str:
    """The worst channel's error beside its floor."""
    error, floor = misfit.errors
    k = int(np.argmax(error / np.maximum(floor, 1e-12)))
    name, unit, factor = CHANNELS[k]
    return (
        f"after {HORIZONS_S[0]} s off by {error[k] * factor:.2g} {unit} {name}, "
        f"noise explains {floor[k] * factor:.2g}"
    )
