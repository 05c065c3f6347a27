"""What the vessel's model lacks while the boat moves: rows of the path in, topics and events out.

    rows → means over a second → estimates of current and wind, misfit → topic rows, events

Once a second, whatever the rate of the estimates; the means are sums in the order of the rows, so
that chunks make no difference. A second with a jump, without telemetry or with data unfit to judge
by is left out.

With `--adapt` the vessel's numbers are followed too: the topic `parameters`. `--adapt apply` also
gives them to the shadow: to what predicts while the link is down, and to the plant where the vessel
itself is the plant. The vessel file is never changed, and what the residuals and the model's events
are about stays the vessel as it was given.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.json_rows import TopicRows, encode_rows
from gateway.shadow.path import ShadowPath, ShadowRows
from gateway.shadow.sensor_checks import clock_text
from gateway.shadow.topic_rows import EventRow
from gateway.topics import HORIZONS_S
from sim.model import Model
from sim.monitoring import SecondMeans
from sim.monitoring.alarm import WATCHED_HORIZONS_S, Alarm, ModelEvent
from sim.monitoring.disturbances import AIR, WATER, DisturbanceEstimator
from sim.monitoring.recursive import SIGMAS_95, NumberEstimates, NumberFollower, with_shares
from sim.monitoring.sentences import event_text
from sim.state import Eta, Floats, Ints

APPLY_EVERY_NS = 10_000_000_000  # at whole multiples of this receipt the shadow takes over …
APPLY_STEP = 0.05  # … and no number moves by more than this at a time
MIN_APPLIED = 0.01  # change of a share that is worth it


class Adapt(StrEnum):
    """Use of the numbers that are estimated while sailing."""

    OFF = "off"
    WATCH = "watch"
    APPLY = "apply"


@dataclass(frozen=True)
class Adaptation:
    """The numbers so far, and the shares that the shadow uses (n,)."""

    follower: NumberFollower
    estimates: NumberEstimates
    applied: Floats = field(default_factory=lambda: np.zeros(0))
    applied_at: int = 0  # the last multiple of `APPLY_EVERY_NS` at which that was looked at

    @classmethod
    def of(cls, model: Model) -> "Adaptation":
        """Before the first second."""
        follower = NumberFollower.of(model)
        return cls(follower, follower.start(), np.zeros(len(follower.numbers)))

    def observe(
        self, out: ShadowRows, k: int, second: SecondMeans
    ) -> tuple["Adaptation", TopicRows, list[EventRow]]:
        """A second that ended before row k -> the numbers after it, messages and events."""
        after = replace(self, estimates=self.follower.observe(self.estimates, second))
        turned = np.flatnonzero(after.estimates.left != self.estimates.left)
        events = [after._event(out, k, int(i)) for i in turned]
        events += after._inseparable(out, k, self.estimates.told_with)
        return after, after._topic_rows(out, k), events

    def taken_over(self, path: ShadowPath, receive_time_ns: int) -> tuple["Adaptation", ShadowPath]:
        """The path for what is received from then on: now and then the shadow's numbers move
        towards those that are valid, a little at a time.

        `path` is the one in use; what it does otherwise, and its residuals, stay as they are.
        """
        at = receive_time_ns // APPLY_EVERY_NS
        if at == self.applied_at:
            return self, path
        now = self.estimates
        wanted = np.where(now.valid, now.shares, self.applied)
        step = np.clip(wanted - self.applied, -APPLY_STEP, APPLY_STEP)
        step = np.where(np.abs(step) >= MIN_APPLIED, step, 0.0)
        after = replace(self, applied=self.applied + step, applied_at=at)
        if not step.any():
            return after, path
        names = (number.name for number in self.follower.numbers)
        shares = dict(zip(names, after.applied.tolist(), strict=True))
        return after, path.with_numbers_of(with_shares(path.model.vessel, shares))

    def _topic_rows(self, out: ShadowRows, k: int) -> TopicRows:
        """One message for each number."""
        now, n = self.estimates, len(self.follower.numbers)
        vehicle, receive = (np.repeat(t[k], n) for t in (out.vehicle_time_ns, out.receive_time_ns))
        value, reach = 1.0 + now.shares, SIGMAS_95 * now.std
        columns = (value, now.std, value - reach, value + reach, 1.0 + self.applied, now.excited_s)
        text = {
            "name": [number.name for number in self.follower.numbers],
            "excited": np.where(now.excited, "yes", "no").tolist(),
            "valid": np.where(now.valid, "yes", "no").tolist(),
        }
        return encode_rows("parameters", vehicle, receive, np.column_stack(columns), text)

    def _event(self, out: ShadowRows, k: int, i: int) -> EventRow:
        """A number has left what the vessel file says, or is back."""
        now, name = self.estimates, self.follower.numbers[i].name
        share, reach = 100.0 * float(now.shares[i]), 100.0 * SIGMAS_95 * float(now.std[i])
        what = _in_words(name)
        if not now.left[i]:
            return EventRow.at(
                out, k, "parameter_usual", "info", f"{what} is again as in the vessel file"
            )
        size = f"{abs(share):.0f} % {'less' if share < 0.0 else 'more'} than in the vessel file"
        ends = sorted((abs(share - reach), abs(share + reach)))
        text = f"{what} is {size} (95 %: {ends[0]:.0f} to {ends[1]:.0f} %)"
        return EventRow.at(out, k, "parameter_changed", "warning", text)

    def _inseparable(self, out: ShadowRows, k: int, before: Ints) -> list[EventRow]:
        """Numbers that turned out to be told only together with another: each pair once."""
        now, names = self.estimates.told_with, [_in_words(n.name) for n in self.follower.numbers]
        rows = []
        for i in np.flatnonzero((now >= 0) & (before < 0)):
            other = int(now[i])
            if now[other] == i and (before[other] >= 0 or other < i):
                continue
            text = (
                f"{names[i]} is told only together with {names[other]}: this motion does not "
                "tell them apart"
            )
            rows.append(EventRow.at(out, k, "parameter_inseparable", "info", text))
        return rows


def _in_words(name: str) -> str:
    """A followed number as people say it."""
    return f"the thrust of {name[7:]}" if name.startswith("thrust ") else f"the {name}"


JUDGED_ANEW = "what was wrong before the reboot is judged anew: it may have been its sensors"
SECOND_S = 1.0
DOUBTFUL_S = 4  # seconds before a fault of the data is noticed, see `sensor_checks`
MAX_STEP_S = 0.6  # between rows: a longer step leaves part of the second unknown
FIRST_S = 30  # seconds before anything is published
SEVERITY = {ModelEvent.WRONG: "warning", ModelEvent.EXPLAINED: "warning", ModelEvent.RIGHT: "info"}
# columns of the prediction errors that the monitor reads: of one second, then of those watched
ERRORS = [3 * HORIZONS_S.index(s) + i for s in (1, *WATCHED_HORIZONS_S) for i in range(3)]


class RowsOfPath(NamedTuple):
    """Rows first … end of a chunk of the path."""

    out: ShadowRows
    first: int
    end: int


class Second(NamedTuple):
    """The second under way: the rows since `began`, and the time of the last of them.

    Its means are made when it is over, in one pass over all its rows: live they come one by one.
    """

    began: float = -np.inf
    parts: tuple[RowsOfPath, ...] = ()
    time: float = -np.inf

    def with_rows(self, part: RowsOfPath) -> "Second":
        """The second with more rows, at least one."""
        times = part.out.time_s
        began = self.began if self.parts else float(times[part.first])
        return Second(began, (*self.parts, part), float(times[part.end - 1]))

    def takes(self, time: float) -> bool:
        """Whether a row at that time goes on with it."""
        fits = 0.0 <= time - self.time <= MAX_STEP_S and time - self.began < SECOND_S
        return fits and len(self.parts) > 0

    @property
    def complete(self) -> bool:
        """Whether all rows are fit to judge the model by: no jump, the missing force known."""
        fit, jumped = self._column(lambda out: out.fit), self._column(lambda out: out.jumped)
        missing = self._column(lambda out: out.residuals.missing)
        return bool((fit & ~jumped).all() and np.isfinite(missing.sum(axis=1)).all())

    @property
    def errors(self) -> Floats:
        """The prediction errors (len(ERRORS),) known at its last row."""
        if not self.parts:
            return np.full(len(ERRORS), np.nan)
        out, _, end = self.parts[-1]
        return np.asarray(out.residuals.errors[end - 1, ERRORS])

    def _column(self, of: Callable[[ShadowRows], NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([of(out)[first:end] for out, first, end in self.parts])

    def _mean(self) -> Floats:
        """Means (20 + na,) of estimate, cos and sin of yaw, missing, its variance, commanded; then
        commands. Summed row by row, so that chunks make no difference.
        """
        estimate = self._column(lambda out: out.estimate)
        yaw, std = estimate[:, Eta.YAW], self._column(lambda out: out.residuals.missing_std)
        table = np.column_stack([
            estimate, np.cos(yaw), np.sin(yaw), self._column(lambda out: out.residuals.missing),
            std**2, self._column(lambda out: out.residuals.commanded),
            self._column(lambda out: out.commands),
        ])  # fmt: skip
        return np.asarray(table.cumsum(axis=0)[-1] / len(table))

    def means(self, before: Floats) -> SecondMeans:
        """The means; `before` (H 3,) are the errors known a second ago: only others count."""
        mean, (out, _, end) = self._mean(), self.parts[-1]
        motion = mean[:9].copy()
        motion[Eta.YAW] = np.arctan2(mean[10], mean[9])
        new = (self.errors != before).reshape(-1, 3).any(axis=1, keepdims=True)
        errors = np.where(new, self.errors.reshape(-1, 3), np.nan)
        return SecondMeans(
            self.time, motion, out.std[end - 1, 3:6] ** 2, mean[11:14], np.sqrt(mean[14:17]),
            mean[17:20], out.commands[end - 1], errors[1:], mean[20:], errors[0],
        )  # fmt: skip


class ModelMonitor(NamedTuple):
    """The estimates so far; `known` (H 3,) are the prediction errors of the last whole second.

    adaptation  of the vessel's numbers, where they are followed
    """

    estimator: DisturbanceEstimator
    alarm: Alarm
    second: Second = Second()
    known: Floats = np.full(len(ERRORS), np.nan)
    adaptation: Adaptation | None = None
    earlier: tuple[tuple[Alarm, Adaptation | None], ...] = ()  # of the last seconds, oldest first

    @classmethod
    def of(cls, model: Model, adapts: bool = False) -> "ModelMonitor":
        """Before the first row; `adapts`: the vessel's numbers are followed."""
        estimator = DisturbanceEstimator.of(model)
        adaptation = Adaptation.of(model) if adapts else None
        return cls(estimator, Alarm.start(estimator), adaptation=adaptation)

    def observe(self, out: ShadowRows) -> tuple["ModelMonitor", list[TopicRows], list[EventRow]]:
        """A chunk of the path -> the monitor after it, messages of topics, and events."""
        now, rows, events = self, list[TopicRows](), list[EventRow]()
        if not len(out):
            return now, rows, events
        seen: list[Surroundings] = []
        first, times = 0, out.time_s.tolist()
        if len(times) == 1 and self.second.takes(times[0]):  # live, as mostly
            return self._with(out, 0, 1), rows, events
        for k, time in enumerate(times):
            step = time - (times[k - 1] if k else self.second.time)
            continuous = 0.0 <= step <= MAX_STEP_S
            began = now.second.began if now.second.parts else times[first]
            if not continuous or time - began >= SECOND_S:
                now = now._with(out, first, k)
                now, told, new_rows, new_events = now._closed(out, k, continuous)
                rows, events, first = rows + new_rows, events + new_events, k
                seen += told
        now = now._with(out, first, len(times))
        return now, now._topic_rows(out, seen) + rows, events

    def _with(self, out: ShadowRows, first: int, end: int) -> "ModelMonitor":
        """Rows first … end join the second under way."""
        if end == first:
            return self
        return self._replace(second=self.second.with_rows(RowsOfPath(out, first, end)))

    def _closed(
        self, out: ShadowRows, k: int, whole: bool
    ) -> tuple["ModelMonitor", list["Surroundings"], list[TopicRows], list[EventRow]]:
        """The second ends before row k; it counts where nothing in it is missing."""
        s = self.second
        fresh = self._replace(second=Second(), known=s.errors)
        complete = not s.parts or s.complete
        if not (s.parts and whole and complete):
            alarm, adaptation = (self.alarm, self.adaptation) if complete else self._undone()
            alarm = alarm.after_gap()
            return fresh._replace(alarm=alarm, adaptation=adaptation, earlier=()), [], [], []
        alarm, event = self.alarm.observe(self.estimator, means := s.means(self.known))
        earlier = (*self.earlier, (self.alarm, self.adaptation))[-DOUBTFUL_S:]
        fresh = fresh._replace(alarm=alarm, earlier=earlier)
        events = [] if event is None else [fresh._event_row(out, k, event, self.alarm)]
        told = fresh._surroundings(k, means)  # from the first second: nothing is compiled later
        seen = [told] if alarm.estimate.count >= FIRST_S else []
        rows: list[TopicRows] = []
        if self.adaptation is not None:
            adaptation, followed, changed = self.adaptation.observe(out, k, means)
            fresh = fresh._replace(adaptation=adaptation)
            rows, events = [followed], [*events, *changed]
        return fresh, seen, rows, events

    def _undone(self) -> tuple[Alarm, Adaptation | None]:
        """The state before the last seconds: what failed had failed before it was noticed."""
        now = self.alarm, self.adaptation
        before = self.earlier[0] if self.earlier else now
        return before if before[0].misfit.wrong == self.alarm.misfit.wrong else now

    def rebooted(self, times: tuple[int, int]) -> tuple["ModelMonitor", list[EventRow]]:
        """The boat's sensors began anew at these times (vehicle's, receipt) [ns]: the model is
        judged from then on; what there is to say of it.
        """
        events = []
        if self.alarm.misfit.wrong:
            events = [EventRow(*times, ModelEvent.RIGHT.value, "info", JUDGED_ANEW)]
        return self._replace(alarm=self.alarm.rebooted(), second=Second(), earlier=()), events

    def _event_row(self, out: ShadowRows, k: int, event: ModelEvent, before: Alarm) -> EventRow:
        since = (before if event is ModelEvent.RIGHT else self.alarm).misfit.since
        ago_ns = round((float(out.time_s[k]) - since) * 1e9)
        began = clock_text(int(out.vehicle_time_ns[k]) - ago_ns)
        text = event_text(event, self.alarm, self.estimator.air, began)
        return EventRow.at(out, k, event.value, SEVERITY[event], text)

    def _surroundings(self, k: int, means: SecondMeans) -> "Surroundings":
        """What a second that ended before row k tells of water and air."""
        estimate = self.alarm.estimate
        water, air = estimate.water, estimate.air
        told = self.estimator.air.in_world(estimate.around(AIR), air.stated_covariance, means)
        values = np.concatenate([
            estimate.around(WATER), told[:2], std(water.stated_covariance), told[2:4],
            [self.alarm.misfit.level], told[4:],
        ])  # fmt: skip
        return Surroundings(k, values, self.alarm.cause.value)

    def _topic_rows(self, out: ShadowRows, seen: list["Surroundings"]) -> list[TopicRows]:
        """Both topics; the wind is withheld where the vessel has no areas for one."""
        if not seen:
            return []
        at, values = [one.row for one in seen], np.stack([one.values for one in seen])
        times = out.vehicle_time_ns[at], out.receive_time_ns[at]
        explains = {"explains": [one.explains for one in seen]}
        rows = [encode_rows("surroundings", *times, values[:, :WIND_FROM], explains)]
        if self.estimator.air.has_areas:
            rows.append(encode_rows("wind", *times, values[:, WIND_FROM:]))
        return rows


class Surroundings(NamedTuple):
    """What one second tells: numbers of the topic `surroundings` and then of `wind` (13,)."""

    row: int  # of the path, the first after that second
    values: Floats
    explains: str


WIND_FROM = 9  # place of the first number of `wind`


def taken_over(
    monitor: ModelMonitor, path: ShadowPath, receive_time_ns: int
) -> tuple[ModelMonitor, ShadowPath]:
    """The path for what is received from then on, with the numbers that its monitor follows."""
    if monitor.adaptation is None:
        return monitor, path
    adaptation, path = monitor.adaptation.taken_over(path, receive_time_ns)
    return monitor._replace(adaptation=adaptation), path


def std(covariance: Floats) -> Floats:
    """Covariance (n, n) -> standard deviations (n,)."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))
