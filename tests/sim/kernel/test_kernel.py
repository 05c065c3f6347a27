"""Compiled kernels against the same in plain Python; laws of a user, and those numba refuses."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from sim.diagnosis.fit_problem import SupersetModel, neutral_values
from sim.effects import thruster_lag
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Kind, Parameter, Scope
from sim.following.follower import Reference, ReferenceMode
from sim.model import InputTable, Model, Runs
from sim.state import Wrench
from sim.vessel import AddedEffect
from tests.sim.simulated import (
    DT,
    home,
    in_numpy,
    missing_along,
    on_floats,
    simulated,
    surroundings,
)
from tests.sim.vessels import (
    IACQUABOT,
    STEERED_BOAT,
    TWIN_WITH_RUDDER,
    WAMV,
    added,
    each_effect,
    every_effect,
    excitation,
    with_every_effect,
)

EVERYTHING = with_every_effect(TWIN_WITH_RUDDER)  # the one large kernel of the fast tests
CAN_BE_OFF = [effect for effect in EFFECTS if neutral_values(effect) is not None]


@each_effect(CAN_BE_OFF)
def test_an_effect_compiled_among_all_others_is_the_same_without_them_in_plain_python(effect):
    """The others are switched off by their numbers; those that cannot be act on both sides."""
    fast, theta = Model.of(EVERYTHING), Model.of(EVERYTHING).theta.copy()
    for other in CAN_BE_OFF:
        for key, value in neutral_values(other).items() if other is not effect else ():
            theta[fast.names.index(f"{other.name}.{key}")] = value
    rest = [a for a in EVERYTHING.effects if a.effect is effect or a.effect not in CAN_BE_OFF]
    agree(replace(fast, theta=theta), in_numpy(replace(EVERYTHING, effects=tuple(rest))), 1.0)


def choices(effect):
    """Every combination of what can be chosen in an effect."""
    each = [p for p in effect.parameters if p.kind is Kind.CHOICE]
    ranges = (np.arange(p.lower, p.upper + 1.0).tolist() for p in each)
    return [dict(zip([p.name for p in each], values, strict=True)) for values in product(*ranges)]


@pytest.mark.parametrize(
    ("effect", "chosen"),
    [(effect, chosen) for effect in EFFECTS if effect.acts_when for chosen in choices(effect)],
    ids=lambda one: (
        one.name if isinstance(one, Effect) else "-".join(f"{x:g}" for x in one.values())
    ),
)
def test_laws_that_are_passed_over_where_a_choice_leaves_them_no_work_would_change_nothing(
    effect, chosen
):
    fast = Model.of(EVERYTHING)
    theta = fast.theta.copy()
    for key, value in chosen.items():
        theta[fast.names.index(f"{effect.name}.{key}")] = value
    effects = [
        replace(a, values={**a.values, **chosen}) if a.effect is effect else a
        for a in EVERYTHING.effects
    ]
    slow = in_numpy(replace(EVERYTHING, effects=tuple(effects)))
    agree(replace(fast, theta=theta), slow, 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_an_effect_compiled_among_all_others_is_the_same_alone_in_plain_python(effect):
    """All others are switched off; what cannot be is compiled by itself."""
    alone, one = home(effect).with_effects(added(effect)), added(effect)
    if neutral_values(effect) is None:
        agree(Model.of(alone), in_numpy(alone))
    else:
        agree(SupersetModel.of(home(effect), EFFECTS).with_added([one]), in_numpy(alone))


OF_ACTUATORS = (  # one of each kind of law that is unrolled over thrusters or rudders
    "actuator_wiring", "thruster_deadband", "thruster_fault", "advance_loss", "thruster_lag",
    "thruster_misalignment", "steering_offset", "steering_lag",
)  # fmt: skip


def test_all_effects_act_together_on_one_vessel():
    assert {a.effect.name for a in EVERYTHING.effects} == {e.name for e in EFFECTS}


@pytest.mark.parametrize(
    "vessel",
    [
        EVERYTHING,
        *(
            pytest.param(
                shape.with_effects(
                    *(a for a in every_effect(shape) if a.effect.name in OF_ACTUATORS)
                ),
                marks=pytest.mark.slow,
            )
            for shape in (IACQUABOT, STEERED_BOAT)
        ),
    ],
    ids=lambda v: v.name,
)
def test_all_together_in_plain_python_equal_the_compiled_kernel(vessel):
    agree(*in_both(vessel))


@pytest.mark.slow
def test_a_prediction_with_all_effects_in_plain_python_equals_the_compiled_one():
    fast, slow = in_both(EVERYTHING)
    vessel = EVERYTHING
    commands, steps = excitation(vessel, 3.0, DT), 150
    rows = fast.simulate(commands, DT, **surroundings(steps))[1][0, :-1]
    times, known = DT * np.arange(steps), np.arange(steps) < 50
    predicted = []
    for model in (fast, slow):
        reference = Reference(model, ReferenceMode.AUTO)
        result = reference.advance(
            reference.start(), times, rows, known, commands, **surroundings(steps)
        )
        assert result.from_model.tolist() == (~known).tolist()
        predicted.append(result.references)
    np.testing.assert_allclose(predicted[1], predicted[0], rtol=0, atol=1e-12)
    assert np.abs(predicted[0] - rows)[~known].max() > 1e-6  # not what it was given


def in_both(vessel):
    """The vessel's model compiled, and in plain Python."""
    fast = Model.of(vessel)
    slow = in_numpy(vessel)
    assert fast.kernel.compiled
    assert not slow.kernel.compiled
    return fast, slow


