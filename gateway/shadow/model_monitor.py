"""Watches what the vessel's model lacks: seconds of the path in, surroundings and events out.

    rows → means over a second → beliefs of current and wind, misfit → topic rows, words

Once a second, whatever the rate of the estimates; the means are sums in the order of the rows, so
that chunks make no difference. A second with a jump or without telemetry is left out.
"""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np

from gateway.json_rows import TopicRows, encode_rows
from gateway.shadow.path import Shadowing
from gateway.shadow.topic_rows import Happening
from gateway.topics import HORIZONS_S
from sim.model import Model
from sim.monitoring.alarm import WATCHED_HORIZONS_S, Alarm, ModelEvent, event_text
from sim.monitoring.disturbances import DisturbanceEstimator
from sim.monitoring.live_second import (
    SecondMeans,
    air_velocity,
    air_velocity_covariance,
    world_to_body,
)
from sim.state import Eta, Floats

SECOND_S = 1.0
GAP_S = 0.6  # between rows: what lies between was not seen
FIRST_S = 30  # seconds before anything is published
SEVERITY = {ModelEvent.WRONG: "warning", ModelEvent.EXPLAINED: "warning", ModelEvent.RIGHT: "info"}
COLUMNS = 20  # estimate, cos and sin of yaw, missing, its variance, commanded
ERRORS = [3 * HORIZONS_S.index(s) + i for s in WATCHED_HORIZONS_S for i in range(3)]


@dataclass(frozen=True)
class Second:
    """The second under way: sums (20,) over `count` rows since `began`, and its last row."""

    began: float = -np.inf
    total: Floats = field(default_factory=lambda: np.zeros(COLUMNS))
    count: int = 0
    spoiled: bool = False
    time: float = -np.inf
    variance: Floats = field(default_factory=lambda: np.zeros(3))
    commands: Floats = field(default_factory=lambda: np.zeros(0))
    errors: Floats = field(default_factory=lambda: np.full(len(ERRORS), np.nan))

    def moment(self, before: Floats) -> SecondMeans:
        """The means; `before` (H 3,) are the errors known a second ago: the same are no news."""
        mean = self.total / self.count
        motion = mean[:9].copy()
        motion[Eta.YAW] = np.arctan2(mean[10], mean[9])
        news = (self.errors != before).reshape(-1, 3).any(axis=1, keepdims=True)
        return SecondMeans(
            self.time, motion, self.variance, mean[11:14], np.sqrt(mean[14:17]), mean[17:20],
            self.commands, np.where(news, self.errors.reshape(-1, 3), np.nan),
        )  # fmt: skip


