"""When a live model becomes wrong, what explains it, when it is right again: as events, in words.

What explains the misfit may waver from second to second: it is reported when it has stayed the same
for a while, and not more often than once a minute. Where the model is wrong is told by regimes:
every second has a heading, a speed, a turn and a throttle; each bin keeps how much error and how
much time fell into it, forgotten over minutes, and the worst is the one with the most error beyond
its share of time, as in a comparison.
"""

from bisect import bisect_left
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from sim.comparison import COMPASS
from sim.monitoring import SecondMeans, WindModel, air_velocity
from sim.monitoring.begun_anew import BegunAnew, of_what_is_known, simpler
from sim.monitoring.consistency import MIN_TIMES_FLOOR, Misfit
from sim.monitoring.disturbances import (
    MIN_SCORE_BETWEEN_NATS,
    Cause,
    DisturbanceEstimate,
    DisturbanceEstimator,
    KnownCause,
)
from sim.monitoring.explanations import ALL_THRUSTERS
from sim.monitoring.filters import DisturbanceFilter
from sim.state import Floats, Nu

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
MAX_SINGLE_GAIN = 0.5  # of its thrust that one motor alone may push more than its file says
NO_THRUST_SHARE = 0.1  # of its thrust: what is left or astern of so little is none
MIN_SCORE_HELD_NATS = 4.0  # by which what was told has to beat the boat alone, to be told still
MIN_SCORE_NEAREST_NATS = 2.0  # … and what comes nearest, to be told beside that nothing stands out
FEW_HEADINGS = 2  # on so few, water and air are hard to tell apart
# Where the model is wrong
REGIME_MEMORY_S = 300.0
MIN_REGIME_S = 5.0  # in a bin, before it is named
MIN_REGIME_EXCESS = 0.15  # share of the error beyond the share of the time
MIN_HEADING_S = 3.0  # for a heading to count as sailed

SPEED_EDGES_MPS = (0.3, 0.8, 1.5, 2.5, 4.0)
TURN_EDGES_RADPS = (-0.1, 0.1)
THRUST_EDGES = (-0.05, 0.05, 0.5)  # of the thrust full ahead
HEADINGS = tuple(f"heading {name}" for name in COMPASS)
SPEEDS = (
    f"slower than {SPEED_EDGES_MPS[0]:g} m/s",
    *(f"at {a:g} to {b:g} m/s" for a, b in pairwise(SPEED_EDGES_MPS)),
    f"faster than {SPEED_EDGES_MPS[-1]:g} m/s",
)
TURNS = ("turning to port", "going straight", "turning to starboard")
THROTTLES = ("with thrust astern", "without thrust", "at low throttle", "at high throttle")
REGIMES = (*HEADINGS, *SPEEDS, *TURNS, *THROTTLES)
FIRST = (0, *accumulate(map(len, (HEADINGS, SPEEDS, TURNS))))  # regime of each kind
MAX_ERRING_MPS = 0.25
ERRING_VELOCITIES = "; a receiver or a swell whose velocities err for seconds looks so too"
ERROR_CHANNELS = (
    ("ahead", "m/s", 1.0),
    ("sideways", "m/s", 1.0),
    ("in turning", "°/s", 180.0 / np.pi),
)


@dataclass(frozen=True)
class ErrorByRegime:
    """error, seconds (n,) of each of `REGIMES`; every second is in four of them.

    sailed  (8,) seconds under way on each heading since the trouble began
    """

    error: Floats
    seconds: Floats
    sailed: Floats

    @classmethod
    def start(cls) -> "ErrorByRegime":
        """The state before the first second."""
        return cls(np.zeros(len(REGIMES)), np.zeros(len(REGIMES)), np.zeros(len(HEADINGS)))

    def observe(
        self, second: SecondMeans, z: float, ahead: float, drives: bool = True
    ) -> "ErrorByRegime":
        """One more second with that error; `ahead` [N] is the thrust of full throttle.

        `drives`: whether a motor does; adrift all headings tell the same of water and air.
        """
        kept = 1.0 - 1.0 / REGIME_MEMORY_S
        error, seconds = kept * self.error, kept * self.seconds
        here = regimes_at(second, ahead)
        error[here] += z
        seconds[here] += 1.0
        sailed = self.sailed.copy()
        sailed[here[0]] += drives
        return ErrorByRegime(error, seconds, sailed)

    def reopened(self) -> "ErrorByRegime":
        """Trouble has begun: headings that were sailed before it tell nothing of it."""
        return replace(self, sailed=np.zeros(len(HEADINGS)))

    @property
    def headings(self) -> int:
        """How many of the eight headings were sailed since the trouble began."""
        return int(np.count_nonzero(self.sailed >= MIN_HEADING_S))

    @property
    def worst(self) -> str:
        """The regime that holds most error beyond its time; empty where there is none."""
        total, time = self.error.sum() / 4.0, self.seconds.sum() / 4.0
        if total <= 0.0 or time <= 0.0:
            return ""
        excess = self.error / total - self.seconds / time
        excess = np.where(self.seconds >= MIN_REGIME_S, excess, 0.0)
        k = int(np.argmax(excess))
        return REGIMES[k] if excess[k] > MIN_REGIME_EXCESS else ""


