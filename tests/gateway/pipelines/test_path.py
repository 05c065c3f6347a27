"""The path is a pure function of its inputs, and what it says follows from them."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from gateway.estimation import Flag, MeasurementKind
from gateway.ingest.mavlink.log import tlog_from_bytes
from gateway.offline.replay import ReplayInput, replay_input_of
from gateway.shadow import PulseTable
from gateway.shadow.events import EventDetector
from gateway.shadow.health import LogHealth
from gateway.shadow.path import LOST_S, STALE_S, ShadowPath, ShadowRows, discontinuous
from gateway.shadow.sensor_checks import SETTLE_S
from gateway.shadow.topic_rows import EventRow, event_rows, topic_rows
from sim.effects.effect import Effect, Parameter, Scope
from sim.following.follower import FollowerOptions, Reference, ReferenceMode, VesselFollower
from sim.model import Model
from sim.vessel import AddedEffect, Vessel
from tests.gateway.ingest.scripted import local_position
from tests.gateway.pipelines.sailing import Span, frames, voyage
from tests.sim.vessels import IACQUABOT, WAMV

SILENT, NEVER = (6.0, 11.0), (0.0, 0.0)


def held_up(p: Any) -> Any:
    """Commands act later by p.delay [s]."""
    return p.delay


LATE = AddedEffect(
    Effect("held_up", Scope.BOAT, (Parameter("delay", "s", 0.0, 2.0, 0.5),), "late", delay=held_up),
    {"delay": 0.7},
)


@cache
def material(silent: Span = SILENT, noise: float = 1.0) -> ReplayInput:
    """A voyage, by default with five seconds in which nothing tells the motion."""
    said = voyage(16.0, silent=silent, noise=noise)
    return replay_input_of(tlog_from_bytes(b"".join(frames(said))))


def path_of(mode: ReferenceMode, vessel: Vessel = WAMV, plant: Vessel | None = None) -> ShadowPath:
    model = Model.of(vessel)
    follower = VesselFollower.of(Model.of(plant) if plant else model, FollowerOptions())
    return ShadowPath(model, Reference(model, mode), follower)


def outcome(path: ShadowPath, size: int) -> dict[str, list[bytes]]:
    """Topic -> payloads, with the facts taken in `size` at a time."""
    given = material()
    state, watchman = path.start(), EventDetector()
    meter = LogHealth.of(given.log, given.decoded)
    said: dict[str, list[bytes]] = {}
    for begin in range(0, len(given.feed), size):
        chunk = given.feed[begin : begin + size]
        state, out, filtered = path.advance(state, chunk)
        watchman, happened = watchman.observe(chunk, filtered, out)
        rows = [*topic_rows(out, given.origin), event_rows(happened)]
        for part in [*rows, meter.advance(chunk.receive_time_ns, filtered, out)]:
            said.setdefault(part.topic, []).extend(part.payloads)
    return said


@pytest.mark.parametrize("mode", ReferenceMode)
def test_how_facts_are_cut_into_chunks_changes_no_bit(mode: ReferenceMode) -> None:
    path = path_of(mode, WAMV.with_effects(LATE), IACQUABOT)
    whole = outcome(path, 10**6)
    assert all(whole.values())
    for size in (1, 5, 64):
        assert outcome(path, size) == whole


def shadowed(mode: ReferenceMode, given: ReplayInput | None = None, **more: Any) -> ShadowRows:
    path = path_of(mode, **more)
    return path.advance(path.start(), (given or material()).feed)[1]


@cache
def truth() -> ShadowRows:
    """The voyage as it was: complete, and without noise."""
    return shadowed(ReferenceMode.MEASURED, material(NEVER, 0.0))


def true_nu(out: ShadowRows) -> Any:
    """(K, 3): u, v, r of the voyage at the rows' times."""
    columns = [np.interp(out.time_s, truth().time_s, truth().estimate[:, k]) for k in (3, 4, 5)]
    return np.column_stack(columns)


def test_measured_means_that_the_reference_is_the_estimate() -> None:
    out = shadowed(ReferenceMode.MEASURED)
    assert np.array_equal(out.reference, out.estimate)
    assert not out.from_model.any()


