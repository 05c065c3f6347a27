"""When a live model becomes wrong, what explains it, when it is right again: as events.

What explains the misfit may waver from second to second: it is reported when it has stayed the same
for a while, and not more often than once a minute. `sim.monitoring.sentences` has the words,
`sim.monitoring.regimes` where it is wrong.
"""

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np

from sim.monitoring import SecondMeans
from sim.monitoring.accounting import error_falls
from sim.monitoring.begun_anew import BegunAnew, of_what_is_known, simpler
from sim.monitoring.consistency import Misfit
from sim.monitoring.disturbances import (
    Cause,
    DisturbanceEstimate,
    DisturbanceEstimator,
    KnownCause,
)
from sim.monitoring.filters import DisturbanceFilter
from sim.monitoring.regimes import ErrorByRegime
from sim.state import Floats

# Chosen on the tuning voyages of benchmarks/live_naming.py; what they give on others:
# benchmarks/results/live_naming.md.
WATCHED_HORIZONS_S = (5, 10)  # of the predictions that are compared
ONSET_S = WATCHED_HORIZONS_S[0]  # the first prediction that ends badly began so long ago
STEADY_S = 6.0  # an explanation must last that long
MIN_INTERVAL_S = 60.0  # between two explanations that are reported
MIN_DOUBT_INTERVAL_S = 10.0  # the same after one that left it open
DOUBTS = (Cause.NOTHING, Cause.EITHER, Cause.SEVERAL, Cause.OTHER)
MIN_CHANGE = 0.5  # of the disturbance that was reported, and …
MIN_CHANGE_SIGMAS = 4.0  # … of its present standard deviation: it is reported again
MIN_ADRIFT_S = 30.0  # of trouble before the motors drive
MOVED_S = 20.0  # another size must last that long: perhaps another cause begins
MAX_GAIN_MOVED_NATS = 2.0  # of explanations begun anew, for what was told to change meanwhile
MIN_TROUBLE_S = 12.0  # since it set in, before any explanation of it
MIN_SECONDS = 150  # before it is said that nothing explains it
MIN_SCORE_HELD_NATS = 4.0  # by which what was told has to beat the boat alone, to be told still
JUDGED_S = 25  # seconds whose errors have to fall with a cause, for it to be told …
RETRY_S = 20.0  # … or it is looked at again after so long
FEW_HEADINGS = 2  # on so few, water and air are hard to tell apart


class ModelEvent(Enum):
    """What became of the model."""

    WRONG = "model_wrong"
    EXPLAINED = "model_explained"
    RIGHT = "model_right"


UNTOLD = (Cause.NOTHING, False)  # nothing explains it yet, and it is too early to say so


