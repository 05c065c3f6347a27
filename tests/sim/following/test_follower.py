"""The follower: law, limits, plants, and that chunks make no difference."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.effect import Effect, Parameter, Scope
from sim.following import MAX_SPEED_MPS, MAX_TURN_RADPS
from sim.following.follower import Axes, ControlLaw, FollowerOptions, VesselFollower
from sim.following.stepwise import Inversion, PlantFollower, follower_for
from sim.model import Model
from sim.plants import PlantKind
from sim.plants.plant import VesselPlant
from sim.state import Wrench
from sim.vessel import AddedEffect
from tests.sim.simulated import on_floats
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, WAMV, excitation

DT = 0.02
LOOSE = FollowerOptions(integral=0.0, position=0.0, heading=0.0)


def push(flow, p):
    """A constant force and moment on the hull -> X, Y, N [N, N, N m]."""
    return Wrench(p.X, p.Y, p.N)


PUSH = Effect(
    "push",
    Scope.VOYAGE,
    tuple(Parameter(axis, "N", -100.0, 100.0, 0.0) for axis in "XYN"),
    "a constant push",
    force=push,
)


def steady(seconds, u=0.0, v=0.0, r=0.0):
    """A reference at constant body velocity from the first row on: times (K,), rows (K, 9)."""
    times = np.arange(0.0, seconds + DT / 2, DT)
    rows = np.zeros((len(times), 9))
    rows[:, 0], rows[:, 1], rows[:, 2] = u * times, v * times, r * times
    rows[:, 3:6] = u, v, r
    return times, rows


def moving(vessel, seconds=20.0):
    """A simulated voyage as a reference: times (K,), rows (K, 9)."""
    commands = excitation(vessel, seconds, DT)
    _, reports = Model.of(vessel).simulate(commands, DT)
    return DT * np.arange(len(commands) + 1), reports[0]


def offset_decay(options, over, after=5 * DT):
    """Surge error after a step of the reference of 1 m/s, and its mean rate of decay [1/s]

    over that long, beginning that long after the step.
    """
    times, rows = steady(6.0, u=1.0)
    rows[0, 3] = 0.0  # the plant starts at rest
    follower = VesselFollower.of(Model.of(WAMV), options)
    shadows = follower.advance(follower.start(), times, rows).shadows
    error = rows[:, 3] - shadows[:, 3]
    a = round(after / DT)
    b = a + round(over / DT)
    return error, np.log(error[a] / error[b]) / (times[b] - times[a])


@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0, 4.0])
def test_an_error_of_1_mps_decays_at_the_rate(gain):
    _, rate = offset_decay(replace(LOOSE, rate=gain), over=1.0)
    assert rate == pytest.approx(gain, rel=0.1)


def test_the_default_gains_decay_at_their_rate_too():
    # within the first time constant: later the outer loop and the integral are what is left of it
    tau = 1.0 / FollowerOptions().rate
    _, rate = offset_decay(FollowerOptions(), over=0.8 * tau, after=0.2 * tau)
    assert rate == pytest.approx(FollowerOptions().rate, rel=0.1)


def test_the_printed_law_leaves_its_error_standing():
    error, _ = offset_decay(FollowerOptions(law=ControlLaw.PRINTED), over=1.0)
    assert error[-1] == pytest.approx(error[1], rel=1e-3)
    assert error[-1] > 0.9


@pytest.mark.usefixtures("plain_laws")
def test_ten_newtons_that_the_vessel_does_not_know_are_missing_force():
    boat = WAMV.with_effects(AddedEffect(PUSH, {"X": 6.0, "Y": -10.0, "N": 3.0}))
    commands = excitation(WAMV, 60.0, DT)
    _, reports = Model.of(boat).simulate(commands, DT)
    times = DT * np.arange(len(commands))
    missing, _ = Model.of(WAMV).missing_force(reports[0, :-1], times, commands, commands)
    np.testing.assert_allclose(missing, np.tile([6.0, -10.0, 3.0], (len(times), 1)), atol=1e-6)


@pytest.mark.usefixtures("plain_laws")
def test_the_force_that_follows_shows_the_push_as_well():
    """In steady motion τ_c is what the boat's thrusters and the push give together."""
    boat = Model.of(WAMV.with_effects(AddedEffect(PUSH, {"X": 10.0, "Y": 0.0, "N": 0.0})))
    commands = np.full((3000, 2), 0.4)
    _, reports = boat.simulate(commands, DT)
    follower = VesselFollower.of(Model.of(WAMV))
    followed = follower.advance(follower.start(), DT * np.arange(3001), reports[0])
    assert followed.forces[-1, 0] == pytest.approx(2 * 0.4 * 90.0 + 10.0, abs=1.0)