def test_model_means_that_the_estimate_is_not_looked_at_again() -> None:
    out = shadowed(ReferenceMode.MODEL, material(NEVER))
    assert out.from_model.all()
    late = out.time_s > 3.0
    off = np.abs(out.reference[:, 3:6] - true_nu(out))[late].max(axis=0)
    assert (off < [0.03, 0.04, 0.01]).all()  # the vessel is the one that made the voyage
    assert np.abs(out.reference - out.estimate)[late, 3:6].max() > 1e-3  # no copy
    heavier = replace(WAMV, dynamics=replace(WAMV.dynamics, m11=400.0))
    other = shadowed(ReferenceMode.MODEL, material(NEVER), vessel=heavier)
    assert np.abs(other.reference[:, 3] - true_nu(other)[:, 0])[late].max() > 0.1


def test_auto_hands_over_to_the_model_while_nothing_tells_the_motion() -> None:
    out = shadowed(ReferenceMode.AUTO)
    away = (out.time_s > SILENT[0] - 0.05 + STALE_S) & (out.time_s < SILENT[1] + 0.01)
    assert away.sum() > 30
    assert np.array_equal(out.from_model, away)
    assert np.array_equal(out.fresh, ~away)


def test_auto_predicts_where_a_held_estimate_is_far_off() -> None:
    out = shadowed(ReferenceMode.AUTO)
    settled = out.from_model & (out.time_s > SILENT[0] + STALE_S + 2.0)  # the hand-over has faded
    predicted = np.abs(out.reference[:, 3:6] - true_nu(out))[settled].max(axis=0)
    blind = np.abs(out.estimate[:, 3:6] - true_nu(out))[settled].max(axis=0)
    assert (predicted < 0.25 * blind + [0.0, 0.0, 0.02]).all()


def test_the_hand_over_goes_on_from_where_the_reference_was() -> None:
    out = shadowed(ReferenceMode.AUTO)
    dt = np.diff(out.time_s)[:, None]
    acceleration = np.abs(np.diff(out.reference[:, 3:6], axis=0)) / dt
    changes = np.flatnonzero(np.diff(out.from_model.astype(int)))
    assert len(changes) == 2
    for k in changes:
        assert (acceleration[k - 1 : k + 3] < [0.6, 0.6, 0.6]).all()
    off = np.abs(out.reference[:, 3:6] - true_nu(out))[out.time_s > SILENT[1]].max(axis=0)
    assert (off < [0.1, 0.2, 0.06]).all()  # nothing overshoots when the boat is heard again


def test_heading_alone_does_not_make_an_estimate_fresh() -> None:
    said = voyage(16.0, silent=SILENT)
    heard = [
        (t, m) for t, m in said if t < 11.0 or m.get_type() != "LOCAL_POSITION_NED" or t > 14.0
    ]
    given = replay_input_of(tlog_from_bytes(b"".join(frames(heard))))
    out = shadowed(ReferenceMode.AUTO, given)
    assert out.from_model[(out.time_s > 7.1) & (out.time_s < 14.0)].all()
    assert out.fresh[out.time_s > 14.11].all()


def test_without_velocity_and_position_an_estimate_goes_stale_in_the_end() -> None:
    said = voyage(16.0)
    heard = [(t, m) for t, m in said if t < 4.0 or m.get_type() != "LOCAL_POSITION_NED"]
    given = replay_input_of(tlog_from_bytes(b"".join(frames(heard))))
    out = shadowed(ReferenceMode.AUTO, given)
    assert out.fresh[out.time_s < 3.9 + LOST_S].all()
    assert not out.fresh[out.time_s > 4.1 + LOST_S].any()


@pytest.mark.parametrize("plant", [None, IACQUABOT], ids=["itself", "another"])
def test_the_shadow_follows_and_does_not_copy(plant: Vessel | None) -> None:
    out = shadowed(ReferenceMode.MEASURED, material(NEVER), plant=plant)
    off = (out.shadow - out.estimate)[out.time_s > 3.0, 3:6]
    assert (np.sqrt((off**2).mean(axis=0)) < [0.02, 0.02, 0.01]).all()
    assert (np.abs(off).max(axis=0) > 1e-6).all()
    pushed = (out.shadow[1:, 3] - out.shadow[:-1, 3]) / np.diff(out.time_s)
    assert np.corrcoef(out.control[1:, 0], pushed)[0, 1] > 0.5  # it moves because it is pushed


def test_nothing_is_missing_from_the_right_model_but_noise() -> None:
    out = shadowed(ReferenceMode.MEASURED)
    settled = out.fresh & (out.time_s > 3.0)
    share = np.abs(out.residuals.missing) / out.residuals.missing_std
    assert (np.median(share[settled], axis=0) < 1.0).all()
    assert np.isnan(out.residuals.missing[~out.fresh]).all()


