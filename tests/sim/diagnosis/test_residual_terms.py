"""What a fit leaves: each kind of thing that no catalogue holds is named by what it hangs on."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from sim.body import Flow, ThrusterParameters
from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit import Fit
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.force_terms import rhythms
from sim.diagnosis.heldout import Gain
from sim.diagnosis.residual_terms import (
    Dependence,
    dependences,
    swing_period,
    without_repeats,
)
from sim.diagnosis.thresholds import MAX_PERIOD_S
from sim.effects.effect import Effect, Scope
from sim.model import Model
from sim.state import Floats, Pose, Water, Wrench
from sim.trial import Trial
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import DT, STD, sailed
from tests.sim.simulated import on_floats
from tests.sim.voyages import WAM_V, commands, trial_of

SECONDS = 300.0
PERIOD = 9.0  # s


class Nothing(NamedTuple):
    """No parameters."""


def sheared(time: float, pose: Pose, p: Nothing) -> Water:
    """Water that runs east, the faster the further north."""
    return Water(0.0, 0.3 * np.tanh(0.05 * pose.north), 0.0, 0.0)


def stuttering(F: float, drive: ThrusterParameters, flow: Flow, p: Nothing) -> float:
    """The motors stop for a third of each period."""
    return F * (flow.time % PERIOD >= PERIOD / 3.0)


def pushed(flow: Flow, p: Nothing) -> Wrench:
    """A constant push to starboard [N]."""
    return Wrench(0.0, 40.0, 0.0)


def pushed_on_course(flow: Flow, p: Nothing) -> Wrench:
    """A harder one, and a moment [N m] that holds a heading of 0."""
    return Wrench(0.0, 80.0, -400.0 * (flow.yaw + flow.r))


def pushed_and_fouled(flow: Flow, p: Nothing) -> Wrench:
    """The same, and a drag that has no speed at which it is nothing."""
    return Wrench(-60.0 * np.tanh(4.0 * flow.u), 40.0, 0.0)


def voyage(drive: Floats | None = None, **law: Callable[..., Any]) -> Trial:
    """The WAM-V with a law of nobody's catalogue; `drive` (T, 2): other commands than usual."""
    drive = commands(SECONDS, DT, 3) if drive is None else drive
    strange = Effect(
        "stranger", Scope.BOAT, parameters=(), looks_like="", mistaken_for=(), **law
    )  # fmt: skip
    vessel = WAM_V.with_effects(AddedEffect(strange, {}))
    _, reports = on_floats(vessel).simulate(drive, DT)
    motion = reports[0, :-1] + np.random.default_rng(5).normal(0.0, STD, (len(drive), 9))
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, DT, np.diag(STD**2))


def base_on(*trials: Trial) -> Fit:
    """The base fitted without any effect."""
    return fit_base(SupersetModel.of(WAM_V, ()), Model.of(WAM_V), trials, DiagnoseSettings())


@pytest.mark.slow
def test_water_that_flows_differently_from_place_to_place() -> None:
    best = dependences(base_on(voyage(water=sheared)))[0]
    assert best.on == "flow"
    assert best.gain.nats > 100.0
    assert best.gain.lost < 0.1
    assert "sway" in best.axes


@pytest.mark.parametrize(
    ("drive", "law", "alike"),
    [
        (np.full((900, 2), 0.3), pushed_on_course, {"heading", "speed", "thrust"}),
        (None, pushed, {"speed", "thrust", "turn"}),
    ],
)
def test_a_constant_push_is_told_and_not_that_it_depends_on_what_can_be_made_one(
    drive: Floats | None, law: Callable[..., Any], alike: set[str]
) -> None:
    """At one heading and one speed any function is one; bumps over a speed that varies add up."""
    found = dependences(base_on(voyage(drive, force=law)))
    worth_it = [d for d in found if d.gain.nats > 25.0]
    assert {"always", *alike} <= {d.on for d in worth_it}
    assert [d.on for d in without_repeats(worth_it)] == ["always"]


@pytest.mark.slow
def test_beside_a_push_what_depends_on_a_speed_that_varies_is_told() -> None:
    found = dependences(base_on(voyage(force=pushed_and_fouled)))
    told = without_repeats([d for d in found if d.gain.nats > 25.0])
    assert {"always", "speed"} <= {d.on for d in told}