def regimes_at(second: SecondMeans, ahead: float) -> list[int]:
    """Heading, speed, turn and throttle of a second, as numbers of `REGIMES`."""
    nu = second.nu
    heading = round(second.yaw / (np.pi / 4.0)) % 8
    speed = bisect_left(SPEED_EDGES_MPS, float(np.hypot(nu[Nu.U], nu[Nu.V])))
    turn = bisect_left(TURN_EDGES_RADPS, float(nu[Nu.R]))
    throttle = 1
    if ahead > 0.0:
        throttle = bisect_left(THRUST_EDGES, float(second.commanded[0]) / ahead)
    each = (heading, speed, turn, throttle)
    return [first + k for first, k in zip(FIRST, each, strict=True)]


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
        if now.misfit.wrong != self.misfit.wrong:
            event = ModelEvent.WRONG if now.misfit.wrong else ModelEvent.RIGHT
            return now._with_report(now.reported_at), event
        if now.misfit.wrong and now._has_news(second.time):
            return now._with_report(second.time), ModelEvent.EXPLAINED
        return now, None

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
            adrift=self.adrift if misfit.wrong else not drives,
        )  # fmt: skip
        moved_since = min(self.moved_since, second.time) if now._has_moved else np.inf
        now = replace(now, moved_since=moved_since)
        explanation = now.cause, now.cause is Cause.NOTHING and not now.too_early
        if explanation == self.explanation:
            return now
        return replace(now, explanation=explanation, explanation_since=second.time)

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
        return replace(self, misfit=self.misfit.after_gap(), before=(), anew=())

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
        if kind in DOUBTS or not np.isfinite(score):  # not finite: a drag that drives by now
            return False
        best = estimate.best(kind)
        return best.score - estimate.boat.score >= MIN_SCORE_HELD_NATS and best.significant

    @cached_property
    def likely(self) -> tuple[Cause, ...]:
        """Causes that explain it about as well as the best."""
        return self.estimate.likely_on(self.few_headings)

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


def event_text(event: ModelEvent, alarm: Alarm, air: WindModel, since: str) -> str:
    """An event in one sentence; `since` is when it began, as people say it."""
    if event is ModelEvent.RIGHT:
        return f"the model is right again; it was wrong since {since}"
    where = f" when {worst}" if (worst := alarm.errors.worst) else ""
    if where.startswith((" when at", " when with", " when slower", " when faster")):
        where = where.removeprefix(" when")
    size, cause = _error_text(alarm.misfit), _cause_text(alarm, air)
    return f"since {since} the model is wrong{where} ({size}): {cause}"


def _cause_text(alarm: Alarm, air: WindModel) -> str:
    """What explains it, as far as that can be told."""
    estimate = alarm.told_by
    known = " and ".join(_kind_text(one.cause, one.estimate, air) for one in alarm.beside)
    if known:
        return f"{_cause_alone_text(alarm, estimate, air)}, beside {known}"
    return _cause_alone_text(alarm, estimate, air)


def _cause_alone_text(alarm: Alarm, estimate: DisturbanceEstimate, air: WindModel) -> str:
    """The same without what holds beside it."""
    current, wind = (_kind_text(kind, estimate, air) for kind in (Cause.CURRENT, Cause.WIND))
    match alarm.cause:
        case Cause.EITHER:
            tell = "what she does under way tells" if estimate.is_adrift else "other headings tell"
            return f"looks like current or wind ({current}, or {wind}): {tell}"
        case Cause.SEVERAL:
            several = " or ".join(_kind_text(kind, estimate, air) for kind in alarm.likely)
            return f"looks like {several}: turns, other headings and speeds tell"
        case Cause.NOTHING if alarm.too_early:
            return "too little seen so far to tell what it looks like"
        case Cause.NOTHING:
            nearest = _nearest_text(estimate, air)
            may_be_erring = ERRING_VELOCITIES if _may_be_erring(alarm.misfit) else ""
            return f"no one cause stands out{nearest}{may_be_erring}"
        case Cause.OTHER:
            return "none of current, wind, thrusters, compass and drag explains it"
    return f"looks like {_kind_text(alarm.cause, estimate, air)}"