def flagged(*flags: Flag) -> tuple[Any, Any, list[str]]:
    """A voyage with these flags on its first rows of each kind after the start -> what is told."""
    feed, rows, told = events_of(*flags)
    return feed, rows, [h.kind for h in told]


def events_of(*flags: Flag) -> tuple[Any, Any, list[EventRow]]:
    """The same with the events themselves."""
    given, path = material(NEVER), path_of(ReferenceMode.MEASURED)
    _, out, filtered = path.advance(path.start(), given.feed)
    raised = filtered.flags.copy()
    for flag in flags:
        raised[200:204] |= int(flag)  # yaw, yaw rate, velocity, position
    changed = replace(filtered, flags=raised)
    _, told = EventDetector().observe(given.feed, changed, out)
    return given.feed, changed, told


def test_what_jumped_is_told() -> None:
    """ "The source jumped" was told of a compass, and of a turn told twice a second."""
    _, _, told = events_of(Flag.JUMP)
    assert [h.text.partition(" jumped")[0] for h in told if h.kind == "jump"] == [
        "the reported heading", "the reported velocity", "the reported position"
    ]  # fmt: skip


def test_a_sharp_turn_is_no_discontinuity() -> None:
    feed, rows, told = flagged(Flag.JUMP)
    kinds = set(feed.events.kind[discontinuous(feed, rows)].tolist())
    assert kinds == {MeasurementKind.YAW, MeasurementKind.VELOCITY, MeasurementKind.POSITION}
    assert told == ["started", "jump", "jump", "jump"]


def test_a_restart_is_told_even_in_the_first_chunk_but_the_start_is_none() -> None:
    assert flagged(Flag.RESTART)[2] == ["started", "restart", "restart", "restart", "restart"]
    given, path = material(NEVER), path_of(ReferenceMode.MEASURED)
    _, out, filtered = path.advance(path.start(), given.feed)
    flags = filtered.flags.copy()
    flags[0] |= int(Flag.RESTART)
    _, told = EventDetector().observe(given.feed, replace(filtered, flags=flags), out)
    assert [h.kind for h in told] == ["started"]


def test_after_a_discontinuity_the_shadow_is_set_anew_and_says_so() -> None:
    said = voyage(12.0)
    moved = [(t, shifted(m) if t > 6.0 else m) for t, m in said]
    given = replay_input_of(tlog_from_bytes(b"".join(frames(moved))))
    path = path_of(ReferenceMode.MEASURED)
    _, out, filtered = path.advance(path.start(), given.feed)
    _, told = EventDetector().observe(given.feed, filtered, out)
    assert [h.kind for h in told].count("jump") == 1
    assert out.jumped.sum() == 1
    k = int(np.flatnonzero(out.jumped)[0])
    assert out.estimate[k, 0] - out.estimate[k - 1, 0] == pytest.approx(300.0, abs=1.0)
    assert out.shadow[k, 0] == pytest.approx(out.estimate[k, 0], abs=0.5)
    assert out.shadow[k - 1, 0] == pytest.approx(out.estimate[k - 1, 0], abs=0.5)


def shifted(message: Any) -> Any:
    """The same, 300 m further north: the autopilot moved its origin."""
    if message.get_type() != "LOCAL_POSITION_NED":
        return message
    m = message
    return local_position(m.time_boot_ms * 1e-3, m.x + 300.0, m.y, m.vx, m.vy)


def test_rows_go_out_no_faster_than_asked() -> None:
    model = Model.of(WAMV)
    follower = VesselFollower.of(model)
    slow = ShadowPath(model, Reference(model, ReferenceMode.MEASURED), follower, rate_hz=5.0)
    out = slow.advance(slow.start(), material().feed)[1]
    assert np.diff(out.time_s).min() >= 0.9 / 5.0
    assert len(out) < 0.35 * len(shadowed(ReferenceMode.MEASURED))