def agree(fast, slow, seconds=2.0):
    """Free runs of a batch and the missing force: compiled against plain Python."""
    commands = np.stack([excitation(slow.vessel, seconds, DT, seed) for seed in (1, 2)])
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


@pytest.mark.slow
def test_an_effect_with_a_state_of_its_own_runs_everywhere():
    vessel = WAMV.with_effects(added(SLOSH))
    model, commands, states, reports = simulated(vessel)
    assert model.state_size == 7
    assert np.abs(states[:, 6]).max() > 0.1
    assert np.abs(missing_along(model, commands, reports)).max() < 1e-7
    assert np.abs(missing_along(Model.of(WAMV), commands, reports)).max() > 1.0
    agree(*in_both(vessel))
    total = np.gradient(states[:, 6], DT)[1:-1]
    expected = (states[1:-1, 3] - states[1:-1, 6]) / model.theta[model.names.index("slosh.tau")]
    np.testing.assert_allclose(total, expected, atol=5e-3)


def test_an_effect_that_numba_cannot_compile_runs_in_numpy_with_a_notice():
    slow_boat = WAMV.with_effects(AddedEffect(LISTED, {"k": 25.0}), added(thruster_lag.EFFECT))
    fast_boat = WAMV.with_effects(AddedEffect(PLAIN, {"k": 25.0}), added(thruster_lag.EFFECT))
    with pytest.warns(UserWarning, match=r"listed.*numpy.*_asdict.*test_kernel.py"):
        model, commands, _, reports = simulated(slow_boat)
    assert not model.kernel.compiled
    _, _, _, expected = simulated(fast_boat, on_floats)
    np.testing.assert_allclose(reports, expected, rtol=0, atol=1e-11)
    assert np.abs(missing_along(model, commands[:50], reports[:50])).max() < 1e-7


def test_missing_force_recovers_after_a_stretch_without_motion():
    """Memory fed by a motion that was not known starts anew, it does not stay unknown."""
    lossy = Effect(
        "lossy", Scope.BOAT, (), "slow", thrust=lambda F, drive, flow, p: F * (1.0 - 0.1 * flow.u)
    )
    vessel = WAMV.with_effects(AddedEffect(lossy, {}), added(thruster_lag.EFFECT))
    model, commands, _, reports = simulated(vessel, on_floats)
    broken = reports.copy()
    broken[100:120] = np.nan
    force = missing_along(model, commands, broken)
    assert np.isnan(force[100:120]).all()
    assert np.abs(force[-100:]).max() < 1.0
    assert np.isfinite(force[120:]).all()


def test_arrays_of_any_kind_give_the_same():
    """Slices and read-only arrays are taken as they are."""
    model, commands, _, reports = simulated(WAMV)
    wide = np.repeat(np.concatenate([reports, reports], axis=1), 2, axis=0)
    sliced = wide[::2, 9:]
    frozen = reports.copy()
    frozen.flags.writeable = False
    expected = missing_along(model, commands, reports)
    np.testing.assert_array_equal(missing_along(model, commands, sliced), expected)
    np.testing.assert_array_equal(missing_along(model, commands, frozen), expected)
    assert len(model.kernel.module.missing_force.signatures) == 1


