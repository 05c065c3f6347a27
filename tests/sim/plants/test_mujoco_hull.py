"""The hull in MuJoCo floats as hydrostatics has it, moves as the vessel does, rides waves."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import EFFECTS
from sim.following.follower import FollowerOptions
from sim.following.stepwise import PlantFollower, follower_for
from sim.hil.boat import Boat
from sim.hil.day import Day, Moment
from sim.model import Model
from sim.plants import MUJOCO, VESSEL, PlantChoice
from sim.plants.mujoco_hull import MujocoHull, floating_hull
from sim.plants.plant import FloatingPlant, InvertiblePlant, PlantInputs, PlantMotion, VesselPlant
from sim.plants.waves import GRAVITY, Sea, hull_shape
from sim.state import Pose, Velocity, Wrench
from sim.vessel import Floating
from tests.sim.vessels import IACQUABOT, WAMV

AIR = PlantInputs(0.0, np.nan, np.nan, np.nan)
STILL = PlantMotion(Pose(3.0, -2.0, 0.7), Velocity(0.0, 0.0, 0.0))
NOTHING = Wrench(0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def hull():
    return MujocoHull.of(Model.of(WAMV))


def sailed(plant, state, tau, seconds, inputs=AIR, dt=0.02):
    """States after each step."""
    out = []
    for k in range(round(seconds / dt)):
        state = plant.step(state, tau, inputs._replace(time=k * dt), dt)
        out.append(state)
    return out


def test_it_is_a_floating_plant_that_nothing_inverts(hull):
    assert isinstance(hull, FloatingPlant)
    assert not isinstance(hull, InvertiblePlant)
    assert isinstance(VesselPlant(Model.of(WAMV)), InvertiblePlant)


def test_at_rest_it_stays_at_rest(hull):
    state = sailed(hull, hull.initial_state(STILL, AIR), NOTHING, 2.0)[-1]
    assert hull.motion(state).pose == pytest.approx(STILL.pose, abs=1e-9)
    assert max(map(abs, hull.afloat(state, NOTHING, AIR))) < 1e-9


@pytest.mark.parametrize(
    "vessel", [WAMV, pytest.param(IACQUABOT, marks=pytest.mark.slow)], ids=lambda v: v.name
)
def test_in_calm_water_it_moves_as_the_vessel_does(vessel):
    tau, moving = Wrench(60.0, 5.0, 15.0), PlantMotion(Pose(0.0, 0.0, 0.4), Velocity(0.8, 0.1, 0.1))
    ends = []
    for plant in (MujocoHull.of(Model.of(vessel)), VesselPlant(Model.of(vessel))):
        state = sailed(plant, plant.initial_state(moving, AIR), tau, 6.0)[-1]
        ends.append(np.array([*plant.motion(state).pose[:2], *plant.motion(state).velocity]))
    assert np.abs(ends[0] - ends[1]).max() < 0.02
    assert np.abs(ends[0][:2]).max() > 3.0


@pytest.mark.parametrize(("axis", "rate"), [(0, "heave_rate"), (1, "roll_rate"), (2, "pitch_rate")])
def test_it_oscillates_as_hydrostatics_has_it(hull, axis, rate):
    """Half a period of the free oscillation of each degree, damped as there."""
    h = WAMV.hull
    shape = hull_shape(h.length, h.beam, h.mass)
    state, damping = hull.initial_state(STILL, AIR), getattr(shape, rate.replace("rate", "damping"))
    place = list(state.position)
    if axis == 0:
        place[2] = 0.004
    else:
        turn = np.zeros(3)
        turn[axis - 1] = 0.5 * 0.002
        yaw = np.array([np.cos(0.35), 0.0, 0.0, np.sin(0.35)])
        place[3:] = [yaw[0], *(yaw[0] * turn + np.cross([0.0, 0.0, yaw[3]], turn))]
        place[6] += yaw[3]
    states = sailed(hull, state._replace(position=tuple(place)), NOTHING, 3.0, dt=0.005)
    moved = [hull.afloat(s, NOTHING, AIR)[axis] for s in states]
    signs = np.signbit(moved)
    crossings = 0.005 * np.flatnonzero(signs[1:] != signs[:-1])
    half_period = np.diff(crossings[:3]).mean()
    expected = np.pi / (getattr(shape, rate) * np.sqrt(1.0 - damping**2))
    assert half_period == pytest.approx(expected, rel=0.05)


def test_long_waves_lift_it_and_short_ones_do_not(hull):
    def rise(period):
        trains = Sea(0.02 * period, period).trains(1)
        states = sailed(hull, hull.initial_state(STILL, AIR), NOTHING, 4 * period,
                        AIR._replace(waves=trains))  # fmt: skip
        at = [hull.afloat(s, NOTHING, AIR._replace(waves=trains, time=0.02 * (k + 1)))
              for k, s in enumerate(states)]  # fmt: skip
        return np.std([-a.down for a in at]) / np.std([a.elevation for a in at])

    assert rise(8.0) == pytest.approx(1.0, abs=0.05)
    assert rise(1.0) < 0.5


def test_a_high_centre_of_gravity_and_a_wrong_inertia_are_one_line():
    with pytest.raises(ValueError, match="would fall to the side: its metacentric height"):
        floating_hull(replace(WAMV, floating=Floating(centre_of_gravity=-50.0)))
    thin = Floating(inertia=(1.0, 1.0, 500.0))
    with pytest.raises(ValueError, match=r"floating.inertia = \(1.0, 1.0, 500.0\)"):
        MujocoHull.of(Model.of(replace(WAMV, floating=thin)))


@pytest.mark.parametrize("package", ["mujoco", "osqp"])
def test_a_package_that_is_missing_is_one_line(monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ValueError, match=r"pip install 'shadow-gateway\[mujoco\]'"):
        follower_for(Model.of(WAMV), FollowerOptions(limits=True), MUJOCO)


def test_columns_of_the_file_carry_the_hull():
    """Two narrow pontoons far apart: stiffer in roll than the box that is assumed."""
    points = tuple((x, y, 0.065) for x in np.linspace(-1.75, 1.75, 8) for y in (-0.98, 0.98))
    given = floating_hull(replace(WAMV, floating=Floating(points=points, thruster_depth=0.4)))
    assert given.numbers.draught == pytest.approx(180.0 / (1025.0 * 16 * 0.065))
    assert given.rates[1] ** 2 == pytest.approx(
        180.0 * GRAVITY * (1025.0 * 16 * 0.065 * 0.98**2 / 180.0) / (1.2 * given.numbers.I_x)
    )
    plant = MujocoHull.of(Model.of(replace(WAMV, floating=Floating(thruster_depth=0.4))))
    ahead = sailed(plant, plant.initial_state(STILL, AIR), Wrench(80.0, 0.0, 0.0), 4.0)[-1]
    assert plant.afloat(ahead, NOTHING, AIR).pitch > 1e-4  # pushed below: the bow rises


def lead(vessel, count=200):
    """A voyage of that vessel: (T, 9) every 20 ms."""
    t = 0.02 * np.arange(count)
    side = np.column_stack([0.5 + 0.3 * np.sin(t), 0.5 - 0.2 * np.sin(1.4 * t)])
    commands = side[:, [0 if x.position[1] < 0 else 1 for x in vessel.thrusters]]
    return t, Model.of(vessel).simulate(commands, 0.02)[1][0, :-1]


@pytest.mark.parametrize("limits", [False, True])
def test_it_follows_by_prediction_as_well_as_the_vessel_does_by_inversion(limits):
    times, reference = lead(IACQUABOT)
    options = FollowerOptions(limits=limits)
    for kind, most in ((VESSEL, 0.01), (MUJOCO, 0.012)):
        follower = follower_for(Model.of(WAMV), options, kind)
        result = follower.advance(follower.start(), times, reference)
        error = np.abs(result.shadows[:, :6] - reference[:, :6])[:, [0, 1, 3, 5]]
        assert error.max() < most
        assert not result.diverged.any()


def test_thrust_stays_within_its_limits_and_says_so():
    """Asked for a speed that its thrusters cannot give: full ahead, both, and no more."""
    times, reference = np.arange(0.0, 2.0, 0.02), np.zeros((100, 9))
    reference[:, 3], reference[:, 0] = 4.0, 4.0 * np.arange(0.0, 2.0, 0.02)
    still = reference * [[0.0] * 9]
    follower = PlantFollower.of(MujocoHull.of(Model.of(WAMV)), FollowerOptions(limits=True), WAMV)
    begun = follower.advance(follower.start(), times[:1], still[:1]).state
    result = follower.advance(begun, times[1:], reference[1:])
    assert result.forces[5:, 0] == pytest.approx(180.0, abs=1e-3)
    assert np.abs(result.forces[5:, 2]).max() < 1e-3
    assert result.limited[5:].all()


def test_how_rows_are_cut_does_not_matter():
    times, reference = lead(IACQUABOT, 60)
    follower = follower_for(Model.of(WAMV), FollowerOptions(limits=True), MUJOCO)
    whole = follower.advance(follower.start(), times, reference)
    state, parts = follower.start(), []
    for part in (slice(0, 7), slice(7, 8), slice(8, 60)):
        one = follower.advance(state, times[part], reference[part])
        state = one.state
        parts.append(one.shadows)
    np.testing.assert_array_equal(np.vstack(parts), whole.shadows)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [MUJOCO, VESSEL], ids=lambda k: k.name)
def test_an_autopilot_drives_it_as_it_drives_the_vessel(kind):
    """In calm water; a current that rises carries the plant too."""
    current = {e.name: e for e in EFFECTS}["steady_current"]
    rise = Moment(1.0, effect=current, values={"speed": 0.4, "direction": 1.0})
    plant = PlantChoice(kind, WAMV)
    boats = [Boat.of(WAMV, Day(moments=(rise,))), Boat.of(WAMV, Day(moments=(rise,)), plant=plant)]
    ends = []
    for boat in boats:
        state = boat.start()
        for _ in range(300):
            state, readings, truth = boat.step(state, {1: 1700.0, 2: 1600.0}, 0.02)
        ends.append((truth, readings))
    (own, felt), (other, also) = ends
    assert np.array(other[1:11]) == pytest.approx(np.array(own[1:11]), abs=0.02)
    assert other.water_north == pytest.approx(0.4 * np.cos(1.0))
    assert np.array(also.accel) == pytest.approx(np.array(felt.accel), abs=0.03)


def test_what_it_reads_in_waves_fits_together():
    """Gyro and accelerometer of the boat in MuJoCo are the derivatives of attitude and velocity."""
    dt = 2e-3
    boat = Boat.of(WAMV, Day(sea=Sea(0.6, 4.0, 0.7)), seed=3, plant=PlantChoice(MUJOCO))
    state, readings = boat.start(), []
    for _ in range(400):
        state, reading, _ = boat.step(state, {1: 1700.0, 2: 1600.0}, dt)
        readings.append(reading)
    for k in range(100, 399, 90):
        now = readings[k]
        a = (np.array(readings[k + 1].velocity) - readings[k - 1].velocity) / (2 * dt)
        norm = np.linalg.norm(a - [0.0, 0.0, GRAVITY])
        assert np.linalg.norm(now.accel) == pytest.approx(norm, abs=0.02)
        rates = (np.array(readings[k + 1].attitude) - readings[k - 1].attitude) / (2 * dt)
        assert now.gyro[0] == pytest.approx(rates[0] - rates[2] * np.sin(now.attitude[1]), abs=2e-3)