def test_another_vessel_tracks_the_boat():
    """Table 7 of the paper: WAM-V follows IAcquaBot (its errors: 0.0048, 0.0017, 0.0015)."""
    times, rows = moving(IACQUABOT, 60.0)
    follower = VesselFollower.of(Model.of(WAMV))
    shadows = follower.advance(follower.start(), times, rows).shadows
    rmse = np.sqrt(np.mean((rows - shadows) ** 2, axis=0))
    assert np.all(rmse[3:6] <= [0.0048, 0.0017, 0.0015])
    assert np.all(rmse[:3] <= [0.0162, 0.0377, 0.0031])


def under_side_force(axes):
    """Sway of the boat and of its shadow where a side force acts that no thruster explains."""
    boat = WAMV.with_effects(AddedEffect(PUSH, {"X": 0.0, "Y": 30.0, "N": 0.0}))
    _, reports = on_floats(boat).simulate(np.full((3000, 2), 0.3), DT)
    follower = VesselFollower.of(Model.of(WAMV), FollowerOptions(axes=axes))
    shadows = follower.advance(follower.start(), DT * np.arange(3001), reports[0]).shadows
    return reports[0, -1], shadows[-1]


def test_three_axes_hold_sway_under_a_side_force():
    boat, shadow = under_side_force(Axes.THREE)
    assert boat[4] > 0.3
    assert shadow[4] == pytest.approx(boat[4], abs=0.01)
    assert np.hypot(*(shadow[:2] - boat[:2])) < 0.1


def test_surge_and_yaw_alone_do_not():
    boat, shadow = under_side_force(Axes.SURGE_YAW)
    assert abs(shadow[4] - boat[4]) > 0.3
    assert np.hypot(*(shadow[:2] - boat[:2])) > 5.0


def test_limits_bind_and_say_so():
    times, rows = steady(20.0, u=1.5)  # takes 121 of 180 N through the water, once up to speed
    rows[0, 3] = 0.0
    follower = VesselFollower.of(Model.of(WAMV), FollowerOptions(limits=True))
    followed = follower.advance(follower.start(), times, rows)
    assert followed.limited[2]
    assert followed.forces[:, 0].max() <= 180.0 + 1e-9
    assert not followed.limited[-1]
    free = VesselFollower.of(Model.of(WAMV))
    assert not free.advance(free.start(), times, rows).limited.any()


def test_what_limits_withhold_is_not_saved_up_for_later():
    """A minute at the limits, then a speed within them: no overshoot from a wound-up integral."""
    times, rows = steady(90.0, u=1.0)
    rows[:3000, 3] = 3.0
    wound = FollowerOptions(integral=1.0, position=0.0, limits=True)
    follower = VesselFollower.of(Model.of(WAMV), wound)
    followed = follower.advance(follower.start(), times, rows)
    assert followed.limited[1000:3000].all()
    np.testing.assert_allclose(followed.shadows[3500:, 3], 1.0, atol=0.05)


def test_a_rudder_boat_cannot_be_limited_by_thrust_alone():
    with pytest.raises(ValueError, match="limits"):
        VesselFollower.of(Model.of(RUDDER_BOAT), FollowerOptions(limits=True))