def test_a_group_has_to_add_to_a_push_only_where_the_push_is_told() -> None:
    def of(on: str, nats: float, beside: float) -> Dependence:
        return Dependence(on, Gain(2.0, 0.5, 5.0, nats, 0.0), ("sway",), beside)

    small, large, push = of("speed", 90.0, 5.0), of("heading", 60.0, 5.1), of("always", 100.0, 0.0)
    assert without_repeats([small, large]) == [small, large]
    assert without_repeats([push, small, large]) == [push, large]
    much = of("always", 1000.0, 0.0)
    assert without_repeats([much, of("speed", 1020.0, 29.0)]) == [much]
    assert len(without_repeats([much, of("speed", 1020.0, 31.0)])) == 2
    assert without_repeats([]) == []


@pytest.mark.slow
def test_a_motor_that_comes_and_goes() -> None:
    trial = voyage(thrust=stuttering)
    assert rhythms(Model.of(WAM_V), trial)[0] == pytest.approx(2.0 * np.pi / PERIOD, rel=0.01)
    best = dependences(base_on(trial))[0]
    assert best.on == "rhythm"
    assert best.gain.nats > 100.0
    assert "surge" in best.axes
    assert best.share > 0.3


def test_a_sea_is_seen_by_the_period_that_what_is_left_swings_with() -> None:
    """Thirty waves of two seconds or so, of all phases, shake the hull sideways."""
    calm, chance = sailed(seconds=SECONDS), np.random.default_rng(8)
    rate, phase = chance.normal(np.pi, 0.3, 30), chance.uniform(0.0, 2.0 * np.pi, 30)
    turn, sway = np.outer(calm.time, rate) + phase, np.array([0.0, 1.0, 0.0])
    nu = calm.nu + 0.01 * np.outer(np.sin(turn).sum(axis=1), sway)
    nu_dot = calm.nu_dot + 0.01 * np.outer((rate * np.cos(turn)).sum(axis=1), sway)
    shaken = replace(calm, nu=nu, nu_dot=nu_dot)
    assert swing_period(base_on(shaken)) == pytest.approx(2.0, abs=0.5)
    assert swing_period(base_on(shaken, shaken, calm)) == pytest.approx(2.0, abs=0.5)
    assert swing_period(base_on(shaken, calm, calm)) is None  # one day of three makes no sea


@pytest.mark.slow
def test_what_changes_from_place_to_place_or_stops_now_and_then_has_no_period() -> None:
    """A flow that is another elsewhere, and motors that stop every nine seconds."""
    for trial in (voyage(water=sheared), voyage(thrust=stuttering)):
        assert swing_period(base_on(trial)) is None


def test_noise_has_no_period() -> None:
    assert swing_period(base_on(sailed(seconds=SECONDS))) is None
    assert swing_period(base_on(sailed(seconds=20.0))) is None  # too short for a spectrum


@pytest.mark.slow
def test_several_recordings_have_maps_of_their_own() -> None:
    best = dependences(base_on(voyage(water=sheared), sailed(seconds=100.0)))[0]
    assert best.on == "flow"


def test_noise_hangs_on_nothing() -> None:
    assert all(d.gain.nats < 10.0 for d in dependences(base_on(sailed(seconds=SECONDS))))


def test_a_trial_of_a_moment_has_no_rhythm() -> None:
    short = sailed(seconds=0.4)
    assert rhythms(Model.of(WAM_V), short) == pytest.approx([2.0 * np.pi / MAX_PERIOD_S] * 2)


def test_velocities_that_scatter_are_no_sea() -> None:
    """Their forces grow with the frequency up to where the smoother ends them: a hump of 4.6."""
    trial = sailed(seconds=SECONDS)
    white = np.random.default_rng(5).standard_normal(trial.nu.shape)
    smoother = butter(8, 1.0, fs=1.0 / trial.dt, output="sos")
    error = 0.1 * sosfiltfilt(smoother, white, axis=0)
    rate = np.gradient(error, trial.dt, axis=0)
    noisy = replace(trial, nu=trial.nu + error, nu_dot=trial.nu_dot + rate)
    assert swing_period(base_on(noisy)) is None
