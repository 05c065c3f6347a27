"""Laws over every effect of the catalogue, alone and all together."""

import inspect
from collections import namedtuple
from dataclasses import replace

import numba
import numpy as np
import pytest

from sim.body import Body, Flow, Report, RudderParameters, ThrusterParameters
from sim.effects import cubic_drag, heading_offset, steady_current, thruster_lag
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import LAWS, Effect, Need, Parameter, Scope
from sim.following.reference import Reference, ReferenceMode
from sim.kernel.cache import plain_kernel_for
from sim.model import InputTable, Model, Runs
from sim.state import Inertia, Pose, Water, Wrench
from sim.vessel import AddedEffect, Vessel
from tests.sim.vessels import (
    ANTENNA,
    IACQUABOT,
    RUDDER_BOAT,
    SHAPES,
    STEERED_BOAT,
    WAMV,
    added,
    every_effect,
    excitation,
)

DT = 0.02
SECONDS = 12.0
every = pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)


def home(effect: Effect) -> Vessel:
    """A vessel on which the effect can be seen: one that steers, for effects of steering."""
    return RUDDER_BOAT if Need.STEERING in effect.needs else WAMV


def surroundings(count):
    """Voltage (T,) of a battery half empty, and a steady measured wind (T, 2)."""
    return {"voltage": np.full(count, 14.0), "wind": np.tile([2.0, -3.0], (count, 1))}


def voyage(vessel):
    """Model, commands (T, na), states (T, nx), reports (T, 9) of a free run with all inputs."""
    model, commands = Model.of(vessel), excitation(vessel, SECONDS, DT)
    states, reports = model.simulate(commands, DT, **surroundings(len(commands)))
    return model, commands, states[0, :-1], reports[0, :-1]


def at_once(model, commands, states):
    """Reports (T, 9) as each moment alone tells them: without a past, late sensors extrapolate."""
    count = len(states)
    nothing = np.zeros(count, np.int64)
    inputs = InputTable.of(commands[None], DT, **surroundings(count))
    runs = Runs(nothing, np.arange(count), nothing, np.zeros(count))
    return model.run(states, runs, inputs)[1][:, 0]


def acting(commands, delay):
    """Commands (T, na), `delay` [s] late, as means over the steps."""
    shift = delay / DT
    whole, part = int(shift), shift - int(shift)
    late = [commands[np.maximum(np.arange(len(commands)) - whole - i, 0)] for i in (0, 1)]
    return (1.0 - part) * late[0] + part * late[1]


def missing_along(model, commands, reports):
    """Missing force (T, 3) along a motion with the surroundings of `voyage`."""
    around = acting(commands, model.delay)
    before = np.concatenate([around[:1], around[:-1]])
    times = DT * np.arange(len(commands))
    air = surroundings(len(commands))
    return model.missing_force(reports, times, before, around, **air)[0]


def arguments(rng, count):
    """Values for every argument name that a law may ask for: arrays (count,)."""

    def uniform(low, high):
        return rng.uniform(low, high, count)

    body = Body(*(np.full(count, getattr(WAMV.dynamics, n, 1.3)) for n in Body._fields))
    flow = Flow(*(uniform(-2.0, 2.0) for _ in Flow._fields[:-1]), body)
    flow = flow._replace(time=uniform(0.0, 300.0), voltage=uniform(12.0, 16.0))
    return {
        "commands": (uniform(-1.0, 1.0), uniform(-1.0, 1.0)), "place": np.arange(count) % 2.0,
        "c": uniform(-1.0, 1.0), "command": uniform(-1.0, 1.0),
        "F": uniform(-80.0, 80.0), "thrust": uniform(-80.0, 80.0),
        "angle": uniform(-0.6, 0.6), "δ": uniform(-0.6, 0.6), "azimuth": uniform(-3.0, 3.0),
        "state": uniform(-50.0, 50.0), "time": uniform(0.0, 300.0),
        "drive": ThrusterParameters(*(uniform(0.1, 2.0) for _ in ThrusterParameters._fields)),
        "blade": RudderParameters(*(uniform(0.1, 2.0) for _ in RudderParameters._fields)),
        "flow": flow, "pose": Pose(*(uniform(-3.0, 3.0) for _ in range(3))),
        "M": Inertia(*(uniform(50.0, 90.0) for _ in range(6))),
        "report": Report(*(uniform(-2.0, 2.0) for _ in range(9))),
    }  # fmt: skip


