"""Each law at one point, against numbers worked out by hand from the equation of its file."""

import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.body import Body, Flow, Report, RudderParameters, ThrusterParameters
from sim.effects.catalogue import named
from sim.effects.effect import ResidualForce
from sim.effects.wave_trains import GRAVITY, _coarse_peaks, _refined, _Samples
from sim.state import Inertia, Pose
from sim.vessel import Vessel
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, WAMV

BODY = Body(**(dict.fromkeys(Body._fields, 0.0) | {
    "length": 5.0, "mass": 100.0, "area_front": 2.0, "area_side": 4.0, "X_u": -10.0, "X_uu": -20.0,
}))  # fmt: skip
DRIVE = ThrusterParameters(0.0, -1.0, -0.7, 0.0, -80.0, 90.0, 1.0)  # number, x, y, azimuth, …
BLADE = RudderParameters(0.0, -1.0, 0.0, -0.6, 0.6, 0.02, 1.5)
HALF_PI = 0.5 * np.pi


def flow(**values: float) -> Flow:
    """Without a measured wind; zeros elsewhere."""
    return Flow(*(0.0,) * (len(Flow._fields) - 1), BODY)._replace(**values)


def law(name: str, place: str) -> Any:
    return named(name).laws[place]


def p(**values: float) -> Any:
    return SimpleNamespace(**values)


FORCES = (
    # 3 (-2)³
    ("cubic_drag", {"X_uuu": -3.0}, flow(u=-2.0), (24.0, 0.0, 0.0)),
    # 0.01 · 50 (−10 − 20 · 2) 2, and nothing before the first sample
    ("drag_growth", {"rate": 0.01}, flow(u=2.0, time=50.0), (-50.0, 0.0, 0.0)),
    ("drag_growth", {"rate": 0.01}, flow(u=-2.0, time=50.0), (50.0, 0.0, 0.0)),
    ("drag_growth", {"rate": 0.01}, flow(u=2.0, time=-50.0), (0.0, 0.0, 0.0)),
    # −2 · 5 (3, −5 + (−2)(−0.5)), 2 m astern
    ("towed_load", {"drag": 2.0, "x": -2.0}, flow(u=3.0, v=-5.0, r=-0.5), (-30.0, 40.0, -80.0)),
    ("cross_damping", {"Y_r": 3.0, "N_v": -7.0}, flow(u=9.0, v=2.0, r=0.5), (0.0, 1.5, -14.0)),
    # 2 (3 · 5 + 7 · 0.5), 2 (11 · 5 + 13 · 0.5)
    ("hull_lift", {"Y_uv": 3.0, "Y_ur": 7.0, "N_uv": 11.0, "N_ur": 13.0}, flow(u=2.0, v=5.0, r=0.5),
     (0.0, 37.0, 123.0)),
    # towards east, on a heading to the north and one to the east
    ("inertial_force", {"force": 8.0, "direction": HALF_PI}, flow(), (0.0, 8.0, 0.0)),
    ("inertial_force", {"force": 8.0, "direction": HALF_PI}, flow(yaw=HALF_PI), (8.0, 0.0, 0.0)),
    # two metres along, k = 4 / 9.81: sin(2 · 1 − k · 2 + 0.1); the way across does not count
    ("wave_motion", {"force": 6.0, "omega": 2.0, "direction": 0.0, "phase": 0.1},
     flow(time=1.0, north=2.0, east=50.0), (6.0 * np.sin(2.1 - 8.0 / 9.81), 0.0, 0.0)),
)  # fmt: skip


