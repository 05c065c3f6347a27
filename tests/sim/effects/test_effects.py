"""Laws over every effect of the catalogue, alone and all together."""

import ast
import inspect
from collections import namedtuple
from dataclasses import fields, replace
from functools import cache

import numba
import numpy as np
import pytest

from sim.body import Body, Flow, Report, RudderParameters, ThrusterParameters
from sim.effects import cubic_drag, heading_offset, steady_current, thruster_lag
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import LAWS, Effect, Parameter, Scope
from sim.following.follower import Reference, ReferenceMode
from sim.state import Inertia, Pose, Water
from sim.vessel import AddedEffect
from tests.sim.simulated import (
    DT,
    delayed,
    home,
    missing_along,
    on_floats,
    reports_without_past,
    simulated,
    surroundings,
)
from tests.sim.vessels import (
    ANTENNA,
    IACQUABOT,
    RUDDER_BOAT,
    SHAPES,
    STEERED_BOAT,
    TWIN_WITH_RUDDER,
    WAMV,
    added,
    each_effect,
    every_effect,
    excitation,
    with_every_effect,
)

ORDER = (  # of what a file declares
    "name", "scope", *LAWS, "start", "needs", "parameters", "looks_like", "mistaken_for",
    "shown_by", "general_of", "contains", "beside", "of_each_day", "alike", "partial", "unsteady",
    "evidence", "separated", "explains", "search", "more_starts", "tables", "knot_places", "turned",
    "over_map", "within", "mismatch", "disbelieved", "undone", "in_words", "formulas",
    "formula_source", "example", "measured", "assumption", "pattern_for", "pattern", "acts_when",
)  # fmt: skip
every = pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)


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


@each_effect()
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


@cache
def sailed_with(name):
    """`simulated` with one effect in plain Python, and the reports of each row alone."""
    effect = named(name)
    model, commands, states, reports = simulated(
        home(effect).with_effects(added(effect)), on_floats
    )
    return model, commands, reports, reports_without_past(model, commands, states)


@cache
def sailed_bare(steered):
    """Model and reports of the two homes of effects, with no effect."""
    model, _, _, reports = simulated(RUDDER_BOAT if steered else WAMV, on_floats)
    return model, reports


@each_effect()
def test_balance_of_a_simulated_motion_is_zero(effect):
    model, commands, _, reports = sailed_with(effect.name)
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7


@pytest.mark.parametrize(
    "vessel",
    [
        *(pytest.param(v, marks=() if v is STEERED_BOAT else pytest.mark.slow) for v in SHAPES),
        TWIN_WITH_RUDDER,
    ],
    ids=lambda v: v.name,
)
def test_balance_is_zero_with_all_effects_at_once_on_every_shape(vessel):
    model, commands, states, _ = simulated(with_every_effect(vessel), on_floats)
    reports = reports_without_past(model, commands, states)
    assert np.isfinite(states).all()
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7


@each_effect()
def test_leaving_an_effect_out_is_seen_everywhere(effect):
    """In the simulation, in the missing force and in the prediction alike."""
    model, commands, late_reports, reports = sailed_with(effect.name)
    without, other = sailed_bare(home(effect) is RUDDER_BOAT)
    assert np.abs(late_reports - other).max() > 1e-3
    assert np.abs(missing_along(without, commands, late_reports)).max() > 0.01
    new = np.any(commands != np.roll(commands, 1, axis=0), axis=1)
    times = DT * np.arange(len(commands))
    air = surroundings(len(commands))
    ends = []
    for m in (model, without):
        late = delayed(commands, m.delay)
        held = np.concatenate([late[:1], late[:-1]])
        reference = Reference(m, ReferenceMode.MODEL)
        ends.append(
            reference.advance(
                reference.start(), times, reports, np.ones(len(times), bool), held, **air
            ).references
        )
    equal = np.abs(ends[0][:, :6] - reports[:, :6]).max(axis=1) < 1e-7
    # where a late sensor extrapolates, a new command counts at once or from the next row on
    assert equal[~new].all() if effect.latency else equal.all()
    assert np.abs(ends[1] - reports).max() > 1e-3


@every
def test_a_boats_own_effect_moves_nothing_by_itself(effect):
    if effect.scope is Scope.VOYAGE:
        pytest.skip("a voyage brings energy of its own: current, wind, waves")
    vessel = home(effect).with_effects(added(effect))
    states, _ = on_floats(vessel).simulate(np.zeros((50, len(vessel.actuators))), DT)
    assert not states[..., :6].any()


def test_sensor_effects_leave_the_motion_alone():
    vessels = WAMV, WAMV.with_effects(added(heading_offset.EFFECT))
    a, b = (simulated(vessel, on_floats) for vessel in vessels)
    np.testing.assert_array_equal(a[2], b[2])
    assert np.abs(a[3] - b[3]).max() > 0.1


