"""Whether what was told still holds while a model stays wrong: explanations begun anew beside it.

A filter that has followed one cause for minutes takes long to give it up: a drag that begins as a
current ends was called a current for five minutes. While the trouble lasts all explanations begin
anew every `LASTS_S`, with the boat's own errors as they were before it: of all that is missing, and
of what is left beside the causes that were told. They take over where one of them has predicted the
seconds since then better than the best of those that go on by `MIN_SCORE_ANEW_NATS`, and in place
of causes that stand beside one another where fewer of them do as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sim.monitoring import SecondMeans
from sim.monitoring.disturbances import (
    MAX_SILENCE_S,
    Cause,
    DisturbanceEstimate,
    DisturbanceEstimator,
    KnownCause,
)
from sim.monitoring.filters import SCORE_MEMORY_S
from sim.state import Floats

# Chosen on the tuning voyages of benchmarks/live_naming.py and on changes of cause of another
# generator; what they give on others: benchmarks/results/live_naming.md.
LASTS_S = 30.0
MIN_SCORE_ANEW_NATS = 12.0
SOON_S, SOON_FACTOR = 120.0, 2.0  # that much more is asked, so soon after the last time
MAX_SCORE_SIMPLER_NATS = 2.0  # by which fewer causes may predict worse, to take over
MIN_DRIVEN_S = 20  # … with a motor that drives
MAX_KNOWN = 2  # causes beside which another one is looked for


@dataclass(frozen=True)
class BegunAnew:
    """Explanations begun anew, and the score of those that go on over the same seconds [nats].

    may_be_over  a cause was told: that nothing is wrong any more is an explanation too
    noise        (3,) variance of e of those that go on, when these began
    """

    estimate: DisturbanceEstimate
    may_be_over: bool
    noise: Floats
    goes_on: float = 0.0

    @property
    def is_over(self) -> bool:
        """Whether they had their time."""
        return self.estimate.time - self.estimate.opened > LASTS_S

    @property
    def gain(self) -> float:
        """By how much they predict better [nats]."""
        estimate = self.estimate
        score, cause, _ = estimate.named[0]
        named = -np.inf if cause is Cause.OTHER else score
        nothing = estimate.boat.score if self.may_be_over else -np.inf
        return float(max(named, nothing)) - self.goes_on

    def is_better(self, since_last_s: float) -> bool:
        """Whether they take over, so long after others did: what changes often is no cause."""
        soon = since_last_s < SOON_S
        return self.gain >= MIN_SCORE_ANEW_NATS * (SOON_FACTOR if soon else 1.0)

    @property
    def fewest(self) -> int:
        """Causes that it takes to predict as well as those that go on do: what is known, and one
        more where nothing beside it does not.
        """
        as_well = self.estimate.boat.score - self.goes_on > -MAX_SCORE_SIMPLER_NATS
        return len(self.estimate.beside) + (not as_well)

    @property
    def is_as_good(self) -> bool:
        """Whether they predict as well, over time in which a motor drove."""
        driven = self.estimate.driven >= MIN_DRIVEN_S
        return driven and self.is_over and self.gain > -MAX_SCORE_SIMPLER_NATS

    def followed(
        self, estimator: DisturbanceEstimator, second: SecondMeans, before: DisturbanceEstimate,
        after: DisturbanceEstimate,
    ) -> "BegunAnew":  # fmt: skip
        """One more second; before, after: the explanations that go on."""
        estimate, _ = estimator.observe(self.estimate, second)
        best = int(np.argmax(after.scores))
        kept = np.exp(-min(after.time - before.time, MAX_SILENCE_S) / SCORE_MEMORY_S)
        gained = float(after.scores[best] - kept * before.scores[best])
        return replace(self, estimate=estimate, goes_on=kept * self.goes_on + gained)


def simpler(
    anew: Sequence[BegunAnew], now: DisturbanceEstimate, told: bool
) -> DisturbanceEstimate | None:
    """Fewer causes that predict as well as those told beside one another; None where none do.

    Without it two causes that oppose one another stay for good: a drag, and motors that make up for
    it. told: whether there is one beside what is known.
    """
    if not now.beside:
        return None
    fewer = [one for one in anew if one.is_as_good and one.fewest < len(now.beside) + told]
    if not fewer:
        return None
    return min(fewer, key=lambda one: (one.fewest, -one.gain)).estimate


def of_what_is_known(
    estimator: DisturbanceEstimator, calm: DisturbanceEstimate, now: DisturbanceEstimate,
    known: Sequence[KnownCause], noise: Floats,
) -> tuple[BegunAnew, ...]:  # fmt: skip
    """Explanations begun anew beside all that is known, all but one of it, and nothing.

    calm   before the trouble: what the boat's own errors were
    noise  (3,) variance of e when they last began anew: where something new sets in, what goes on
           takes it for noise
    """
    known = tuple(known)[-MAX_KNOWN:]
    sizes = range(len(known) + 1) if len(known) <= 1 else (0, len(known) - 1, len(known))
    sets = (each for size in sizes for each in combinations(known, size))
    started = replace(calm, time=now.time, noise=np.minimum(now.noise, noise))
    return tuple(
        BegunAnew(estimator.reopened(started, now.time, each), len(known) > 0, now.noise)
        for each in sets
    )