@dataclass(frozen=True)
class Alarm:
    """State of the live diagnosis.

    explanation  of the last seconds, and since when it has been the same
    reported     explanation that was reported last, its disturbance (2,), the estimate it was of,
                 and when one was
    before       the last seconds, `ONSET_S` and one, oldest first, each with the estimate before it
    adrift       the motors rest, or did when the model was last right: what was wrong of a boat
                 under way is not right again because her motors rest
    resting      the motors rest now
    calm         the estimate before the trouble
    anew         explanations begun anew while the trouble lasts: whether what was told still holds
    turned_at    when explanations begun anew took over [s]
    moved_since  since when the size of what was told has been another one [s]
    told_beside  what was told beside the explanation that was reported last
    judged       the last seconds, oldest first, with whose errors a cause has to do
    refused      causes with which the error does not fall, and when that was seen
    """

    estimate: DisturbanceEstimate
    misfit: Misfit
    errors: ErrorByRegime
    explanation: tuple[Cause, bool] = UNTOLD
    explanation_since: float = -np.inf
    reported: tuple[Cause, bool] = UNTOLD
    reported_disturbance: Floats | None = None
    reported_by: DisturbanceEstimate | None = None
    reported_at: float = -np.inf
    before: tuple[tuple[DisturbanceEstimate, SecondMeans], ...] = ()
    adrift: bool = False
    resting: bool = False
    calm: DisturbanceEstimate | None = None
    anew: tuple[BegunAnew, ...] = ()
    turned_at: float = -np.inf
    moved_since: float = np.inf
    told_beside: tuple[Cause, ...] = ()
    judged: tuple[SecondMeans, ...] = ()
    refused: tuple[frozenset[Cause], float] = (frozenset(), -np.inf)

    @classmethod
    def start(cls, estimator: DisturbanceEstimator) -> "Alarm":
        """The state before the first second."""
        return cls(estimator.start(), Misfit(), ErrorByRegime.start())

    def observe(
        self, estimator: DisturbanceEstimator, second: SecondMeans
    ) -> tuple["Alarm", ModelEvent | None]:
        """One more second -> the state after it, and what there is to report.

        A second at which the estimate is no finite number, or the model cannot be solved for an
        acceleration, counts as a gap.
        """
        try:
            now = self._after(estimator, second)
        except np.linalg.LinAlgError:
            now = None
        if now is None:
            return self.after_gap(), None
        changes = now.misfit.wrong != self.misfit.wrong
        if not (changes or (now.misfit.wrong and now._has_news(second.time))):
            return now, None
        if changes and not now.misfit.wrong:
            return now._with_report(now.reported_at), ModelEvent.RIGHT
        if refused := now._without_effect(estimator):
            now = now._refusing(refused, second.time)
            if not changes:
                return now, None
        told_at = now.reported_at if changes else second.time
        event = ModelEvent.WRONG if changes else ModelEvent.EXPLAINED
        return now._with_report(told_at), event

    def _without_effect(self, estimator: DisturbanceEstimator) -> frozenset[Cause]:
        """The causes that would be told, where the error falls with none of them."""
        several = self.cause in (Cause.EITHER, Cause.SEVERAL)
        kinds = frozenset(self.likely if several else (self.cause,)) - {Cause.NOTHING, Cause.OTHER}
        estimate, channel = self.told_by, self.misfit.worst_channel
        falls = any(
            error_falls(estimator, estimate, estimate.number_of(kind), self.judged, channel)
            for kind in kinds
        )
        return frozenset() if falls else kinds

    def _refusing(self, kinds: frozenset[Cause], time: float) -> "Alarm":
        """The same with explanations that are none for now."""
        now = replace(self, refused=(kinds, time))
        return replace(now, explanation=now._explanation, explanation_since=time)

    @property
    def _refused(self) -> frozenset[Cause]:
        kinds, at = self.refused
        return kinds if self.estimate.time - at < RETRY_S else frozenset()

    @property
    def _explanation(self) -> tuple[Cause, bool]:
        return self.cause, self.cause is Cause.NOTHING and not self.too_early

    def _after(self, estimator: DisturbanceEstimator, second: SecondMeans) -> "Alarm | None":
        """The state after one more second; None where it holds no finite numbers."""
        estimate, balance = estimator.observe(self.estimate, second)
        before = (*self.before, (self.estimate, second))[-ONSET_S - 1 :]
        if not (estimate.finite and np.isfinite(balance.system_matrix).all()):
            return None
        drives = estimator.drives(second)
        clears = drives or self.adrift or not self.misfit.wrong
        misfit = self.misfit.observe(second, balance, WATCHED_HORIZONS_S, clears)
        errors = self.errors
        if np.isfinite(misfit.z):
            ahead = sum(t.thrust[1] for t in estimator.model.vessel.thrusters)
            errors = errors.observe(second, misfit.z, ahead, drives)
        calm, anew = self.calm, self._followed_anew(estimator, second, estimate)
        if not np.isfinite(misfit.since):
            calm, anew = None, ()
            if estimate.beside:  # what was told beside another cause is over with it
                estimate = replace(self.calm or estimate, time=estimate.time, beside=())
        elif not np.isfinite(self.misfit.since):
            calm, anew = before[0][0], ()
            estimate, errors = _since_onset(estimator, before), errors.reopened()
        elif self.estimate.is_adrift and not estimate.is_adrift and self.was_adrift:
            begun = estimator.reopened(self.calm or estimate, second.time)
            estimate, anew = replace(begun, time=second.time, driven=estimate.driven), ()
            errors = errors.reopened()
        turned_at, last_s = self.turned_at, second.time - self.turned_at
        if better := next((one for one in anew if one.is_better(last_s)), None):
            estimate, anew, errors = better.estimate, (), errors.reopened()
            turned_at = second.time
        elif fewer := simpler(anew, estimate, self.cause not in DOUBTS and not self._only_known):
            estimate, anew, errors = fewer, (), errors.reopened()
            turned_at = second.time
        now = replace(
            self, estimate=estimate, misfit=misfit, errors=errors, before=before, calm=calm,
            anew=anew, turned_at=turned_at, resting=not drives,
            judged=(*self.judged, second)[-JUDGED_S:],
            adrift=self.adrift if misfit.wrong else not drives,
        )  # fmt: skip
        moved_since = min(self.moved_since, second.time) if now._has_moved else np.inf
        now = replace(now, moved_since=moved_since)
        if now._explanation == self.explanation:
            return now
        return replace(now, explanation=now._explanation, explanation_since=second.time)

    def _followed_anew(
        self, estimator: DisturbanceEstimator, second: SecondMeans, after: DisturbanceEstimate
    ) -> tuple[BegunAnew, ...]:
        """Explanations begun anew, over one more second; the best first.

        They begin where the estimate `after` that second is, with what is known: the cause that was
        told last, and those beside it.
        """
        if not self.misfit.wrong or self.calm is None:
            return ()
        if not self.anew or self.anew[0].is_over:
            told, known = self.reported[0], after.beside
            if told not in DOUBTS and told not in {one.cause for one in known}:
                known = (*known, KnownCause(told, self.reported_by or after))
            noise = self.anew[0].noise if self.anew else after.noise
            return of_what_is_known(estimator, self.calm, after, known, noise)
        followed = (one.followed(estimator, second, self.estimate, after) for one in self.anew)
        return tuple(sorted(followed, key=lambda one: -one.gain))

    def after_gap(self) -> "Alarm":
        """The estimate jumped or fell silent."""
        return replace(self, misfit=self.misfit.after_gap(), before=(), anew=(), judged=())

    def rebooted(self) -> "Alarm":
        """The boat's sensors began anew: what was wrong until then may have been theirs."""
        return replace(
            self.after_gap(), misfit=Misfit(), adrift=False, calm=None, explanation=UNTOLD,
            explanation_since=-np.inf, reported=UNTOLD, reported_disturbance=None, told_beside=(),
        )  # fmt: skip

    @cached_property
    def cause(self) -> Cause:
        """What explains the missing force, with its doubts; nothing while the model is right."""
        if not np.isfinite(self.misfit.since) or self.just_begun:
            return Cause.NOTHING
        found = self.estimate.cause_of(self.likely)
        if found is Cause.NOTHING and self._is_held:
            return self.reported[0]
        if found is Cause.NOTHING and self.estimate.beside:
            return self.estimate.beside[-1].cause
        # What grows over seconds looks like a wandering force until it has grown.
        return Cause.NOTHING if found is Cause.OTHER and self.too_young else found

    @property
    def _is_held(self) -> bool:
        """Whether what was told still does better than nothing: evidence fades, and what the boat's
        own errors learn meanwhile takes a part of it.
        """
        kind, estimate = self.reported[0], self.estimate
        score = next((score for score, each, _ in estimate.named if each is kind), -np.inf)
        if kind in (*DOUBTS, *self._refused) or not np.isfinite(
            score
        ):  # not finite: a drag that drives by now
            return False
        best = estimate.best(kind)
        return best.score - estimate.boat.score >= MIN_SCORE_HELD_NATS and best.significant

    @cached_property
    def likely(self) -> tuple[Cause, ...]:
        """Causes that explain it about as well as the best, and with which the error falls."""
        likely = self.estimate.likely_on(self.few_headings)
        left = tuple(kind for kind in likely if kind not in self._refused)
        return left if left or not likely else (Cause.OTHER,)

    @cached_property
    def few_headings(self) -> bool:
        """Whether water and air are hard to tell apart on so few."""
        return self.errors.headings <= FEW_HEADINGS

    @property
    def too_early(self) -> bool:
        """Whether it means nothing yet that nothing explains it."""
        return self.few_headings or self.too_young

    @property
    def too_young(self) -> bool:
        """Whether too little of the trouble was seen to say that nothing explains it."""
        return min(self.estimate.count, self.estimate.time - self.estimate.opened) < MIN_SECONDS

    @property
    def just_begun(self) -> bool:
        """Whether the trouble is too young for any explanation."""
        return self.estimate.time - self.estimate.opened < MIN_TROUBLE_S

    @property
    def was_adrift(self) -> bool:
        """Whether the motors have rested for most of the trouble: what explains it is judged anew
        once they drive, for a boat adrift goes with water and air alike.
        """
        return self.estimate.time - self.estimate.opened > MIN_ADRIFT_S

    @property
    def _filter(self) -> DisturbanceFilter | None:
        """The filter of the explanation, where there is one."""
        if self.cause in DOUBTS:
            return None
        return self.told_by.best(self.cause)

    @property
    def told_by(self) -> DisturbanceEstimate:
        """The estimate that has the size of the cause."""
        for one in self.estimate.beside:
            if one.cause is self.cause:
                return one.estimate
        return self.estimate

    @property
    def _only_known(self) -> bool:
        """Whether the cause is one of those that are taken as known."""
        return any(one.cause is self.cause for one in self.estimate.beside)

    @property
    def beside(self) -> tuple[KnownCause, ...]:
        """What holds beside the cause."""
        return tuple(one for one in self.estimate.beside if one.cause is not self.cause)

    def _with_report(self, time: float) -> "Alarm":
        disturbance = None if self._filter is None else self._filter.disturbance
        return replace(
            self, reported=self.explanation, reported_disturbance=disturbance, reported_at=time,
            reported_by=self.told_by,
            told_beside=tuple(one.cause for one in self.beside),
        )  # fmt: skip

    def _has_news(self, time: float) -> bool:
        """Whether there is another explanation that has lasted, or the same one has moved."""
        definite = self.reported[0] not in DOUBTS
        holds = definite and self.turned_at < self.reported_at
        interval = MIN_INTERVAL_S if holds else MIN_DOUBT_INTERVAL_S
        if time - self.explanation_since < STEADY_S or time - self.reported_at < interval:
            return False
        if self.explanation == UNTOLD and self.reported[0] is not Cause.NOTHING:
            return False  # what was told stays: the same water seen for longer is no less seen
        nothing = self.explanation[0] is Cause.NOTHING
        if nothing and definite and self.resting and not self.adrift:
            return False  # a motor that rests shows no fault
        if nothing and definite and (self._is_changing or self.misfit.ends):
            return False  # what was told may be over: then the model is right again in a moment
        beside = tuple(one.cause for one in self.beside)
        moved = time - self.moved_since >= MOVED_S
        return self.explanation != self.reported or beside != self.told_beside or moved

    @property
    def _is_changing(self) -> bool:
        """Whether explanations begun anew do a little better, though not enough to take over."""
        return any(one.gain > MAX_GAIN_MOVED_NATS for one in self.anew)

    @property
    def _has_moved(self) -> bool:
        """Whether what was told has another size by now, and nothing else may be there instead."""
        now, before = self._filter, self.reported_disturbance
        if now is None or before is None or self.cause is not self.reported[0]:
            return False
        change, size = now.disturbance - before, float(np.linalg.norm(before))
        far = now.squared_distance(before) > MIN_CHANGE_SIGMAS**2
        if self._is_changing:
            return False
        return far and float(np.linalg.norm(change)) > MIN_CHANGE * size


def _since_onset(
    estimator: DisturbanceEstimator, seconds: tuple[tuple[DisturbanceEstimate, SecondMeans], ...]
) -> DisturbanceEstimate:
    """The explanations, begun anew before one of those seconds, after all of them.

    Predictions that end badly tell late of what set in on their way: meanwhile the boat's own
    errors have learnt some of it, and what it did first is the best evidence of all. It set in
    where the boat alone until then, and the best explanation from then on, predict best.
    """
    candidates = []
    for k, (before, first) in enumerate(seconds):
        estimate = estimator.reopened(before, first.time)
        for _, second in seconds[k:]:
            estimate, _ = estimator.observe(estimate, second)
        candidates.append((float(before.boat.score + estimate.scores.max()), estimate))
    return max(candidates, key=lambda one: one[0])[1]
