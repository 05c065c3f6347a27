"""Laws that the effects of the catalogue obey, each over all members that they concern."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from sim.body import Body, Flow
from sim.effects.catalogue import EFFECTS, mistaken_for, named
from sim.effects.effect import Kind, Need, Parameter, circular_parameter
from sim.model import Model
from sim.state import Pose
from sim.vessel import AddedEffect
from tests.sim.simulated import on_floats
from tests.sim.vessels import RUDDER_BOAT, VALUES, WAMV, added, excitation

DT = 0.02
COARSE = 0.04  # where two runs of the same steps are compared
TAKE_ENERGY = ("cubic_drag", "crossflow_drag", "drag_growth", "learned_drag", "towed_load")
PORT_AND_STARBOARD = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, -1.0])  # of a report
OTHER_SIDE = {
    "thruster_fault": {"thruster": 2.0},
    "thruster_imbalance": {"port_gain": 1.2, "starboard": 1.0},
    "actuator_wiring": {"reversed": 1.0},
    "learned_drag": {"east": -VALUES["learned_drag"]["east"]},
    "learned_history": {f"g{k}": -VALUES["learned_history"][f"g{k}"] for k in range(9)},
    "learned_spot": {"east": -VALUES["learned_spot"]["east"]},
    "learned_profile": {  # across from west to east
        "low": -VALUES["learned_profile"]["high"],
        "high": -VALUES["learned_profile"]["low"],
        **{
            f"{c}{k}": sign * VALUES["learned_profile"][f"{c}{8 - k}"]
            for c, sign in (("n", 1.0), ("e", -1.0))
            for k in range(9)
        },
    },
    "learned_anomaly": {
        "east": -VALUES["learned_anomaly"]["east"],
        **{f"f{k}": -VALUES["learned_anomaly"][f"f{k}"] for k in range(9)},
    },
    "learned_reading": {f"f{k}": -VALUES["learned_reading"][f"f{8 - k}"] for k in range(9)},
    "learned_map": {
        "west": -VALUES["learned_map"]["east"],
        "east": -VALUES["learned_map"]["west"],
        **{
            f"{c}{i}{j}": sign * VALUES["learned_map"][f"{c}{i}{3 - j}"]
            for c, sign in (("n", 1.0), ("e", -1.0))
            for i in range(4)
            for j in range(4)
        },
    },
}
HARDLY_TOLD = ("thruster_deadband.jump",)  # a shape between two, which hardly anything tells
every_parameter = pytest.mark.parametrize(
    ("name", "parameter"),
    [(f"{e.name}.{p.name}", p) for e in EFFECTS for p in e.parameters if p.kind is not Kind.CHOICE],
    ids=lambda one: one if isinstance(one, str) else "",
)


def home(effect):
    return RUDDER_BOAT if Need.STEERING in effect.needs else WAMV


def reports_of(vessel, commands, x0=None, dt=DT):
    """Reports (T+1, 9) of a free run without a measured wind, at 14 V."""
    return on_floats(vessel).simulate(commands, dt, x0, voltage=np.full(len(commands), 14.0))[1][0]


@cache
def reports_bare(steered):
    """Reports of five seconds without an effect, of either home."""
    vessel = RUDDER_BOAT if steered else WAMV
    return reports_of(vessel, excitation(vessel, 5.0, COARSE), dt=COARSE)


def body_of(vessel, count):
    values = vars(vessel.dynamics) | vars(vessel.hull)
    return Body(*(np.full(count, float(values.get(name, 1.0))) for name in Body._fields))


def flows(count, seed=3):
    """Random flows (count,) around a WAM-V."""
    rng = np.random.default_rng(seed)
    flow = Flow(*(rng.uniform(-2.0, 2.0, count) for _ in Flow._fields[:-1]), body_of(WAMV, count))
    return flow._replace(time=rng.uniform(0.0, 300.0, count), wind_known=np.zeros(count))


def parameters_of(item):
    """The parameters as a law takes them."""
    return SimpleNamespace(**item.values)


@pytest.mark.parametrize(
    "effect", [e for e in EFFECTS if any(p.neutral is not None for p in e.parameters)],
    ids=lambda e: e.name,
)  # fmt: skip
def test_at_its_neutral_values_an_effect_does_nothing(effect):
    values = dict(added(effect).values)
    values |= {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
    vessel = home(effect)
    commands = excitation(vessel, 5.0, COARSE)
    with_it = reports_of(vessel.with_effects(AddedEffect(effect, values)), commands, dt=COARSE)
    without = reports_bare(vessel is RUDDER_BOAT)
    np.testing.assert_allclose(with_it, without, rtol=0, atol=1e-12)


def test_only_these_have_no_neutral_values():
    without = {e.name for e in EFFECTS if all(p.neutral is None for p in e.parameters)}
    assert without == {"steady_wind", "wind_change", "battery_sag", "thruster_lag", "steering_lag",
                       "steering_play", "steering_rate"}  # fmt: skip


@every_parameter
def test_what_may_have_either_sign_is_looked_for_on_both_sides_alike(name, parameter):
    """Limits as far to port as to starboard, and a start between them where nothing is known."""
    p = parameter
    if p.lower < 0.0 < p.upper and not p.prior:
        assert p.lower == -p.upper
        assert p.start == 0.0 or p.neutral is None
    assert p.lower < 0.0 or not p.sided


@every_parameter
def test_a_step_that_matters_is_small_beside_what_may_be_and_leaps_over_nothing(name, parameter):
    """`scale`, by which a search goes and which tells a change: from the start it does not pass
    where the effect does nothing, and within the limits there is room for many.
    """
    p = parameter
    room = 2.0 * np.pi if p.kind is Kind.CIRCLE else p.upper - p.lower
    assert 0.0 < p.scale <= room / (5.0 if name in HARDLY_TOLD else 9.99)
    if p.neutral is not None:
        assert p.lower <= p.neutral <= p.upper
        assert p.start == p.neutral or abs(p.start - p.neutral) >= p.scale
    assert p.prior == 0.0 or p.scale <= p.prior  # what is known is known more coarsely
    assert p.default is None or p.lower <= p.default <= p.upper
    assert all(p.lower <= start <= p.upper for start in p.starts)
    assert list(p.starts) == sorted(set(p.starts))


def test_a_parameter_that_says_nothing_changes_by_a_tenth_of_its_range_and_starts_within():
    assert Parameter("x", "m", lower=-1.0, upper=3.0, start=0.0).scale == pytest.approx(0.4)
    for start in (-1.1, 3.1):
        with pytest.raises(ValueError, match="is outside"):
            Parameter("x", "m", lower=-1.0, upper=3.0, start=start)
    around = circular_parameter("direction", "towards")
    assert around.upper - around.lower > 4.0 * np.pi  # a search may go round and stop at no bound
    assert around.kind is Kind.CIRCLE


@pytest.mark.parametrize("name", TAKE_ENERGY)
def test_drag_takes_energy_out(name):
    flow, effect = flows(500), named(name)
    tau = effect.force(flow, parameters_of(added(effect)))
    power = tau.X * flow.u + tau.Y * flow.v + tau.N * flow.r
    assert (power <= 0.0).all()
    assert power.min() < -1.0


def test_inertia_stays_that_of_a_mass():
    """Symmetric by its type, and positive: energy of motion never is not."""
    for effect in (e for e in EFFECTS if e.inertia):
        M = effect.inertia(
            Model.of(WAMV).kernel.module.base_inertia(body_of(WAMV, 1)),
            flows(1), parameters_of(added(effect)),
        )  # fmt: skip
        matrix = np.zeros((3, 3))
        matrix[np.triu_indices(3)] = [np.ravel(value)[0] for value in M]
        assert (np.linalg.eigvalsh(matrix, UPLO="U") > 0.0).all(), effect.name


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_seen_in_a_mirror_it_is_the_same_effect_on_the_other_side(effect):
    vessel, item = home(effect), added(effect)
    sided = {p.name for p in effect.parameters if p.sided}
    values = {k: -v if k in sided else v for k, v in item.values.items()}
    other = AddedEffect(effect, values | OTHER_SIDE.get(effect.name, {}))
    commands, start = excitation(vessel, 5.0, COARSE), np.array([1.0, 2.0, 0.5, 0.4, 0.1, -0.1])
    swapped = commands[:, ::-1] if vessel is WAMV else commands * [1.0, -1.0]
    here, there = (
        reports_of(vessel.with_effects(one), given, side * start, dt=COARSE)
        for one, given, side in ((item, commands, 1.0), (other, swapped, PORT_AND_STARBOARD[:6]))
    )
    np.testing.assert_allclose(
        there, here * PORT_AND_STARBOARD, rtol=0, atol=1e-9,
        err_msg="a parameter that a mirror turns round declares sided=True",
    )  # fmt: skip


@pytest.mark.parametrize(
    "effect", [e for e in EFFECTS if e.water and not e.is_curve], ids=lambda e: e.name
)
def test_the_waters_acceleration_is_that_of_its_velocity(effect):
    p, h = parameters_of(added(effect)), 1e-3
    time = np.linspace(0.0, 60.0, 50)
    before, now, after = (effect.water(time + s, Pose(1.0, 2.0, 3.0), p) for s in (-h, 0.0, h))
    for i in (0, 1):
        rate = np.broadcast_to((after[i] - before[i]) / (2.0 * h), len(time))
        np.testing.assert_allclose(np.broadcast_to(now[2 + i], len(time)), rate, atol=1e-7)


@pytest.mark.parametrize(
    "effect", [e for e in EFFECTS if e.observe and not e.latency], ids=lambda e: e.name
)
def test_reported_accelerations_are_those_of_the_reported_velocities(effect):
    commands = np.repeat([[0.8, 0.3]], 500, axis=0)
    rows = reports_of(WAMV.with_effects(added(effect)), commands, np.full(6, 0.3))
    rate = np.gradient(rows[:, 3:6], DT, axis=0)
    np.testing.assert_allclose(rows[2:-2, 6:9], rate[2:-2], atol=1e-3)


def test_what_one_is_mistaken_for_is_mistaken_for_it():
    for effect in EFFECTS:
        for other in mistaken_for(effect):
            assert effect.name in mistaken_for(named(other)), f"{effect.name} and {other}"


def test_one_of_two_that_look_alike_declares_it():
    """A new effect changes no file of another."""
    stranger = replace(named("hull_lift"), name="stranger", mistaken_for=("battery_sag",))
    assert "stranger" not in named("battery_sag").mistaken_for
    assert mistaken_for(named("battery_sag"), (*EFFECTS, stranger))[-1] == "stranger"
    assert mistaken_for(named("hull_lift"), (*EFFECTS, stranger)) == (
        "cross_damping",
        "crossflow_drag",
        "towed_load",
        "lever_arm",
        "steering_scale",
    )