def parameters_of(values):
    """The parameters as a law takes them."""
    return namedtuple("Parameters", values)(**values)


def at(value, k):
    """Row k of arrays, however deep in tuples."""
    if isinstance(value, tuple):
        rows = [at(part, k) for part in value]
        return type(value)(*rows) if hasattr(value, "_fields") else tuple(rows)
    return float(value[k])


@every
def test_one_law_serves_arrays_and_compiled_scalars(effect):
    count, values = 40, added(effect).values
    given = arguments(np.random.default_rng(5), count)
    for place, law in effect.laws.items():
        names = list(inspect.signature(law).parameters)
        p = parameters_of(values)
        whole = law(*(p if n == "p" else given[n] for n in names))
        compiled = numba.njit(error_model="numpy")(law)
        parts = whole if isinstance(whole, tuple) else (whole,)
        table = np.stack([np.broadcast_to(part, count) for part in parts])
        for k in range(count):
            one = compiled(*(p if n == "p" else at(given[n], k) for n in names))
            np.testing.assert_allclose(
                np.ravel(one), table[:, k], rtol=1e-12, atol=1e-12, err_msg=place
            )


@every
def test_balance_of_a_simulated_motion_is_zero(effect):
    model, commands, states, _ = voyage(home(effect).with_effects(added(effect)))
    reports = at_once(model, commands, states)
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda v: v.name)
def test_balance_is_zero_with_all_effects_at_once_on_every_shape(vessel):
    vessel = replace(vessel, sensors=ANTENNA).with_effects(*every_effect(vessel))
    model, commands, states, _ = voyage(vessel)
    reports = at_once(model, commands, states)
    assert np.isfinite(states).all()
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7


@every
def test_leaving_an_effect_out_is_seen_everywhere(effect):
    """In the simulation, in the missing force and in the prediction alike."""
    plain = home(effect)
    model, commands, states, reports = voyage(plain.with_effects(added(effect)))
    without, _, _, said = voyage(plain)
    assert np.abs(reports - said).max() > 1e-3
    assert np.abs(missing_along(without, commands, reports)).max() > 0.01
    reports = at_once(model, commands, states)
    new = np.any(commands != np.roll(commands, 1, axis=0), axis=1)
    times = DT * np.arange(len(commands))
    air = surroundings(len(commands))
    ends = []
    for m in (model, without):
        late = acting(commands, m.delay)
        before = np.concatenate([late[:1], late[:-1]])
        reference = Reference(m, ReferenceMode.MODEL)
        ends.append(
            reference.advance(
                reference.start(), times, reports, np.ones(len(times), bool), before, **air
            ).references
        )
    equal = np.abs(ends[0][:, :6] - reports[:, :6]).max(axis=1) < 1e-7
    # where a late sensor extrapolates, a new command counts at once or from the next row on
    assert equal[~new].all() if effect.latency else equal.all()
    assert np.abs(ends[1] - reports).max() > 1e-3


@every
def test_the_kernel_in_plain_python_equals_the_compiled_one(effect):
    agree_in_both(home(effect).with_effects(added(effect)))


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda v: v.name)
def test_all_together_in_plain_python_equal_the_compiled_kernel(vessel):
    agree_in_both(replace(vessel, sensors=ANTENNA).with_effects(*every_effect(vessel)))