@dataclass(frozen=True)
class ModelMonitor:
    """Everything remembered; `known` (H 3,) are the prediction errors of the last whole second."""

    estimator: DisturbanceEstimator
    alarm: Alarm
    second: Second = field(default_factory=Second)
    known: Floats = field(default_factory=lambda: np.full(len(ERRORS), np.nan))

    @classmethod
    def of(cls, model: Model) -> "ModelMonitor":
        """Nothing seen yet."""
        estimator = DisturbanceEstimator.of(model)
        return cls(estimator, Alarm.start(estimator))

    def observe(self, out: Shadowing) -> tuple["ModelMonitor", list[TopicRows], list[Happening]]:
        """A chunk of the path -> what is known after it, what is published and said."""
        now, rows, told = self, list[TopicRows](), list[Happening]()
        if not len(out):
            return now, rows, told
        first, times, table, bad = 0, out.time_s.tolist(), _table(out), _spoilt(out)
        for k, time in enumerate(times):
            last = times[k - 1] if k else self.second.time
            if time - last > GAP_S or time < last or time - now._began(times, first) >= SECOND_S:
                now = now._with(out, table, bad, first, k)
                now, said, heard = now._closed(out, k, whole=0.0 <= time - last <= GAP_S)
                rows, told, first = rows + said, told + heard, k
        return now._with(out, table, bad, first, len(times)), rows, told

    def _began(self, times: list[float], first: int) -> float:
        return self.second.began if self.second.count else times[first]

    def _with(
        self, out: Shadowing, table: Floats, bad: Floats, first: int, end: int
    ) -> "ModelMonitor":
        """Rows first … end join the second under way."""
        if end == first:
            return self
        s, last = self.second, end - 1
        total = np.vstack([s.total, table[first:end]]).cumsum(axis=0)[-1]
        return replace(self, second=Second(
            s.began if s.count else float(out.time_s[first]),
            total,
            s.count + end - first,
            s.spoiled or bool(bad[first:end].any()),
            float(out.time_s[last]),
            out.std[last, 3:6] ** 2,
            out.commands[last],
            out.watched.errors[last, ERRORS],
        ))  # fmt: skip

    def _closed(
        self, out: Shadowing, k: int, whole: bool
    ) -> tuple["ModelMonitor", list[TopicRows], list[Happening]]:
        """The second ends before row k; it counts where nothing in it is missing."""
        s = self.second
        fresh = replace(self, second=Second(), known=s.errors)
        if s.spoiled or not whole or not s.count:
            return replace(fresh, alarm=self.alarm.after_gap()), [], []
        alarm, news = self.alarm.observe(self.estimator, moment := s.moment(self.known))
        fresh = replace(fresh, alarm=alarm)
        told = [] if news is None else [fresh._happened(out, k, news, self.alarm)]
        return fresh, fresh._published(out, k, moment), told

    def _happened(self, out: Shadowing, k: int, news: ModelEvent, before: Alarm) -> Happening:
        since = (before if news is ModelEvent.RIGHT else self.alarm).misfit.since
        vehicle = int(out.vehicle_time_ns[k])
        began = vehicle - round((float(out.time_s[k]) - since) * 1e9)
        says = event_text(news, self.alarm, self.estimator.air, clock(began))
        receive = int(out.receive_time_ns[k])
        return Happening(vehicle, receive, news.value, SEVERITY[news], says)

    def _published(self, out: Shadowing, k: int, moment: SecondMeans) -> list[TopicRows]:
        """Both topics; the wind is withheld where the vessel has no areas for one."""
        alarm, air = self.alarm, self.estimator.air
        if alarm.estimate.count < FIRST_S:
            return []
        times = out.vehicle_time_ns[k : k + 1], out.receive_time_ns[k : k + 1]
        water, blown = alarm.estimate.water, alarm.estimate.air
        turn = np.array([world_to_body(e, -moment.yaw) for e in np.eye(2)]).T  # body to world
        slope = turn @ air.force_and_slope(blown.disturbance, moment)[1][:2]
        force = air.world_force(blown.disturbance, moment)
        force_covariance = slope @ blown.disturbance_covariance @ slope.T
        values = np.concatenate([
            water.disturbance, force, std(water.disturbance_covariance), std(force_covariance),
            [alarm.misfit.level],
        ])  # fmt: skip
        explains = {"explains": alarm.cause.value}
        rows = [encode_rows("surroundings", *times, values[None], explains)]
        if air.has_areas:
            wind = (
                air_velocity(blown.disturbance),
                std(air_velocity_covariance(blown.disturbance, blown.disturbance_covariance)),
            )
            rows.append(encode_rows("wind", *times, np.concatenate(wind)[None]))
        return rows


def std(covariance: Floats) -> Floats:
    """(n, n) -> (n,)."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))


def clock(time_ns: int) -> str:
    """Unix time -> what a clock shows."""
    return f"{datetime.fromtimestamp(time_ns // 1_000_000_000, UTC):%H:%M:%S} UTC"


def _table(out: Shadowing) -> Floats:
    """What is meaned over a second: (K, 20)."""
    yaw, watched = out.estimate[:, Eta.YAW], out.watched
    return np.column_stack([
        out.estimate, np.cos(yaw), np.sin(yaw), watched.missing, watched.missing_std**2,
        watched.commanded,
    ])  # fmt: skip


def _spoilt(out: Shadowing) -> Floats:
    """Rows that no second may hold: (K,)."""
    unknown = ~np.isfinite(out.watched.missing.sum(axis=1))
    return np.asarray(~out.fresh | out.jumped | unknown)