@pytest.mark.parametrize("stiffer", [1.0, 10.0, 60.0])
def test_steps_follow_a_hull_however_strongly_it_is_damped(stiffer):
    """And no more of them are made than that takes: what is over at once is only kept stable."""
    d = WAMV.dynamics
    model = Model.of(replace(WAMV, dynamics=replace(d, Y_v=stiffer * d.Y_v, N_r=stiffer * d.N_r)))
    commands = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, (30, 2)), 10, axis=0)
    _, coarse = model.simulate(commands, 0.2)
    _, fine = model.simulate(np.repeat(commands, 100, axis=0), 0.002)
    assert np.abs(coarse[0] - fine[0, ::100])[:, 3:6].max() < 1e-3
    assert model.max_step(None, np.zeros((1, 3))) > 0.01


def test_steps_are_made_shorter_until_that_changes_nothing(monkeypatch):
    """One hull turns, and one that is damped hard sideways goes straight ahead: nothing is fast.

    Steps that were short enough for the damping of this at the speeds of that are not needed.
    """
    model, made, whole = Model.of(WAMV), [], Model._rolled
    stiff = model.theta.copy()
    stiff[model.names.index("Y_vv")] = -2e5

    def rolled(self, start, runs, inputs, thetas, substeps, horizon):
        made.append(substeps)
        return whole(self, start, runs, inputs, thetas, substeps, horizon)

    monkeypatch.setattr(Model, "_rolled", rolled)
    tables = np.ones((2, 30, 2))
    tables[0] = [1.0, -0.2]
    nothing = np.zeros(2, np.int64)
    runs = Runs(np.arange(2), nothing, nothing + 30, np.zeros(2))
    inputs, thetas = InputTable.of(tables, 0.2), np.array([model.theta, stiff])
    states, _ = model.run(np.zeros((2, 6)), runs, inputs, theta=thetas)
    fastest = np.abs(states[..., 3:6]).max(axis=(0, 1))
    assert fastest[1] > 0.1
    assert len(made) > 1
    assert max(made) < 0.1 * 0.2 / model.max_step(thetas, fastest, 1e-3)
    for k in range(2):
        _, fine = model.simulate(np.repeat(tables[k], 100, axis=0), 0.002, theta=thetas[k])
        assert np.abs(states[k, :, 3:6] - fine[0, ::100, 3:6]).max() < 1e-3


def test_only_runs_from_a_row_where_one_becomes_too_fast_are_made_again_in_shorter_steps(
    monkeypatch,
):
    """Of three boats at rest one turns hard, at two strengths of damping: both of these again."""
    model = Model.of(replace(WAMV, dynamics=replace(WAMV.dynamics, N_rr=-2e4)))
    stronger = model.theta.copy()
    stronger[model.names.index("N_rr")] *= 1.1
    tables = np.zeros((2, 30, 2))
    tables[1] = [1.0, -1.0]
    inputs, made = InputTable.of(tables, 0.2), []
    whole = Model._rolled

    def rolled(self, start, runs, *others):
        made.append(runs.table.tolist())
        return whole(self, start, runs, *others)

    def run(*of):
        which = np.array(of, np.int64)
        theta = np.array([model.theta, model.theta, stronger])[which]
        nothing = np.zeros(len(of), np.int64)
        runs = Runs(np.array([0, 1, 1])[which], nothing, nothing + 30, np.zeros(len(of)))
        return model.run(np.zeros((len(of), 6)), runs, inputs, theta=theta)[0]

    monkeypatch.setattr(Model, "_rolled", rolled)
    together = run(0, 1, 2)
    assert made[0] == [0, 1, 1]
    assert len(made) > 1
    assert all(tables == [1, 1] for tables in made[1:])
    np.testing.assert_array_equal(together[0], run(0)[0])
    _, fine = model.simulate(np.repeat(tables[1], 100, axis=0), 0.002)
    assert np.abs(together[1] - fine[0, ::100, :6])[:, 3:].max() < 1e-3