@pytest.mark.parametrize(("name", "values", "at", "expected"), FORCES)
def test_a_force_is_what_its_equation_gives(
    name: str, values: dict[str, float], at: Flow, expected: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(law(name, "force")(at, p(**values)), expected, atol=1e-9)


@pytest.mark.parametrize(("v", "r"), [(3.0, 0.4), (-0.3, 0.4), (0.1, -0.9), (0.0, 0.5), (0.4, 0.0)])
def test_cross_flow_drag_is_that_of_many_strips_beyond_what_slip_and_turn_do_alone(
    v: float, r: float
) -> None:
    x = np.linspace(-2.5, 2.5, 100_001)
    crossed = np.abs(v + x * r) * (v + x * r) - np.abs(v) * v - np.abs(x * r) * x * r
    said = law("crossflow_drag", "force")(flow(u=9.0, v=v, r=r), p(drag=10.0))
    expected = (0.0, -10.0 * np.mean(crossed), -10.0 * np.mean(x * crossed))
    np.testing.assert_allclose(said, expected, rtol=0.01, atol=0.02 * (v * v + 6.0 * r * r))


def test_the_wind_of_two_is_that_which_blows_then() -> None:
    """Before its moment as the first, from then on as the second; a measured one counts instead."""
    both = p(speed=6.0, direction=0.4, later_speed=9.0, later_direction=2.5, time=30.0,
             c_x=0.6, c_n=0.1, centre=-0.1)  # fmt: skip
    moving: dict[str, float] = {"u_ground": 1.0, "v_ground": -0.3, "yaw": 0.8}
    for time, speed, direction in ((29.9, 6.0, 0.4), (30.0, 9.0, 2.5)):
        alone = p(speed=speed, direction=direction, c_x=0.6, c_n=0.1, centre=-0.1)
        at = flow(**moving, time=time)
        steady = law("steady_wind", "force")(at, alone)
        np.testing.assert_allclose(law("wind_change", "force")(at, both), steady, rtol=1e-12)
        # the same air, told as it moves: towards where the wind does not come from
        north, east = -speed * np.cos(direction), -speed * np.sin(direction)
        known = flow(**moving, time=time, wind_known=1.0, wind_north=north, wind_east=east)
        for name in ("steady_wind", "wind_change"):
            np.testing.assert_allclose(law(name, "force")(known, both), steady, rtol=1e-9)


def test_the_water_moves_towards_its_direction_as_fast_as_it_is_said() -> None:
    pose = Pose(3.0, 4.0, 1.0)
    steady = law("steady_current", "water")(0.0, pose, p(speed=0.5, direction=HALF_PI))
    np.testing.assert_allclose(steady, (0.0, 0.5, 0.0, 0.0), atol=1e-12)
    change = p(speed=0.5, direction=0.3, later_speed=0.8, later_direction=-2.0, time=60.0)
    for time, speed, direction in ((59.9, 0.5, 0.3), (60.0, 0.8, -2.0)):
        water = law("current_change", "water")(time, pose, change)
        expected = (speed * np.cos(direction), speed * np.sin(direction), 0.0, 0.0)
        np.testing.assert_allclose(water, expected, atol=1e-12)
    tide = p(speed=0.5, period=100.0, phase=HALF_PI, direction=0.3)
    for time, part, rate in ((0.0, 1.0, 0.0), (25.0, 0.0, -1.0), (50.0, -1.0, 0.0)):
        water = law("varying_current", "water")(time, pose, tide)
        fast, grows = 0.5 * part, 0.5 * rate * 2.0 * np.pi / 100.0
        c, s = np.cos(0.3), np.sin(0.3)
        np.testing.assert_allclose(water, (fast * c, fast * s, grows * c, grows * s), atol=1e-12)


THRUSTS = (
    ("thrust_scale", {"gain": 0.7}, DRIVE, flow(), ((50.0, 35.0), (-50.0, -35.0))),
    ("reverse_loss", {"factor": 0.7}, DRIVE, flow(), ((50.0, 50.0), (-50.0, -35.0))),
    ("thruster_imbalance", {"port_gain": 0.7, "starboard": 0.0}, DRIVE, flow(),
     ((50.0, 35.0), (-50.0, -35.0))),
    ("thruster_imbalance", {"port_gain": 0.7, "starboard": 0.0}, DRIVE._replace(y=0.7), flow(),
     ((50.0, 50.0),)),
    ("thruster_imbalance", {"port_gain": 1.3, "starboard": 1.0}, DRIVE, flow(), ((50.0, 50.0),)),
    ("thruster_imbalance", {"port_gain": 1.3, "starboard": 1.0}, DRIVE._replace(y=0.7), flow(),
     ((50.0, 35.0), (-50.0, -35.0))),
    ("thruster_fault", {"thruster": 1.0, "gain": 0.2, "time": 9.0}, DRIVE, flow(time=9.0),
     ((50.0, 10.0),)),
    ("thruster_fault", {"thruster": 1.0, "gain": 0.2, "time": 9.0}, DRIVE, flow(time=8.9),
     ((50.0, 50.0),)),
    ("thruster_fault", {"thruster": 1.0, "gain": 0.2, "time": 9.0}, DRIVE._replace(number=1.0),
     flow(time=9.0), ((50.0, 50.0),)),
    ("thruster_fault", {"thruster": 0.0, "gain": 0.2, "time": 9.0}, DRIVE._replace(number=1.0),
     flow(time=9.0), ((50.0, 10.0),)),
    ("thruster_fault", {"thruster": 0.0, "gain": 0.2, "time": 9.0}, DRIVE, flow(time=8.9),
     ((50.0, 50.0),)),
    # (12 / 16)²
    ("battery_sag", {"nominal": 16.0}, DRIVE, flow(voltage=12.0), ((64.0, 36.0), (-64.0, -36.0))),
    # along the shaft: 0.6 · 2 + 0.8 · 1 = 2 m/s; a quarter each, above 0.5 m/s
    ("advance_loss", {"per_mps": 0.25}, DRIVE._replace(azimuth=np.arctan2(0.8, 0.6)),
     flow(u=2.0, v=1.0), ((50.0, 25.0), (-50.0, -50.0))),
    ("astern_stall", {"per_mps": 0.25, "above": 0.5}, DRIVE._replace(azimuth=np.arctan2(0.8, 0.6)),
     flow(u=2.0, v=1.0), ((50.0, 50.0), (-40.0, -25.0))),
    ("astern_stall", {"per_mps": 0.25, "above": 0.5}, DRIVE, flow(u=9.0), ((-40.0, 0.0),)),
)  # fmt: skip


@pytest.mark.parametrize(("name", "values", "drive", "at", "pairs"), THRUSTS)
def test_a_thrust_becomes_what_its_equation_gives(
    name: str, values: dict[str, float], drive: ThrusterParameters, at: Flow,
    pairs: tuple[tuple[float, float], ...],
) -> None:  # fmt: skip
    for given, left in pairs:
        assert law(name, "thrust")(given, drive, at, p(**values)) == pytest.approx(left)


def test_commands_angles_and_lags_are_what_their_equations_give() -> None:
    curve, band = law("thrust_curve", "command"), law("thruster_deadband", "command")
    assert curve(-0.5, DRIVE, p(exponent=2.0)) == pytest.approx(-0.25)
    assert [band(c, DRIVE, p(width=0.2, jump=0.0)) for c in (0.6, -0.6, 0.2, 1.0)] == pytest.approx(
        [0.5, -0.5, 0.0, 1.0]
    )
    assert band(0.21, DRIVE, p(width=0.2, jump=1.0)) == pytest.approx(0.5 * 0.21)  # half started
    assert band(-0.6, DRIVE, p(width=0.2, jump=0.5)) == pytest.approx(-0.5 * (0.6 + 0.5))
    assert law("thruster_misalignment", "turn")(0.3, DRIVE, flow(), p(angle=0.1)) == 0.4
    assert law("steering_scale", "angle")(0.4, BLADE, p(gain=0.75)) == pytest.approx(0.3)
    assert law("steering_offset", "angle")(0.3, BLADE, p(angle=-0.1)) == pytest.approx(0.2)
    assert law("steering_lag", "angle_rate")(0.3, 0.1, BLADE, p(tau=0.5)) == pytest.approx(0.4)
    play = law("steering_play", "angle_rate")
    behind = [play(δ, 0.1, BLADE, p(play=0.05)) for δ in (0.12, 0.06, 0.3, -0.2)]
    assert behind == pytest.approx([0.0, 0.0, 1.5, -2.5])
    limited = law("steering_rate", "angle_rate")
    turning = [limited(δ, 0.1, BLADE, p(rate=0.2)) for δ in (0.11, 0.5, -0.5)]
    assert turning == pytest.approx([0.1, 0.2, -0.2])
    assert law("thruster_lag", "thrust_rate")(90.0, 60.0, DRIVE, p(tau=0.5)) == pytest.approx(60.0)
    assert law("command_delay", "delay")(p(delay=0.7)) == 0.7
    assert law("velocity_latency", "latency")(p(delay=0.7)) == 0.7


def test_arms_of_another_length_give_another_moment_and_no_other_force() -> None:
    more = law("lever_arm", "reaction")  # 0.7 m to port, 50 N ahead: 35 N m, of which 40 % less
    port, starboard = DRIVE, DRIVE._replace(y=0.7)
    for side, moments in ((0.0, (-14.0, 14.0)), (1.0, (-14.0, 0.0)), (2.0, (0.0, 14.0))):
        for drive, moment in zip((port, starboard), moments, strict=True):
            found = more(50.0, drive, flow(), p(gain=0.6, which=side))
            assert found == pytest.approx((0.0, 0.0, moment))
    across = more(50.0, DRIVE._replace(azimuth=HALF_PI), flow(), p(gain=2.0, which=0.0))
    assert across.N == pytest.approx(0.0)
    # 1 m astern, 50 N to starboard: −50 N m, and half as much again
    steered = more(50.0, DRIVE._replace(azimuth=HALF_PI), flow(), p(gain=1.5, which=3.0))
    assert steered == pytest.approx((0.0, 0.0, -25.0))
    assert more(50.0, DRIVE, flow(), p(gain=1.5, which=3.0)).N == pytest.approx(0.0)


def test_the_mass_is_where_it_is_and_as_much_as_there_is() -> None:
    M = Inertia(10.0, 1.0, 2.0, 20.0, 3.0, 30.0)
    aft = law("cg_offset", "inertia")(M, flow(), p(x_g=-0.25))
    assert aft == Inertia(10.0, 1.0, 2.0, 20.0, 3.0 - 25.0, 30.0)
    load = p(factor=2.0, time=9.0)
    assert law("payload_change", "inertia")(M, flow(time=8.9), load) == M
    assert law("payload_change", "inertia")(M, flow(time=9.0), load) == Inertia(
        *(2.0 * m for m in M)
    )


REPORT = Report(10.0, 20.0, HALF_PI, 3.0, -1.0, 0.5, 0.2, 0.4, 0.1)  # on a heading to the east


def test_a_sensor_reports_what_its_equation_gives() -> None:
    antenna = law("antenna_offset", "observe")(REPORT, p(x=0.6, y=0.2))
    np.testing.assert_allclose(antenna, (
        10.0 - 0.2, 20.0 + 0.6, HALF_PI, 3.0 - 0.5 * 0.2, -1.0 + 0.5 * 0.6, 0.5,
        0.2 - 0.1 * 0.2, 0.4 + 0.1 * 0.6, 0.1,
    ))  # fmt: skip
    quarter = law("heading_offset", "observe")(REPORT, p(angle=HALF_PI))  # north said to be east
    np.testing.assert_allclose(
        quarter, (10.0, 20.0, np.pi, -1.0, -3.0, 0.5, 0.4, -0.2, 0.1), atol=1e-12
    )
    gyro = law("yaw_rate_bias", "observe")(REPORT, p(bias=0.05))
    np.testing.assert_allclose(gyro, REPORT._replace(r=0.55))
    # On that heading d = b, and changes by −c r.
    d, rate = 0.3, 0.2 * -0.5
    deviates = law("compass_deviation", "observe")(REPORT, p(b=0.3, c=0.2))
    u, v = 3.0 * np.cos(d) - np.sin(d), -3.0 * np.sin(d) - np.cos(d)
    u_dot, v_dot = 0.2 * np.cos(d) + 0.4 * np.sin(d), -0.2 * np.sin(d) + 0.4 * np.cos(d)
    np.testing.assert_allclose(deviates, (
        10.0, 20.0, HALF_PI + d, u, v, 0.5, u_dot + rate * v, v_dot - rate * u, 0.1,
    ))  # fmt: skip


# -- the search for waves --


def samples() -> _Samples:
    """A minute and a half of one train and noise, seen from a boat that wanders."""
    rng, time = np.random.default_rng(2), 0.4 * np.arange(220)
    place = np.cumsum(rng.normal(0.05, 0.2, (len(time), 2)), axis=0)
    unit = np.array([np.cos(2.0), np.sin(2.0)])
    push = 3.0 * np.sin(1.7 * time - 1.7**2 / GRAVITY * (place @ unit) + 0.3)
    return _Samples(time, place, push[:, None] * unit + rng.normal(0.0, 0.5, place.shape))


def test_the_power_of_a_grid_is_that_of_its_points_one_by_one() -> None:
    """Phases that go on from one frequency to the next, against each point by itself."""
    some = samples()
    omega, direction = 0.9 + 0.3 * np.arange(4), np.array([0.2, 2.0, 5.0])
    window = (some.time // 30.0).astype(int)
    expected = np.empty((3, 4))
    for i, theta in enumerate(direction):
        for j, w in enumerate(omega):
            each = some.filtered(np.array([w]), np.array([theta]))[0]
            expected[i, j] = sum(abs(each[window == k].sum()) ** 2 for k in range(3))
    np.testing.assert_allclose(some.power(omega, direction, 30.0), expected, rtol=1e-9)
    for few in (1, 2):  # of one frequency there is no next
        some_of_them = some.power(omega[2 : 2 + few], direction, 30.0)
        np.testing.assert_allclose(some_of_them, expected[:, 2 : 2 + few], rtol=1e-9)


def test_a_train_that_is_taken_away_leaves_what_was_there_besides() -> None:
    some = samples()
    train = {"force": 3.0, "omega": 1.7, "direction": 2.0, "phase": 0.3}
    left = some.without(train).force
    assert left.std(axis=0) == pytest.approx(0.5, abs=0.05)
    assert some.force.std() > 1.0


def test_a_point_is_refined_to_the_peak_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    some, window = samples(), 90.0
    monkeypatch.setattr("sim.effects.wave_trains.MIN_OMEGA", 1.5)
    monkeypatch.setattr("sim.effects.wave_trains.MAX_OMEGA", 1.95)
    peaks = _coarse_peaks(some, window, 0.1, 2.0 * np.pi / 96.0)
    assert len(peaks) == 8
    best = max(some.power(np.array([w]), np.array([t]), window)[0, 0] for w, t in peaks)
    (at,) = some.power(np.array([peaks[0][0]]), np.array([peaks[0][1]]), window)[0]
    assert at == pytest.approx(best)  # the best point comes first
    omega, theta = _refined(some, (1.66, 1.9), window, 0.01, 0.04)
    assert omega == pytest.approx(1.7, abs=0.02)
    assert theta == pytest.approx(2.0, abs=0.1)


def test_only_so_many_samples_are_searched_as_waves_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of ten a second each fourth; the second train is looked for in what the first leaves."""
    seen: list[Any] = []
    found = {"force": 2.0, "omega": 1.7, "direction": 0.0, "phase": 0.0}

    def strongest(given: Any) -> dict[str, float]:
        seen.append(given)
        return found

    monkeypatch.setattr("sim.effects.wave_trains._strongest", strongest)
    time = 0.1 * np.arange(101)
    rows = ResidualForce(time, np.zeros((101, 2)), np.ones((101, 2)))
    search = named("wave_motion").search
    assert search is not None
    assert search(None, lambda: rows) == [found, found]
    np.testing.assert_allclose(seen[0].time, time[::4])
    np.testing.assert_allclose(seen[1].force[:, 0], 1.0 - 2.0 * np.sin(1.7 * time[::4]))


# -- where searches begin --


@pytest.mark.parametrize(
    ("vessel", "orders", "turned"),
    [
        (WAMV, (0.0, 21.0), (0.0, 1.0, 2.0, 12.0)),
        (IACQUABOT, (0.0, 2143.0), (0.0, 1.0, 2.0, 3.0, 4.0, 1234.0)),
        (RUDDER_BOAT, (0.0,), (0.0, 1.0, 2.0)),  # one motor has no other side; its rudder may turn
    ],
    ids=lambda one: getattr(one, "name", None),
)
def test_wirings_are_plugs_of_both_sides_exchanged_and_motors_the_wrong_way_round(
    vessel: Vessel, orders: tuple[float, ...], turned: tuple[float, ...]
) -> None:
    search = named("actuator_wiring").search
    assert search is not None
    found = [(p["order"], p["reversed"]) for p in search(vessel, ResidualForce)]
    assert sorted(found) == sorted((o, r) for o in orders for r in turned if o or r)


def test_a_wind_is_looked_for_from_each_quarter_and_its_change_all_along() -> None:
    quarters = [0.0, HALF_PI, np.pi, 1.5 * np.pi]
    time = np.linspace(0.0, 100.0, 11)
    change, steady = named("wind_change"), named("steady_wind")
    assert change.search is not None
    assert change.more_starts is not None
    assert steady.more_starts is not None
    found = change.search(WAMV, lambda: ResidualForce(time, np.zeros((11, 2)), np.zeros((11, 2))))
    assert sorted((p["direction"], p["time"]) for p in found) == [
        (d, t) for d in quarters for t in (20.0, 40.0, 60.0, 80.0)
    ]
    assert all(p["later_direction"] == p["direction"] for p in found)
    assert {(p["speed"], p["later_speed"]) for p in found} == {(5.0, 5.0)}
    more = change.more_starts(100.0)
    assert {(p["speed"], p["later_speed"]) for p in more} == {
        (1.0, 10.0),
        (10.0, 1.0),
        (10.0, 10.0),
    }
    assert {(p["direction"], p["later_direction"]) for p in more} == {(d, d) for d in quarters}
    assert {p["time"] for p in more} == {20.0, 40.0, 60.0, 80.0}
    assert len(more) == 3 * 4 * 4
    assert [(p["speed"], p["direction"]) for p in steady.more_starts(100.0)] == [
        (speed, d) for speed in (1.0, 10.0) for d in quarters
    ]


def test_a_wind_on_assumed_areas_is_worth_a_range_of_speeds() -> None:
    """Areas of half to twice, and the coefficients beside them: 2.8 from end to end."""
    bare = replace(WAMV, hull=replace(WAMV.hull, wind_area=(0.0, 0.0)))
    front, side = bare.hull.areas
    values = {"speed": 8.0, "direction": -HALF_PI, "c_x": 0.6, "c_n": 0.1}
    told = named("steady_wind").assumption
    assert told is not None
    found = told(bare, values, {"speed": (7.0, 9.0)})
    assert found is not None
    factor = np.sqrt(2.0 * 1.4)
    assert found.ci95["speed"] == pytest.approx((7.0 / factor, 9.0 * factor))
    assert found.numbers["force_ahead_N"] == pytest.approx(0.5 * 1.225 * 64.0 * 0.6 * front)
    assert found.numbers["force_abeam_N"] == pytest.approx(0.5 * 1.225 * 64.0 * 0.825 * side)
    assert found.numbers["from_deg"] == pytest.approx(270.0)
    none = told(bare, values, {"speed": (-1.0, 9.0)})
    assert none is not None
    assert none.ci95["speed"][0] == 0.0
    both = named("wind_change").assumption
    assert both is not None
    later = {**values, "later_speed": 4.0, "later_direction": 0.0, "time": 50.0}
    change = both(bare, later, {"later_speed": (3.0, 5.0)})
    assert change is not None
    assert change.ci95["later_speed"] == pytest.approx((3.0 / factor, 5.0 * factor))
    assert change.numbers["force_abeam_N"] == pytest.approx(found.numbers["force_abeam_N"])
    assert change.numbers["later_force_abeam_N"] == pytest.approx(
        0.25 * found.numbers["force_abeam_N"]
    )
    assert both(WAMV, later, {}) is None


@pytest.mark.parametrize(
    ("nominal", "told"),
    [
        (16.0, ""),
        (7.5, ""),  # 400 %: a battery of twice the voltage
        (7.0, "the motors would give 459 % of the thrust in the file throughout"),
        (50.0, "the motors would give 9 % of the thrust in the file throughout"),
    ],
)
def test_no_battery_makes_motors_push_several_times_as_hard(nominal: float, told: str) -> None:
    """As it would where the thrust in the file is in pounds."""
    voltage = np.array([15.0, 15.0, 15.0, np.nan, 99.0])
    trial = SimpleNamespace(voltage=voltage, usable=np.array([True, True, True, True, False]))
    doubt = named("battery_sag").disbelieved
    assert doubt is not None
    assert doubt({"nominal": nominal}, [trial]) == told
    nobody_measured = SimpleNamespace(voltage=np.full(5, np.nan), usable=trial.usable)
    with warnings.catch_warnings(action="error"):
        assert doubt({"nominal": nominal}, [nobody_measured]) == ""


@pytest.mark.parametrize(
    ("bias", "beyond", "told"),
    [
        (0.026, 0.026, ""),
        (0.026, 0.0, "the two part by 0.0 °/s"),
        (0.026, -0.026, "the two part by -1.5 °/s"),
        (0.026, 0.01, ""),  # an estimate of the heading took a part
        (0.008, 0.0, ""),
    ],
)
def test_no_gyro_is_off_that_goes_with_the_heading(bias: float, beyond: float, told: str) -> None:
    """Of yaw damping that was not alike on both sides: "the gyro reads 1.5 °/s too fast"."""
    time, dt = 0.2 * np.arange(500), 0.2
    r = 0.4 * np.sin(0.3 * time)
    yaw = (0.4 / 0.3 * (1.0 - np.cos(0.3 * time)) + np.pi) % (2.0 * np.pi) - np.pi
    zero = np.zeros_like(r)
    trial = SimpleNamespace(
        nu=np.column_stack([zero, zero, r + beyond]), eta=np.column_stack([zero, zero, yaw]),
        usable=(time < 40.0) | (time > 60.0), dt=dt,
    )  # fmt: skip
    doubt = named("yaw_rate_bias").disbelieved
    assert doubt is not None
    said = doubt({"bias": bias}, [trial])
    assert said.endswith(told)
    assert bool(said) == bool(told)
    if told:
        assert said.startswith("a bias of 1.5 °/s would turn the gyro's sum away from the heading")


@pytest.mark.parametrize(
    ("gain", "mass", "told"),
    [
        (1.46, 383.0, "m11 goes along from 264 to 383 kg, and motion tells thrust over mass alone"),
        (0.7, 184.0, "m11 goes along from 264 to 184 kg, and motion tells thrust over mass alone"),
        (1.46, 270.0, ""),  # the mass is as it was: the motors push harder
        (0.7, 300.0, ""),
        (1.0, 300.0, ""),
    ],
)
def test_motors_push_no_harder_where_the_boat_gets_as_much_heavier(
    gain: float, mass: float, told: str
) -> None:
    """All motors 46 % harder, a hull 45 % heavier: told of a boat that was as in the file."""
    undone = named("thrust_scale").undone
    assert undone is not None
    given, fitted = SimpleNamespace(m11=264.0), SimpleNamespace(m11=mass)
    assert undone({"gain": gain}, given, fitted) == told