def test_a_prediction_that_went_far_astray_is_left_at_once_and_that_is_said() -> None:
    """The model of a boat of half the drag led far ahead: the way back went at 9.5 m/s sideways."""
    given = replay_input_of(tlog_from_bytes(b"".join(frames(voyage(40.0, silent=(6.0, 36.0))))))
    light = replace(WAMV.dynamics, X_u=0.2 * WAMV.dynamics.X_u, X_uu=0.2 * WAMV.dynamics.X_uu)
    path = path_of(ReferenceMode.AUTO, replace(WAMV, dynamics=light))
    _, out, filtered = path.advance(path.start(), given.feed)
    (k,) = np.flatnonzero(out.reset)
    assert not out.from_model[k]
    assert out.from_model[k - 1]
    assert np.hypot(*(out.shadow[k - 1, :2] - out.estimate[k, :2])) > 5.5
    assert np.abs(out.shadow - out.estimate)[k:, :2].max() < 1.0
    assert np.abs(out.shadow[k:, 3:5] - out.estimate[k:, 3:5]).max() < 1.0
    _, told = EventDetector().observe(given.feed, filtered, out)
    kinds = [h.kind for h in told]
    assert kinds.count("shadow_reset") == 1
    assert "jump" not in kinds


RUNAWAY = replace(WAMV, dynamics=replace(WAMV.dynamics, X_u=400.0, X_uu=50.0))


def test_a_shadow_that_diverges_begins_anew_and_is_told_once() -> None:
    given, path = material(NEVER), path_of(ReferenceMode.MODEL, RUNAWAY)
    _, out, filtered = path.advance(path.start(), given.feed)
    assert out.diverged.sum() > 1
    assert np.abs(out.shadow[:, 3:6]).max() <= 150.0
    _, told = EventDetector().observe(given.feed, filtered, out)
    assert [h.kind for h in told].count("shadow_diverged") == 1
    assert "mass, damping or thrust" in next(h.text for h in told if h.kind == "shadow_diverged")
    assert not path.advance(path_of(ReferenceMode.MODEL).start(), given.feed)[1].diverged[0]


def test_a_shadow_that_has_not_diverged_for_a_minute_is_said_to_be_well() -> None:
    rows = 130
    one = ShadowRows.none(0)
    seconds, yes = np.arange(rows), np.ones(rows, np.bool_)
    out = replace(
        one, row=seconds, time_s=seconds * 1.0, vehicle_time_ns=seconds, receive_time_ns=seconds,
        fresh=yes, from_model=~yes, limited=~yes, reset=~yes,
        diverged=(seconds == 3) | (seconds == 20),
    )  # fmt: skip
    assert said_of(out, [rows]) == ["started", "shadow_diverged", "shadow_steady"]
    assert said_of(out, [5, 79, rows]) == ["started", "shadow_diverged", "shadow_steady"]
    assert said_of(out, [79]) == ["started", "shadow_diverged"]


def said_of(out: ShadowRows, ends: list[int]) -> list[str]:
    """Kinds of events of made-up rows, in chunks that end there."""
    detector, kinds = EventDetector(), list[str]()
    no_filter = path_of(ReferenceMode.MEASURED)
    _, _, filtered = no_filter.advance(no_filter.start(), material().feed[:0])
    for start, end in zip([0, *ends], ends, strict=False):
        part = replace(out, **{
            name: getattr(out, name)[start:end]
            for name in ("row", "time_s", "vehicle_time_ns", "receive_time_ns", "fresh",
                         "from_model", "limited", "diverged")
        })  # fmt: skip
        detector, events = detector.observe(material().feed[:0], filtered, part)
        kinds += [event.kind for event in events]
    return kinds


def test_what_happened_is_told_once_each() -> None:
    given, path = material(), path_of(ReferenceMode.AUTO)
    _, out, filtered = path.advance(path.start(), given.feed)
    _, told = EventDetector().observe(given.feed, filtered, out)
    begun = told[0].receive_time_ns
    found = [(h.kind, round((h.receive_time_ns - begun) * 1e-9, 1)) for h in told]
    assert found == [
        ("started", 0.0),
        ("telemetry_silent", 7.0),
        ("reference_model", 7.0),
        ("telemetry_back", 11.1),
        ("reference_measured", 11.1),
    ]


def wired(*channels: int) -> Vessel:
    """The WAM-V with its motors on these outputs."""
    pairs = zip(WAMV.thrusters, channels, strict=True)
    return replace(
        WAMV,
        thrusters=tuple(replace(t, servo=replace(t.servo, channel=c)) for t, c in pairs),
    )


Pulses = Callable[[np.ndarray], None]