@pytest.mark.parametrize("angle", [-0.8, -0.1, 0.3, 0.8])
def test_the_true_motion_is_found_behind_the_reported_one(angle):
    vessel = replace(IACQUABOT, sensors=ANTENNA).with_effects(
        AddedEffect(heading_offset.EFFECT, {"angle": angle})
    )
    model, commands, states, reports = simulated(vessel, on_floats)
    np.testing.assert_allclose(model.true_states(reports), states[:, :6], rtol=0, atol=1e-9)
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7


def test_the_antenna_moves_as_a_point_of_the_boat():
    """Its reported velocity is the time derivative of its reported position."""
    _, _, _, reports = simulated(replace(WAMV, sensors=ANTENNA))
    rate = np.gradient(reports[:, :3], DT, axis=0)[1:-1]
    yaw, u, v = reports[1:-1, 2:5].T
    np.testing.assert_allclose(rate[:, 0], np.cos(yaw) * u - np.sin(yaw) * v, atol=0.01)
    np.testing.assert_allclose(rate[:, 1], np.sin(yaw) * u + np.cos(yaw) * v, atol=0.01)


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda v: v.name)
def test_a_boat_adrift_goes_with_the_current(vessel):
    current = AddedEffect(steady_current.EFFECT, {"speed": 0.4, "direction": 2.0})
    model = on_floats(vessel.with_effects(current))
    states, _ = model.simulate(np.zeros((3000, len(vessel.actuators))), 0.2)
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
    still, _ = on_floats(vessel).simulate(commands, 0.05)
    start = np.array([0.0, 0.0, 0.0, *flow, 0.0])
    moving, _ = on_floats(vessel.with_effects(current)).simulate(commands, 0.05, start)
    time = 0.05 * np.arange(len(commands) + 1)
    np.testing.assert_allclose(moving[0, :, :2] - time[:, None] * flow, still[0, :, :2], atol=1e-5)
    np.testing.assert_allclose(moving[0, :, 2], still[0, :, 2], atol=1e-5)


def test_the_order_in_a_vessel_file_does_not_matter():
    effects = every_effect(WAMV)
    a = simulated(WAMV.with_effects(*effects), on_floats)
    b = simulated(WAMV.with_effects(*reversed(effects)), on_floats)
    assert a[0].names == b[0].names
    np.testing.assert_array_equal(a[3], b[3])


def test_two_effects_of_one_kind_add():
    def drag(*values):
        parts = (AddedEffect(cubic_drag.EFFECT, {"X_uuu": value}) for value in values)
        return simulated(WAMV.with_effects(*parts), on_floats)

    np.testing.assert_allclose(drag(-2.0, -3.0)[3], drag(-5.0)[3], atol=1e-10)
    assert "cubic_drag#2.X_uuu" in drag(-2.0, -3.0)[0].names


def test_lag_is_of_first_order():
    """After a step of the command, thrust is 1 − 1/e of the way there one time constant later."""
    vessel = WAMV.with_effects(AddedEffect(thruster_lag.EFFECT, {"tau": 0.5}))
    commands = np.repeat([[0.0, 0.0], [1.0, 1.0]], [1, 100], axis=0)
    states, _ = on_floats(vessel).simulate(commands, 0.01)
    assert states[0, 51, 6] == pytest.approx(90.0 * (1.0 - np.exp(-1.0)), rel=1e-6)


def test_kinds_are_checked_where_effects_are_made():
    with pytest.raises(ValueError, match="declares no law"):
        Effect("idle", Scope.BOAT, (), "nothing")
    with pytest.raises(ValueError, match="identifier"):
        Effect("no name", Scope.BOAT, (), "nothing", force=lambda flow, p: None)
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


@every
def test_every_file_declares_in_the_same_order(effect):
    *_, last = ast.parse(effect.source_code).body
    assert isinstance(last, ast.Assign)
    keys = [keyword.arg for keyword in last.value.keywords]
    known = [key for key in keys if key not in LAWS]
    assert known == [key for key in ORDER if key in known]
    assert keys[:2] == ["name", "scope"]
    assert set(keys[2 : 2 + len(effect.laws)]) == set(effect.laws)
    assert {field.name for field in fields(Effect) if field.init} == set(ORDER)


def test_the_catalogue_names_each_effect_once():
    names = [effect.name for effect in EFFECTS]
    assert len(set(names)) == len(names)


def test_water_at_rest_changes_nothing():
    still = Effect(
        "still", Scope.VOYAGE, (), "nothing", water=lambda time, pose, p: Water(0.0, 0.0, 0.0, 0.0)
    )
    np.testing.assert_array_equal(
        simulated(WAMV.with_effects(AddedEffect(still, {})), on_floats)[3],
        simulated(WAMV, on_floats)[3],
    )


def test_a_curve_names_an_effect_with_a_law_as_the_pattern_for_its_place():
    """Where no short formula stands for a curve, one's own effect begins with that file."""
    laws = {e.name for e in EFFECTS if not e.is_curve}
    assert all((e.pattern in laws) == e.is_curve for e in EFFECTS)