@pytest.mark.parametrize(
    "options", [FollowerOptions(), FollowerOptions(axes=Axes.SURGE_YAW, limits=True)]
)
def test_any_plant_follows_as_the_compiled_one_does(options):
    model = Model.of(WAMV.with_effects(AddedEffect(PUSH, {"X": 1.0, "Y": 2.0, "N": 3.0})))
    times, rows = moving(IACQUABOT, 6.0)
    times[100:] += 0.37  # a gap
    jumps = np.zeros(len(times), bool)
    jumps[200] = True
    rows[200:, :2] += 40.0
    rows[100:, 2] -= 2 * np.pi  # wrapped
    rows[150:170, 3] += 1.5  # more than the thrusters can give
    fast, slow = (
        VesselFollower.of(model, options),
        PlantFollower.of(VesselPlant(model), options, WAMV),
    )
    a = fast.advance(fast.start(), times, rows, jumps)
    b = slow.advance(slow.start(), times, rows, jumps)
    np.testing.assert_allclose(a.shadows, b.shadows, rtol=0, atol=1e-9)
    np.testing.assert_allclose(a.forces, b.forces, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(a.limited, b.limited)
    assert a.limited.any() == options.limits


@pytest.mark.parametrize("kind", [VesselFollower, PlantFollower])
@pytest.mark.parametrize("size", [1, 7, 50])
def test_chunks_make_no_difference(kind, size):
    model = Model.of(WAMV)
    follower = (
        VesselFollower.of(model) if kind is VesselFollower else PlantFollower.of(VesselPlant(model))
    )
    times, rows = moving(IACQUABOT, 2.0)
    times[30] = times[29]  # a duplicate, and late
    times[40] = times[37]
    jumps = np.arange(len(times)) % 45 == 44
    whole = follower.advance(follower.start(), times, rows, jumps)
    state, parts = follower.start(), []
    for k in range(0, len(times), size):
        cut = slice(k, k + size)
        part = follower.advance(state, times[cut], rows[cut], jumps[cut])
        state = part.state
        parts.append(part)
    np.testing.assert_array_equal(np.concatenate([p.shadows for p in parts]), whole.shadows)
    np.testing.assert_array_equal(np.concatenate([p.forces for p in parts]), whole.forces)
    np.testing.assert_array_equal(state.carry, whole.state.carry)


@pytest.mark.parametrize("kind", [VesselFollower, PlantFollower])
def test_a_wild_time_is_no_span_to_run_over(kind):
    """One row eleven days ahead: 10⁸ steps if it were followed."""
    model = Model.of(WAMV)
    follower = kind.of(model if kind is VesselFollower else VesselPlant(model))
    times, rows = moving(IACQUABOT, 2.0)
    whole = follower.advance(follower.start(), times, rows)
    wild = times.copy()
    wild[40] = 1e6
    out = follower.advance(follower.start(), wild, rows)
    np.testing.assert_array_equal(out.shadows[:40], whole.shadows[:40])
    np.testing.assert_array_equal(out.shadows[40:42, :6], rows[40:42, :6])  # set anew, twice
    np.testing.assert_allclose(out.shadows[-1, :6], rows[-1, :6], atol=0.05)
    assert not out.diverged.any()


@pytest.mark.parametrize("kind", [VesselFollower, PlantFollower])
def test_a_plant_that_diverges_begins_anew_and_says_so(kind):
    light = replace(WAMV, dynamics=replace(WAMV.dynamics, m11=1e-3, m33=1e-3, X_uu=-1e3))
    model = Model.of(light)
    follower = kind.of(model if kind is VesselFollower else VesselPlant(model))
    times, rows = steady(1.0, u=2.0)
    rows[20:, 3] = 5.0
    out = follower.advance(follower.start(), times, rows)
    assert out.diverged.any()
    assert not out.diverged[0]
    assert np.abs(out.shadows[:, 3:5]).max() <= MAX_SPEED_MPS
    assert np.abs(out.shadows[:, 5]).max() <= MAX_TURN_RADPS


def test_a_step_returns_a_new_state():
    follower = VesselFollower.of(Model.of(WAMV))
    times, rows = steady(0.2, u=1.0)
    start = follower.start()
    before = start.carry.copy()
    follower.advance(start, times, rows)
    np.testing.assert_array_equal(start.carry, before)
    with pytest.raises(ValueError, match="read-only"):
        start.carry[0] = 1.0


def test_following_is_not_copying():
    """The plant's velocity changes by its force alone: a jump of the reference takes time."""
    times, rows = steady(1.0)
    rows[25:, 3] = 1.0
    follower = VesselFollower.of(Model.of(WAMV))
    shadows = follower.advance(follower.start(), times, rows).shadows
    assert shadows[25, 3] < 0.1


def test_options_are_checked_where_they_are_made():
    with pytest.raises(ValueError, match="rate"):
        FollowerOptions(rate=0.0)
    with pytest.raises(ValueError, match="integral"):
        FollowerOptions(integral=-1.0)
    with pytest.raises(ValueError, match="sideways"):
        FollowerOptions(axes="sideways")


def test_a_kind_of_plant_is_built_from_the_model():
    model = Model.of(WAMV)
    assert isinstance(follower_for(model), VesselFollower)
    slow = PlantKind("slow", "the same, step by step", VesselPlant)
    follower = follower_for(model, FollowerOptions(limits=True), slow)
    assert isinstance(follower, PlantFollower)
    assert follower.plant == VesselPlant(model)
    assert isinstance(follower.controller, Inversion)
    assert len(follower.controller.limits.low) == len(WAMV.thrusters)
