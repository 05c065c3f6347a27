"""Evidence: what is missing without an effect lies on the effect's own curve, for all of them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis.evidence import VARIABLES, Evidence, _edges, _mean, evidence, evidence_of, rivals
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.state import Wrench
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel
from tests.sim.simulated import on_floats
from tests.sim.vessels import RUDDER_BOAT, VALUES, WAMV, added, each_effect, excitation

DT = 0.1
LATER = {  # events within the trial, and what is strong enough to be seen on it
    "payload_change": {"factor": 1.4, "time": 60.0},
    "thruster_fault": {"thruster": 1.0, "gain": 0.3, "time": 60.0},
    "wave_motion": {"force": 30.0, "omega": 1.4, "direction": 0.6, "phase": 0.3},
}


@pytest.fixture(autouse=True)
def _nothing_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """The laws in plain Python: a kernel for each effect alone takes seconds to compile."""
    monkeypatch.setattr("sim.diagnosis.evidence.Model", SimpleNamespace(of=on_floats))


def keel(flow, p):
    return Wrench(0.0, 0.0, -p.k * flow.u * flow.r)


OWN = Effect(
    name="keel", scope=Scope.BOAT, force=keel, looks_like="turns too fast at speed",
    parameters=(Parameter("k", unit="N s²", lower=0.0, upper=500.0, start=40.0),),
)  # fmt: skip


def sailed(vessel: Vessel, seconds: float = 120.0) -> Trial:
    """What the vessel itself does, without noise; commands swing over: a jump has no instant."""
    steps = excitation(vessel, seconds, DT)
    drive = np.stack([np.convolve(c, np.full(10, 0.1), "same") for c in steps.T], axis=1)
    volts = np.linspace(16.4, 14.0, len(drive))
    _, reports = on_floats(vessel).simulate(drive, DT, voltage=volts)
    motion, T = reports[0, : len(drive)], len(drive)
    channels, pwm = vessel.pulses(drive)
    return Trial(
        name="voyage", time=DT * np.arange(T), eta=motion[:, :3], nu=motion[:, 3:6],
        nu_dot=np.gradient(motion[:, 3:6], DT, axis=0), channels=channels,
        covariance=np.tile(1e-8 * np.eye(9), (T, 1, 1)), pwm=pwm,
        voltage=volts, wind=np.full((T, 2), np.nan), usable=np.ones(T, bool),
    )  # fmt: skip


def with_effect(effect: Effect) -> Vessel:
    boat = RUDDER_BOAT if WAMV.unmet_needs(effect) else WAMV
    values = LATER.get(effect.name) or VALUES.get(effect.name) or added(effect).values
    return boat.with_effects(AddedEffect(effect, values))


def test_every_effect_of_the_catalogue_declares_what_its_evidence_is_drawn_against():
    plain = [effect for effect in EFFECTS if effect.over_map is None]  # a map is its own picture
    declared = [effect.evidence_axis(with_effect(effect).effects[0].values) for effect in plain]
    assert None not in declared
    assert {d.by for d in declared if d is not None and d.variable is None} <= set(VARIABLES)


@each_effect([OWN, *EFFECTS])
def test_what_is_missing_lies_on_the_curve_of_the_effect(effect):
    vessel = with_effect(effect)
    found = evidence([sailed(vessel)], [vessel], effect)
    assert found is not None
    size = float(np.sqrt(np.mean(found.curve**2)))
    assert size > 0.05  # N or N m
    assert np.sqrt(np.mean((found.mean - found.curve) ** 2)) < 0.35 * size
    assert not found.contradicts
    assert replace(found, curve=-found.curve).contradicts
    assert np.all((found.low <= found.mean) & (found.mean <= found.high))
    assert np.all((found.start <= found.at + 1e-9) & (found.at <= found.end + 1e-9))


def commanded(name: str, vessel: Vessel, *commands: float) -> float:
    """A variable of the evidence where these commands are held."""
    trial = sailed(vessel, 10.0)
    pwm = np.tile(1500.0 + 400.0 * np.array(commands), (len(trial), 1))
    return float(VARIABLES[name](replace(trial, pwm=pwm), on_floats(vessel))[5])


def test_the_helm_is_the_rudder_or_port_less_starboard():
    assert commanded("helm", WAMV, 0.8, 0.2) == pytest.approx(0.3)
    assert commanded("helm", WAMV, 0.2, 0.2) == pytest.approx(0.0)
    assert commanded("helm", RUDDER_BOAT, 0.8, 0.5) == pytest.approx(0.5)


def test_the_throttle_is_that_of_the_motors_and_astern_the_hardest_of_them():
    """A rudder that is laid to port is no motor that goes astern."""
    assert commanded("throttle", WAMV, 0.8, -0.2) == pytest.approx(0.3)
    assert commanded("throttle", RUDDER_BOAT, 0.8, -0.5) == pytest.approx(0.8)
    assert commanded("astern", WAMV, 0.8, -0.2) == pytest.approx(-0.2)
    assert commanded("astern", RUDDER_BOAT, -0.1, -0.5) == pytest.approx(-0.1)
    assert np.isnan(commanded("astern", RUDDER_BOAT, 0.8, -0.5))


def test_a_change_is_taken_over_the_half_second_before_and_an_acceleration_around_a_row():
    trial, model = sailed(WAMV, 10.0), on_floats(WAMV)
    drive = np.where(np.arange(len(trial)) < 50, 0.2, 0.7)[:, None]  # DT is a tenth of a second
    stepped = replace(trial, pwm=1500.0 + 400.0 * np.tile(drive, 2))
    change = VARIABLES["throttle_change"](stepped, model)
    expected = np.where((np.arange(len(trial)) >= 50) & (np.arange(len(trial)) < 55), 1.0, 0.0)
    np.testing.assert_allclose(change, expected, atol=1e-9)
    rates = np.zeros((len(trial), 3))
    rates[50, 0] = 3.0
    around = VARIABLES["acceleration"](replace(trial, nu_dot=rates), model)
    assert around.sum() == pytest.approx(3.0)
    near = np.flatnonzero(around)
    assert (len(near), np.abs(near - 50).max()) == (10, 5)  # a second
    np.testing.assert_allclose(around[near], 0.3)


def test_bins_hold_the_whole_voyage_as_much_of_it_each():
    current = next(e for e in EFFECTS if e.name == "current_change")
    vessel = with_effect(current)
    found = evidence([sailed(vessel)], [vessel], current)
    assert found is not None
    assert found.by == "time"
    np.testing.assert_allclose(found.start, np.linspace(0.0, 119.9, 11)[:-1], atol=0.06)
    np.testing.assert_allclose(found.end, np.linspace(0.0, 119.9, 11)[1:], atol=0.06)


def test_a_false_effect_is_not_borne_out():
    """A current that is not there: its curve goes where nothing is missing."""
    plain = sailed(WAMV)
    current = next(e for e in EFFECTS if e.name == "steady_current")
    vessel = WAMV.with_effects(AddedEffect(current, {"speed": 0.4, "direction": 1.0}))
    found = evidence([plain], [vessel], current)
    assert found is not None
    assert np.abs(found.mean).max() < 0.1 * np.abs(found.curve).max()


def test_a_force_of_one_direction_is_the_same_on_every_heading_along_it():
    force = next(e for e in EFFECTS if e.name == "inertial_force")
    force = replace(force, evidence=EvidenceAxis(ForceAxis.ALONG, "heading"))
    vessel = WAMV.with_effects(AddedEffect(force, {"force": 20.0, "direction": 1.0}))
    found = evidence([sailed(vessel)], [vessel], force)
    assert found is not None
    np.testing.assert_allclose(found.curve, 20.0, rtol=1e-6)


def test_time_that_is_not_usable_says_nothing():
    current = next(e for e in EFFECTS if e.name == "steady_current")
    vessel = with_effect(current)
    trial = sailed(vessel)
    rows = trial.time < 75.0
    spoilt = replace(trial, usable=rows, nu_dot=np.where(rows[:, None], trial.nu_dot, 9.0))
    found, clean = (
        evidence([spoilt], [vessel], current),
        evidence([replace(trial, usable=rows)], [vessel], current),
    )
    assert found is not None
    assert clean is not None
    np.testing.assert_allclose(found.mean, clean.mean)
    none = replace(trial, usable=np.zeros(len(trial), bool))
    assert evidence([none], [vessel], current) is None


def test_an_effect_that_is_not_in_the_table_is_shown_where_it_is_seen():
    vessel = with_effect(OWN)
    found = evidence([sailed(vessel)], [vessel], OWN)
    assert found is not None
    assert found.axis == 2
    assert found.by in ("turn_rate", "sway", "helm")


def test_only_a_curve_that_points_away_from_the_points_contradicts_them():
    """What noise may have turned round is no contradiction, nor is a curve of nothing."""
    one, x = np.ones(4), np.arange(4.0)

    def points(mean: float, curve: float, half: float) -> Evidence:
        mean_, curve_ = mean * one, curve * one
        return Evidence("any", 0, "surge", x, x + 1, x, mean_, mean_ - half, mean_ + half, curve_)

    assert points(5.0, 4.0, 1.0).explained_share == pytest.approx(0.96)
    assert points(5.0, -1.0, 1.0).explained_share == 0.0
    assert points(0.0, 0.0, 1.0).explained_share == 0.0
    assert points(5.0, -1.0, 1.0).contradicts
    assert not points(5.0, 1.0, 1.0).contradicts
    assert not points(0.5, -1.0, 1.0).contradicts
    assert not points(5.0, 0.0, 1.0).contradicts
    # Four points, a whisker of two standard errors: three of the mean of all are at 20 / 3.
    assert points(5.0, -1.0, 6.6).contradicts
    assert not points(5.0, -1.0, 6.7).contradicts


def test_a_curve_that_no_effect_explains_has_evidence_of_its_own(monkeypatch):
    """Each effect found is shown on the last step, the curve on its own; nothing where no time is
    left to show it.
    """
    monkeypatch.setattr(
        "sim.diagnosis.evidence.evidence_on",
        lambda step, effect, _: None if effect == "too short" else (step.name, effect),
    )
    last = SimpleNamespace(name="last", effects=("hull_lift", "too short"))
    curve = SimpleNamespace(name="curve", effects=("hull_lift", "cg_offset", "learned"))
    steps = (SimpleNamespace(name="first", effects=()), last)
    found: Any = SimpleNamespace(ladder=steps, curve=curve)
    assert evidence_of(found, []) == [("last", "hull_lift"), ("curve", "learned")]
    found.curve = None
    assert evidence_of(found, []) == [("last", "hull_lift")]


def test_rivals_are_what_ties_with_the_first_or_stands_beside_a_later_effect():
    def step(*effects: str) -> Any:
        return SimpleNamespace(effects=effects)

    ranking = [SimpleNamespace(effect=n, confounded_with=c) for n, c in (("a", ("b",)), ("b", "a"))]
    ranking.append(SimpleNamespace(effect="far", confounded_with=("not chosen",)))
    steps = [step("b"), step("far"), step("a", "e", "c"), step("a", "d")]
    found: Any = SimpleNamespace(ranking=ranking, alternatives=steps, effects=("a", "d"))
    assert rivals(found) == [steps[0], steps[2]]


def test_a_whisker_is_twice_the_error_of_blocks_and_no_less_than_rows_of_a_second_tell():
    block = np.repeat([4.0, 9.0], 10)
    mean, half = _mean(np.repeat([1.0, 3.0], 10), block, 0.1)  # blocks a deviation of one apart
    assert (mean, half) == pytest.approx((2.0, 2.0))
    mean, half = _mean(np.tile([1.0, 3.0], 10), block, 0.1)  # blocks alike; two seconds of rows
    assert (mean, half) == pytest.approx((2.0, 2.0 * 0.5**0.5))
    mean, half = _mean(np.tile([1.0, 3.0], 10), np.zeros(20), 0.01)  # less than a second of them
    assert (mean, half) == pytest.approx((2.0, 2.0))
    block = np.repeat([1.0, 2.0, 3.0], [10, 20, 30])
    mean, half = _mean(block, block, 1.0)
    assert mean == pytest.approx(140.0 / 60.0)
    weighed = (np.array([10, 20, 30]) / 60.0 * (np.array([1.0, 2.0, 3.0]) - mean)) ** 2
    assert half == pytest.approx(2.0 * np.sqrt(1.5 * weighed.sum()))


def test_a_variable_that_is_held_has_one_bin_and_a_heading_those_of_the_whole_circle():
    np.testing.assert_allclose(_edges(np.full(9, 2.0), "surge"), [1.5, 2.5])
    np.testing.assert_allclose(_edges(np.full(9, 2.0), "heading"), np.linspace(0, 2 * np.pi, 11))