def told_of(
    vessel: Vessel, size: int = 10**6, changed: Pulses = lambda pulses: None, lost_gps: Span = NEVER
) -> tuple[list[tuple[str, str]], Any, Any]:
    """Kind and text of the events about its data, with the facts taken in `size` at a time; times
    of the rows [s from the first], and whether the data were fit then.

    changed   what becomes of the pulses (S, 32), row by row of their table
    """
    given, path = material(NEVER), path_of(ReferenceMode.MEASURED, vessel)
    table = given.feed.pulse_table
    pulses = table.pulses.copy()
    changed(pulses)
    begun = given.feed.events.time_s[0]
    away = (given.feed.events.time_s - begun >= lost_gps[0]) & (
        given.feed.events.time_s - begun < lost_gps[1]
    )
    told = PulseTable.of(pulses, table.heard)
    feed = replace(given.feed, pulse_table=told, gps_fix=np.where(away, 1.0, 3.0))
    state, detector, events = path.start(), EventDetector.of(vessel), list[tuple[str, str]]()
    times, fit = list[float](), list[bool]()
    for begin in range(0, len(feed), size):
        chunk = feed[begin : begin + size]
        state, out, filtered = path.advance(state, chunk)
        detector, happened = detector.observe(chunk, filtered, out)
        events += [(h.kind, h.text) for h in happened if h.kind.startswith("sensor")]
        times += (out.time_s - begun).tolist()
        fit += out.fit.tolist()
    return events, np.array(times), np.array(fit)


LEFT, RIGHT = (t.servo.channel for t in WAMV.thrusters)
MISSED = (
    f"output 9 (right) of the vessel file gets no pulse, while {LEFT}, {RIGHT} do (is `channel` "
    "right?): until that is over the model is not judged"
)


@pytest.mark.parametrize("size", [10**6, 7])
def test_a_motor_on_an_output_without_pulses_is_told_and_nothing_is_judged(size: int) -> None:
    """Motors on the wrong channel were told as a current, a drag or another motor that is weak."""
    events, _, fit = told_of(WAMV, size)
    assert events == []
    assert fit.all()
    events, times, fit = told_of(wired(LEFT, 9), size)
    assert events == [("sensor_failed", MISSED)]
    assert not fit[times > 0.5].any()  # from the first pulse on
    ((_, text),), *_ = told_of(wired(8, 9), size)
    assert text.startswith("output 8 (left) and output 9 (right) of the vessel file get no pulse")


@pytest.mark.parametrize("size", [10**6, 7])
def test_an_output_that_gets_pulses_late_is_judged_from_then_on(size: int) -> None:
    def late(pulses: np.ndarray) -> None:
        pulses[: 2 * len(pulses) // 3, RIGHT - 1] = np.nan

    events, times, fit = told_of(WAMV, size, late)
    assert [kind for kind, _ in events] == ["sensor_failed", "sensor_restored"]
    assert events[1][1] == (
        "all outputs of the vessel file get pulses: the model is judged from now on"
    )
    assert not fit[(times > 0.5) & (times < 10.0)].any()
    assert fit[-1] == (times[-1] > 10.7 + SETTLE_S)


@pytest.mark.parametrize("size", [10**6, 7])
def test_neither_a_disarmed_boat_nor_a_lost_fix_ends_or_hides_that_an_output_is_missed(
    size: int,
) -> None:
    def disarmed(pulses: np.ndarray) -> None:
        pulses[2 * len(pulses) // 3 : 5 * len(pulses) // 6] = np.nan

    assert told_of(wired(LEFT, 9), size, disarmed)[0] == [("sensor_failed", MISSED)]
    events, *_ = told_of(wired(LEFT, 9), size, lost_gps=(8.0, 10.0))
    assert [kind for kind, _ in events] == ["sensor_failed", "sensor_failed", "sensor_restored"]
    assert events[1][1].startswith("the GPS has no 3-D fix")
    assert events[2][1].startswith("the GPS has a 3-D fix again")


def test_an_output_that_had_a_pulse_once_is_wired() -> None:
    """A motor that stops, or an autopilot that is disarmed, is no wrong channel."""

    def stops(pulses: np.ndarray) -> None:
        pulses[len(pulses) // 4 :, LEFT - 1] = np.nan

    events, _, fit = told_of(WAMV, changed=stops)
    assert events == []
    assert fit.all()
    ((_, text),), *_ = told_of(wired(LEFT, 9), changed=stops)
    assert text.startswith("output 9 (right) of the vessel file gets no pulse, while 2 does")
