"""When to speak up about a model that is wrong: at the start, when a cause shows, at the end.

What explains the misfit may waver from second to second. It is told when it has stayed the same
for a while, and not more often than once a minute.
"""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from sim.diagnosis.haunts import Haunts
from sim.diagnosis.misfit import Misfit
from sim.diagnosis.moment import Moment
from sim.diagnosis.online import Because, Estimator, Outlook
from sim.state import Floats

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
    haunts: Haunts
    told: tuple[Because, bool] = (Because.NOTHING, False)
    outside: Floats | None = None
    told_at: float = -np.inf
    hinted: tuple[Because, bool] = (Because.NOTHING, False)
    hinted_at: float = -np.inf

    @classmethod
    def start(cls, estimator: Estimator) -> "Alarm":
        """Nothing seen yet."""
        return cls(estimator.start(), Misfit(), Haunts.start())

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
    def because(self) -> Because:
        """The explanation, with its doubts on few headings."""
        because = self.outlook.because
        if self.few_headings and because in (Because.CURRENT, Because.WIND):
            return Because.EITHER
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
    def verdict(self) -> tuple[Because, bool]:
        """The explanation; where there is none, also whether that means anything."""
        because = self.because
        return because, because is Because.NOTHING and not self.too_early

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
        belief = {Because.CURRENT: self.outlook.water, Because.WIND: self.outlook.air}
        return belief[self.because].outside if self.because in belief else None

    def _moved(self) -> bool:
        now = self._outside()
        if now is None or self.outside is None:
            return False
        belief = self.outlook.water if self.because is Because.CURRENT else self.outlook.air
        change, size = now - self.outside, float(np.hypot(*self.outside))
        sigmas = float(change @ np.linalg.solve(belief.spread, change))
        return sigmas > SIGMAS**2 and float(np.hypot(*change)) > MOVED * size