def _nearest_text(estimate: DisturbanceEstimate, air: WindModel) -> str:
    """What explains it best where nothing is clearly more than nothing, if anything is."""
    named = [(score, kind) for score, kind, _ in estimate.named if kind is not Cause.OTHER]
    score, kind = named[0]
    clear = score - float(estimate.boat.score) >= MIN_SCORE_NEAREST_NATS
    if not clear or not estimate.best(kind).significant:
        return ""
    return f", nearest comes {_kind_text(kind, estimate, air)}"


def _kind_text(kind: Cause, estimate: DisturbanceEstimate, air: WindModel) -> str:
    """One explanation with its size."""
    best = estimate.best(kind)
    size = float(best.disturbance[0])
    match kind:
        case Cause.CURRENT:
            return current_text(best.disturbance)
        case Cause.WIND:
            return wind_text(best.disturbance, air)
        case Cause.THRUST:
            return _thrust_text(estimate)
        case Cause.COMPASS:
            side = "starboard" if size > 0.0 else "port"
            return f"the compass reading {abs(np.degrees(size)):.0f}° too far to {side}"
        case Cause.DRAG:
            return f"{_percent(size)} drag ahead"
    return "something else"


def _percent(share: float) -> str:
    """−0.45 -> "45 % less"."""
    return f"{abs(100.0 * share):.0f} % {'less' if share < 0.0 else 'more'}"


def _given(share: float) -> str:
    """Share of its thrust that a thruster gives more or less, in words; none gives less than
    nothing, but it may push astern.
    """
    if share < -1.0 - NO_THRUST_SHARE:
        return "pushing the other way"
    if share < -1.0 + NO_THRUST_SHARE:
        return "giving no thrust"
    return f"giving {_percent(share)} thrust"


def _thrust_text(estimate: DisturbanceEstimate) -> str:
    """The thruster that explains it best, and those that do so about as well; or all of them, where
    they do, or where one alone would have to push much more than its file says.
    """
    names = estimate.all.names
    ranked = [(score, f) for score, kind, f in estimate.named if kind is Cause.THRUST]
    near = [f for score, f in ranked if ranked[0][0] - score < MIN_SCORE_BETWEEN_NATS]
    share = {f: float(estimate.filter(f).disturbance[0]) for _, f in ranked}
    single = [f for f in near if names[f] != ALL_THRUSTERS]
    whole = next((f for _, f in ranked if names[f] == ALL_THRUSTERS), None)
    if single and whole is not None and share[single[0]] > MAX_SINGLE_GAIN:
        behind = float(estimate.scores[single[0]] - estimate.scores[whole])
        if behind < MIN_SCORE_BETWEEN_NATS and estimate.filter(whole).significant:
            near, single = [whole], []
    texts = []
    if single:
        which = " or ".join(names[f] for f in single)
        texts.append(f"thruster {which} {_given(share[single[0]])}")
    if whole in near:
        texts.append(f"all thrusters {_given(share[whole])}")
    return " or ".join(texts if near[0] != whole else reversed(texts))


def current_text(current: Floats) -> str:
    """North, east (2,) [m/s] -> speed and where it flows to."""
    return f"{np.hypot(*current):.2g} m/s of current towards {_bearing(current)}"


def wind_text(g: Floats, air: WindModel) -> str:
    """g of the air (2,) -> a wind and where it comes from, or its force on a boat across it."""
    if air.has_areas:
        return f"{np.hypot(*air_velocity(g)):.0f} m/s of wind from {_bearing(-g)}"
    force = float(f"{air.force_abeam(g):.2g}")
    return f"wind from {_bearing(-g)} that pushes with {force:g} N abeam"


def _bearing(north_east: Floats) -> str:
    degrees = round(float(np.degrees(np.arctan2(north_east[1], north_east[0])))) % 360
    return f"{degrees:03d}°"


def _worst_channel(misfit: Misfit) -> int:
    """Of u, v, r: the one whose error is largest beside its floor."""
    error, floor = misfit.errors
    return int(np.argmax(error / np.maximum(floor, 1e-12)))


def _may_be_erring(misfit: Misfit) -> bool:
    """Whether velocities are off most, and by no more than a receiver or a swell may make."""
    k = _worst_channel(misfit)
    return k < len(ERROR_CHANNELS) - 1 and bool(misfit.errors[0][k] < MAX_ERRING_MPS)


def _error_text(misfit: Misfit) -> str:
    """The worst channel's error beside its floor."""
    (error, floor), k = misfit.errors, _worst_channel(misfit)
    if error[k] ** 2 <= MIN_TIMES_FLOOR * floor[k] ** 2:  # it was more when it was called wrong
        return "of late hardly further off than noise explains"
    name, unit, factor = ERROR_CHANNELS[k]
    return (
        f"after {WATCHED_HORIZONS_S[0]} s off by {error[k] * factor:.2g} {unit} {name}, "
        f"noise explains {floor[k] * factor:.2g}"
    )