def agree_in_both(vessel):
    """Free runs of a batch, the missing force and a prediction: compiled against plain Python."""
    fast = Model.of(vessel)
    slow = replace(fast, kernel=plain_kernel_for(fast.kernel.structure))
    assert fast.kernel.compiled
    assert not slow.kernel.compiled
    commands = np.stack([excitation(vessel, 2.0, DT, seed) for seed in (1, 2)])
    air = surroundings(commands.shape[1])
    start = np.random.default_rng(2).normal(0.0, 0.4, (2, 6))
    a, b = (m.simulate(commands, DT, start, **air) for m in (fast, slow))
    np.testing.assert_allclose(b[0], a[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(b[1], a[1], rtol=0, atol=1e-12)
    part = slice(0, 20)
    rows, held = a[1][0, part], commands[0, part]
    few = {name: values[part] for name, values in air.items()}
    times = DT * np.arange(20)
    forces = [m.missing_force(rows, times, held, held, **few)[0] for m in (fast, slow)]
    np.testing.assert_allclose(forces[1], forces[0], rtol=0, atol=1e-9)


@every
def test_a_boats_own_effect_moves_nothing_by_itself(effect):
    if effect.scope is Scope.VOYAGE:
        pytest.skip("a voyage brings energy of its own: current, wind, waves")
    vessel = home(effect).with_effects(added(effect))
    states, _ = Model.of(vessel).simulate(np.zeros((50, len(vessel.actuators))), DT)
    assert not states[..., :6].any()


def test_sensor_effects_leave_the_motion_alone():
    a, b = voyage(WAMV), voyage(WAMV.with_effects(added(heading_offset.EFFECT)))
    np.testing.assert_array_equal(a[2], b[2])
    assert np.abs(a[3] - b[3]).max() > 0.1


@pytest.mark.parametrize("angle", [-0.8, -0.1, 0.3, 0.8])
def test_the_true_motion_is_found_behind_the_reported_one(angle):
    vessel = replace(IACQUABOT, sensors=ANTENNA).with_effects(
        AddedEffect(heading_offset.EFFECT, {"angle": angle})
    )
    model, commands, states, reports = voyage(vessel)
    np.testing.assert_allclose(model.true_states(reports), states[:, :6], rtol=0, atol=1e-9)
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7


def test_the_antenna_moves_as_a_point_of_the_boat():
    """Its reported velocity is the time derivative of its reported position."""
    _, _, _, reports = voyage(replace(WAMV, sensors=ANTENNA))
    rate = np.gradient(reports[:, :3], DT, axis=0)[1:-1]
    yaw, u, v = reports[1:-1, 2:5].T
    np.testing.assert_allclose(rate[:, 0], np.cos(yaw) * u - np.sin(yaw) * v, atol=0.01)
    np.testing.assert_allclose(rate[:, 1], np.sin(yaw) * u + np.cos(yaw) * v, atol=0.01)


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda v: v.name)
def test_a_boat_adrift_goes_with_the_current(vessel):
    current = AddedEffect(steady_current.EFFECT, {"speed": 0.4, "direction": 2.0})
    model = Model.of(vessel.with_effects(current))
    states, _ = model.simulate(np.zeros((6000, len(vessel.actuators))), 0.1)
    yaw, u, v, r = states[0, -1, 2:6]
    north, east = np.cos(yaw) * u - np.sin(yaw) * v, np.sin(yaw) * u + np.cos(yaw) * v
    np.testing.assert_allclose(
        [north, east, r], [0.4 * np.cos(2.0), 0.4 * np.sin(2.0), 0.0], atol=1e-6
    )


@pytest.mark.parametrize("vessel", [WAMV, RUDDER_BOAT, STEERED_BOAT], ids=lambda v: v.name)
def test_a_current_carries_the_voyage_along(vessel):
    """Seen from the drifting water, the voyage is the one in still water (Galileo)."""
    current = AddedEffect(steady_current.EFFECT, {"speed": 0.4, "direction": 2.0})
    flow = 0.4 * np.array([np.cos(2.0), np.sin(2.0)])
    commands = excitation(vessel, 20.0, 0.05)
    still, _ = Model.of(vessel).simulate(commands, 0.05)
    start = np.array([0.0, 0.0, 0.0, *flow, 0.0])
    moving, _ = Model.of(vessel.with_effects(current)).simulate(commands, 0.05, start)
    time = 0.05 * np.arange(len(commands) + 1)
    np.testing.assert_allclose(moving[0, :, :2] - time[:, None] * flow, still[0, :, :2], atol=1e-5)
    np.testing.assert_allclose(moving[0, :, 2], still[0, :, 2], atol=1e-5)


def test_the_order_in_a_vessel_file_does_not_matter():
    effects = every_effect(WAMV)
    a = voyage(WAMV.with_effects(*effects))
    b = voyage(WAMV.with_effects(*reversed(effects)))
    assert a[0].names == b[0].names
    np.testing.assert_array_equal(a[3], b[3])


def test_two_effects_of_one_kind_add():
    def drag(*values):
        parts = (AddedEffect(cubic_drag.EFFECT, {"X_uuu": value}) for value in values)
        return voyage(WAMV.with_effects(*parts))

    np.testing.assert_allclose(drag(-2.0, -3.0)[3], drag(-5.0)[3], atol=1e-10)
    assert "cubic_drag#2.X_uuu" in drag(-2.0, -3.0)[0].names


def test_lag_is_of_first_order():
    """After a step of the command, thrust is 1 − 1/e of the way there one time constant later."""
    vessel = WAMV.with_effects(AddedEffect(thruster_lag.EFFECT, {"tau": 0.5}))
    commands = np.repeat([[0.0, 0.0], [1.0, 1.0]], [1, 100], axis=0)
    states, _ = Model.of(vessel).simulate(commands, 0.01)
    assert states[0, 51, 6] == pytest.approx(90.0 * (1.0 - np.exp(-1.0)), rel=1e-6)


# -- effects that are not in the catalogue --


def _rate(flow, state, p):
    """A mass of water aboard that follows the boat's speed -> [m/s²]."""
    return (flow.u - state) / p.tau


def _force(flow, state, p):
    """It drags until it has caught up -> X, Y, N [N, N, N m]."""
    return Wrench(-p.k * (flow.u - state), 0.0, 0.0)


SLOSH = Effect(
    "slosh",
    Scope.BOAT,
    (Parameter("k", "N s/m", 0.0, 500.0, 60.0), Parameter("tau", "s", 0.1, 20.0, 3.0)),
    "sluggish at first",
    force=_force,
    rate=_rate,
)


def _listed_force(flow, p):
    """Outside numba's subset: a named tuple made a dictionary -> X, Y, N [N, N, N m]."""
    return Wrench(-p._asdict()["k"] * flow.u, 0.0, 0.0)


def _plain_force(flow, p):
    """The same for numba -> X, Y, N [N, N, N m]."""
    return Wrench(-p.k * flow.u, 0.0, 0.0)


LINEAR = (Parameter("k", "N s/m", 0.0, 500.0, 10.0),)
LISTED = Effect("listed", Scope.BOAT, LINEAR, "slow", force=_listed_force)
PLAIN = Effect("plain", Scope.BOAT, LINEAR, "slow", force=_plain_force)


def test_an_effect_with_a_state_of_its_own_runs_everywhere():
    vessel = WAMV.with_effects(added(SLOSH))
    model, commands, states, reports = voyage(vessel)
    assert model.state_size == 7
    assert np.abs(states[:, 6]).max() > 0.1
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7
    assert np.abs(missing_along(Model.of(WAMV), commands, reports)).max() > 1.0
    agree_in_both(vessel)
    total = np.gradient(states[:, 6], DT)[1:-1]
    expected = (states[1:-1, 3] - states[1:-1, 6]) / model.theta[model.names.index("slosh.tau")]
    np.testing.assert_allclose(total, expected, atol=5e-3)


def test_an_effect_that_numba_cannot_compile_runs_in_numpy_with_a_notice():
    slow_boat = WAMV.with_effects(AddedEffect(LISTED, {"k": 25.0}), added(thruster_lag.EFFECT))
    fast_boat = WAMV.with_effects(AddedEffect(PLAIN, {"k": 25.0}), added(thruster_lag.EFFECT))
    with pytest.warns(UserWarning, match=r"listed.*numpy.*_asdict.*test_effects.py"):
        model, commands, _, reports = voyage(slow_boat)
    assert not model.kernel.compiled
    _, _, _, expected = voyage(fast_boat)
    np.testing.assert_allclose(reports, expected, rtol=0, atol=1e-11)
    assert np.abs(missing_along(model, commands[:50], reports[:50])).max() < 1e-7


def test_kinds_are_checked_where_effects_are_made():
    with pytest.raises(ValueError, match="declares no law"):
        Effect("idle", Scope.BOAT, (), "nothing")
    with pytest.raises(ValueError, match="identifier"):
        Effect("no name", Scope.BOAT, (), "nothing", force=_plain_force)
    with pytest.raises(ValueError, match="start"):
        Parameter("k", "N", 0.0, 1.0, 2.0)
    with pytest.raises(ValueError, match=r"missing tau.*unknown tua"):
        AddedEffect(thruster_lag.EFFECT, {"tua": 1.0})
    with pytest.raises(KeyError, match="thruster_lag"):
        named("thruster_leg")


@every
def test_every_effect_explains_itself(effect):
    assert effect.looks_like
    text = " ".join(effect.explanation.split())
    assert "Source: " in text
    assert "Valid for: " in text
    assert effect.file == f"{effect.name}.py"
    assert set(effect.laws) <= set(LAWS)
    for parameter in effect.parameters:
        assert parameter.lower < parameter.upper
        assert parameter.scale > 0.0
        assert parameter.unit
        if parameter.neutral is not None:
            assert parameter.lower <= parameter.neutral <= parameter.upper


def test_the_catalogue_names_each_effect_once():
    names = [effect.name for effect in EFFECTS]
    assert len(set(names)) == len(names)


def test_water_at_rest_changes_nothing():
    still = Effect(
        "still", Scope.VOYAGE, (), "nothing", water=lambda time, pose, p: Water(0.0, 0.0, 0.0, 0.0)
    )
    np.testing.assert_array_equal(
        voyage(WAMV.with_effects(AddedEffect(still, {})))[3], voyage(WAMV)[3]
    )


def test_missing_force_recovers_after_a_stretch_without_motion():
    """Memory fed by a motion that was not known starts anew, it does not stay unknown."""
    lossy = Effect(
        "lossy", Scope.BOAT, (), "slow", thrust=lambda F, drive, flow, p: F * (1.0 - 0.1 * flow.u)
    )
    vessel = WAMV.with_effects(AddedEffect(lossy, {}), added(thruster_lag.EFFECT))
    model, commands, _, reports = voyage(vessel)
    broken = reports.copy()
    broken[200:220] = np.nan
    force = missing_along(model, commands, broken)
    assert np.isnan(force[200:220]).all()
    assert np.abs(force[-100:]).max() < 1.0
    assert np.isfinite(force[220:]).all()


def test_arrays_of_any_kind_give_the_same():
    """Slices and read-only arrays are taken as they are."""
    model, commands, _, reports = voyage(WAMV)
    wide = np.repeat(np.concatenate([reports, reports], axis=1), 2, axis=0)
    sliced = wide[::2, 9:]
    frozen = reports.copy()
    frozen.flags.writeable = False
    expected = missing_along(model, commands, reports)
    np.testing.assert_array_equal(missing_along(model, commands, sliced), expected)
    np.testing.assert_array_equal(missing_along(model, commands, frozen), expected)
    assert len(model.kernel.module.missing_force.signatures) == 1
