"""The whole path on short voyages: what is named, what is refused, what the answer holds."""

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.body import Flow, Report, RudderParameters, ThrusterParameters
from sim.diagnosis import thresholds
from sim.diagnosis.answer import Diagnosis, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose, fit_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.free_curve import FREE_FORMS
from sim.diagnosis.heldout import rank
from sim.effects import (
    learned_history,
    learned_map,
    learned_profile,
    learned_reading,
    learned_rhythm,
    learned_spot,
)
from sim.effects.catalogue import named
from sim.effects.effect import Parameter
from sim.effects.learned_formula import ANGLE, MOTOR, RUDDER, THRUST, knot_places
from sim.effects.tables import EVENLY
from sim.prediction.segments import NoUsableTimeError
from sim.state import Floats, Pose, Water, Wrench, to_body
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import STD, sailed, sailed_with
from tests.sim.vessels import RUDDER_BOAT
from tests.sim.voyages import WAM_V, trial_of, voyage

FEW = DiagnoseSettings(
    effects=tuple(
        named(n)
        for n in ("steady_current", "heading_offset", "thruster_imbalance", "cubic_drag")
    ),
    most=2,
)  # fmt: skip


@cache
def complete() -> Diagnosis:
    return diagnose([sailed()], WAM_V, FEW)


@cache
def imbalanced() -> Diagnosis:
    return diagnose([sailed("thruster_imbalance", port_gain=0.8)], WAM_V, FEW)


def test_a_complete_model_is_adequate() -> None:
    found = complete()
    assert found.verdict is Verdict.ADEQUATE
    assert found.effects == ()
    assert [step.base for step in found.ladder] == ["plain", "kept"]  # there is nothing to fit
    assert found.vessel == WAM_V
    assert "no better with the base re-fitted" in found.summary


def test_a_model_is_not_called_complete_on_sensors_that_contradict_one_another() -> None:
    scale = "yaw rate (ATTITUDE) is 0.88 ± 0.01 times the turn of the heading (ATTITUDE)"
    found = diagnose([replace(sailed(), contradictions=(scale,))], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert f"the sensors contradict one another ({scale}): that comes before" in found.summary
    assert found.curve is None
    assert "contradict" not in complete().summary


def test_what_is_missing_is_named_and_the_error_falls() -> None:
    found = imbalanced()
    assert (found.verdict, found.effects) == (Verdict.EXPLAINED, ("thruster_imbalance",))
    gain = found.ladder[-1].parameters["thruster_imbalance"][0]
    assert gain.ci95[0] < 0.8 < gain.ci95[1]
    first, last = found.ladder[0].heldout.nrmse, found.ladder[-1].heldout.nrmse
    assert last < 0.5 * first
    assert f"falls from {first:.3f} to {last:.3f} (noise {found.noise_floor:.3f})" in found.summary
    assert found.ranking[0].effect == "thruster_imbalance"
    assert found.ranking[0].probability > 0.9
    assert [a.effect.name for a in found.vessel.effects] == ["thruster_imbalance"]
    errors = {(row.effect,): row.heldout_nrmse for row in found.ranking[1:]}
    assert {step.effects: step.heldout.nrmse for step in found.alternatives} == errors
    for step in found.alternatives:
        assert tuple(a.effect.name for a in step.vessel.effects) == step.effects
        assert step.parameters[step.effects[0]]


@pytest.mark.slow
def test_a_voyage_is_explained_alike_on_a_fine_and_on_a_coarse_grid() -> None:
    """10 Hz, as the library takes a log, and 5 Hz, as the command line does."""
    eta, nu, nu_dot, drive = voyage(200.0, 0.1, current=(0.2, -0.25))
    motion = np.hstack([eta, nu, nu_dot])
    motion += np.random.default_rng(5).normal(0.0, STD, motion.shape)
    parts, held = np.split(motion, 3, axis=1), drive.reshape(-1, 2, 2).mean(axis=1)
    fine = trial_of(*parts, drive, 0.1, np.diag(STD**2))
    coarse = trial_of(*(part[::2] for part in parts), held, 0.2, np.diag(STD**2))
    currents = ("steady_current", "varying_current", "current_change")
    few = replace(FEW, effects=tuple(named(n) for n in currents))
    fine_found, coarse_found = (diagnose([trial], WAM_V, few) for trial in (fine, coarse))
    assert fine_found.effects == coarse_found.effects == ("steady_current",)
    assert fine_found.verdict is coarse_found.verdict
    speeds = [f.ladder[-1].parameters["steady_current"][0] for f in (fine_found, coarse_found)]
    assert speeds[0].value == pytest.approx(speeds[1].value, abs=0.02)
    assert speeds[0].value == pytest.approx(np.hypot(0.2, 0.25), abs=0.02)


@pytest.mark.slow
def test_what_the_vessel_has_already_is_not_looked_for() -> None:
    trial = sailed("thruster_imbalance", port_gain=0.8)
    again = diagnose([trial], imbalanced().vessel, FEW)
    assert again.verdict is Verdict.ADEQUATE
    assert "thruster_imbalance" not in {row.effect for row in again.ranking}


@pytest.mark.slow
def test_what_is_not_in_the_catalogue_is_unknown_and_its_variable_named() -> None:
    """A push to starboard that grows with speed: no effect offered here can do that."""
    trial = sailed("hull_lift", Y_uv=0.0, Y_ur=0.0, N_uv=0.0, N_ur=0.0)
    pushed = sailed("cross_damping", Y_r=0.0, N_v=250.0)
    found = diagnose([pushed], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert "turn" in [d.on for d in found.depends_on]
    curve = found.curve  # N = 250 v, as a table
    assert curve is not None
    assert curve.effects == ("learned",)
    assert curve.heldout.nrmse < 0.5 * found.ladder[-1].heldout.nrmse
    filled = curve.vessel.effects[-1].values
    assert [filled[key] for key in EVENLY] == list(EVENLY.values())  # a line bends nowhere
    moment = 0.5 * WAM_V.hull.length * filled["full"] * (filled["f8"] - filled["f0"])
    assert moment / (filled["high"] - filled["low"]) == pytest.approx(250.0, rel=0.1)
    assert found.formula is not None
    assert found.formula.formula.form == "linear"
    assert found.formula.formula.numbers["c"] == pytest.approx(250.0, rel=0.1)
    assert found.formula.nrmse <= 1.03 * curve.heldout.nrmse
    assert found.formula.formula.text in found.summary
    assert "a moment to starboard" in found.summary
    assert "the speed sideways" in found.summary
    assert diagnose([trial], WAM_V, FEW).verdict is Verdict.ADEQUATE


def test_effects_at_the_noise_give_way_to_a_curve_that_explains_more() -> None:
    """Propellers draw air above 1.2 m/s: two effects come near, noise hides what they leave."""

    def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
        gone = 0.5 + 0.5 * np.tanh((flow.u - 1.2) / 0.1)
        return F * (1.0 - p.per_mps * gone * (F > 0.0))

    air = replace(named("advance_loss"), name="ventilation", thrust=thrust)
    few = DiagnoseSettings(effects=(named("cubic_drag"), named("advance_loss")), most=2)
    boat = WAM_V.with_effects(AddedEffect(air, {"per_mps": 0.2}))
    found = diagnose([sailed_with(boat, noise=2.6)], WAM_V, few)
    assert found.effects == ("advance_loss", "cubic_drag")
    assert max(found.noise_share) < 1.0
    assert found.ladder[-1].heldout.nrmse < 1.2 * found.noise_floor
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned",)
    assert found.curve.heldout.nrmse < 0.95 * found.ladder[-1].heldout.nrmse
    assert found.formula is not None
    assert found.formula.formula.form == "step"
    assert found.formula.formula.numbers["x0"] == pytest.approx(1.2, abs=0.05)
    assert found.formula.formula.numbers["c"] == pytest.approx(-0.2, abs=0.05)
    assert "nearest to it come advance_loss and cubic_drag" in found.summary


def steered(seconds: float = 200.0, seed: int = 3) -> Floats:
    """Throttle ahead, helm to both sides: (T, 2)."""
    rng, parts, dt = np.random.default_rng(seed), [], 0.1
    while sum(len(part) for part in parts) < seconds / dt:
        held = (rng.uniform(0.3, 0.9), rng.uniform(-1.0, 1.0))
        parts.append(np.tile(held, (int(rng.uniform(3.0, 8.0) / dt), 1)))
    return np.concatenate(parts)[: int(seconds / dt)]


@pytest.mark.slow
def test_a_motor_that_skips_a_band_is_told_with_the_edge_of_the_band() -> None:
    """From a tenth to half of full thrust it gives a tenth: a step, wherever even knots may be."""

    def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
        share = F / np.maximum(drive.ahead, 1e-9)
        skipped = (share > 0.1) * (share < p.per_mps)
        return F + skipped * (0.1 * drive.ahead - F)

    gap = replace(named("advance_loss"), name="gap", thrust=thrust)
    boat = WAM_V.with_effects(AddedEffect(gap, {"per_mps": 0.56}))
    found = diagnose([sailed_with(boat)], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    filled = found.curve.vessel.effects[-1].values
    assert (filled["by"], filled["acts"]) == (MOTOR, THRUST)
    places, shares = knot_places(filled), np.array([filled[f"f{k}"] for k in range(9)])
    edge = int(np.argmax(np.diff(shares)))
    assert places[edge] < 0.56 < places[edge + 1] < places[edge] + 0.15
    assert found.curve.heldout.nrmse < 0.1  # with even knots 0.22


@pytest.mark.slow
def test_a_linkage_that_gives_less_angle_is_told_as_a_curve_over_the_angle() -> None:
    """A third beyond 0.2 rad: the catalogue's steering is off, or late, and has no such shape."""

    def angle(δ: float, blade: RudderParameters, p: Any) -> float:
        inner = np.minimum(np.maximum(δ, -p.angle), p.angle)
        return inner + (δ - inner) / 3.0

    linkage = replace(named("steering_offset"), name="linkage", angle=angle)
    boat = RUDDER_BOAT.with_effects(AddedEffect(linkage, {"angle": 0.2}))
    few = replace(FEW, effects=(named("steering_offset"), named("hull_lift")))
    found = diagnose([sailed_with(boat, drive=steered())], RUDDER_BOAT, few)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    filled = found.curve.vessel.effects[-1].values
    assert (filled["by"], filled["acts"]) == (RUDDER, ANGLE)
    ends = filled["f8"] - filled["f0"]
    assert ends == pytest.approx(-2.0 * (0.6 - 0.2) * 2.0 / 3.0, rel=0.2)
    assert "an angle of the steering that differs with the angle" in found.summary


@pytest.mark.slow
def test_what_only_fits_at_its_limit_is_no_finding() -> None:
    """A boat that is five times as heavy from one moment on: no payload may be more than three."""
    heavier = Parameter("factor", "-", lower=0.3, upper=9.0, start=1.0, scale=0.05, neutral=1.0)
    payload = named("payload_change")
    load = replace(payload, name="ballast", parameters=(heavier, *payload.parameters[1:]))
    boat = WAM_V.with_effects(AddedEffect(load, {"factor": 5.0, "time": 100.0}))
    found = diagnose([sailed_with(boat)], WAM_V, replace(FEW, effects=(payload,), most=1))
    assert found.effects == ()
    assert found.verdict is Verdict.UNKNOWN
    (reason,) = (r.reason for r in found.refused if r.effect == "payload_change")
    assert reason.startswith("factor of payload_change stands at its limit, 3: it stands in for")


@pytest.mark.slow
@pytest.mark.parametrize("across", [0.0, 0.35])
def test_water_that_differs_across_a_line_is_told_as_a_profile(across: float) -> None:
    """It runs to the east, the faster the further on one way: no current of the catalogue can.

    A way between north and north-east is found, too, and the profile turned to it.
    """

    def way(north: Any, east: Any) -> Any:
        return north * np.cos(across) + east * np.sin(across)

    def water(time: float, pose: Pose, p: Any) -> Water:
        return Water(0.0, p.speed * np.tanh(0.03 * way(pose.north, pose.east)), 0.0, 0.0)

    shear = replace(named("steady_current"), name="shear", water=water)
    boat = WAM_V.with_effects(AddedEffect(shear, {"speed": 0.5, "direction": 0.0}))
    trial = sailed_with(boat)
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_profile",)
    assert found.curve.heldout.nrmse < 0.5 * found.ladder[-1].heldout.nrmse
    filled = found.curve.vessel.effects[-1].values
    assert filled["direction"] == pytest.approx(across, abs=0.1)
    now = learned_profile.water(0.0, Pose(*trial.eta[trial.usable].T), SimpleNamespace(**filled))
    true = 0.5 * np.tanh(0.03 * way(*trial.eta[trial.usable, :2].T))
    assert np.abs(now.east - true).mean() < 0.05
    assert np.abs(now.north).mean() < 0.05
    where = "north" if across == 0.0 else "towards "
    assert f"water that flows differently on the way {where}" in found.summary


@pytest.mark.slow
def test_water_that_differs_from_place_to_place_is_told_as_a_map() -> None:
    """It turns to the other side on either side of both axes: no profile across a line can."""

    def saddle_at(north: Any, east: Any) -> Any:
        return np.tanh(0.04 * (east - 50.0)), np.tanh(0.04 * (north + 50.0))

    def water(time: float, pose: Pose, p: Any) -> Water:
        to_north, to_east = saddle_at(pose.north, pose.east)
        return Water(p.speed * to_north, p.speed * to_east, 0.0, 0.0)

    saddle = replace(named("steady_current"), name="saddle", water=water)
    boat = WAM_V.with_effects(AddedEffect(saddle, {"speed": 0.5, "direction": 0.0}))
    trial = sailed_with(boat, 600.0, seed=3)
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_map",)
    filled = found.curve.vessel.effects[-1].values
    pose = Pose(*trial.eta[trial.usable].T)
    now = learned_map.water(0.0, pose, SimpleNamespace(**filled))
    to_north, to_east = saddle_at(pose.north, pose.east)
    assert np.abs(now.east - 0.5 * to_east).mean() < 0.06
    assert np.abs(now.north - 0.5 * to_north).mean() < 0.06
    assert "water that flows differently from place to place" in found.summary


@pytest.mark.slow
def test_a_shoal_is_told_as_a_place_that_drags() -> None:
    """A drag that fades as a bell from the middle of a shoal: no effect has it, nor any push."""

    def force(flow: Flow, p: Any) -> Wrench:
        near = np.exp(-((flow.north - 10.0) ** 2 + (flow.east - 5.0) ** 2) / 12.0**2)
        return Wrench(
            p.X_uuu * near * (flow.body.X_u + flow.body.X_uu * abs(flow.u)) * flow.u, 0, 0
        )

    shoal = replace(named("cubic_drag"), name="shoal", force=force)
    trial = sailed_with(WAM_V.with_effects(AddedEffect(shoal, {"X_uuu": 2.0})), 300.0)
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_drag",)
    filled = found.curve.vessel.effects[-1].values
    assert np.hypot(filled["north"] - 10.0, filled["east"] - 5.0) < 2.0
    assert filled["more"] == pytest.approx(2.0, rel=0.25)
    assert " more within 1" in found.summary


@pytest.mark.slow
def test_an_eddy_is_told_as_water_that_turns_around_a_place() -> None:
    """It turns like a solid in its middle and fades as 1 / d outside (Rankine's vortex)."""

    def water(time: float, pose: Pose, p: Any) -> Water:
        n, e = pose.north - 12.0, pose.east - 4.0
        size = p.speed / 10.0 / np.maximum(1.0, (n**2 + e**2) / 10.0**2)
        return Water(-size * e, size * n, 0.0, 0.0)

    eddy = replace(named("steady_current"), name="eddy", water=water)
    trial = sailed_with(
        WAM_V.with_effects(AddedEffect(eddy, {"speed": -0.5, "direction": 0.0})), 300.0
    )
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_spot",)
    filled = found.curve.vessel.effects[-1].values
    assert filled["acts"] == learned_spot.EDDY
    assert np.hypot(filled["north"] - 12.0, filled["east"] - 4.0) < 2.0
    pose = Pose(*trial.eta[trial.usable].T)
    now = learned_spot.water(0.0, pose, SimpleNamespace(**filled))
    true = water(0.0, pose, SimpleNamespace(speed=-0.5))
    assert np.abs(now.north - true.north).mean() < 0.05
    assert np.abs(now.east - true.east).mean() < 0.05
    assert "water that turns anticlockwise around N 1" in found.summary


@pytest.mark.slow
def test_a_line_to_an_anchor_is_told_as_a_pull_towards_it() -> None:
    """Slack within 15 m of it, and taut beyond: no effect has an end."""

    def force(flow: Flow, p: Any) -> Wrench:
        n, e = flow.north - 5.0, flow.east + 3.0
        away = np.sqrt(n**2 + e**2)
        pull = p.force * np.maximum(away - 15.0, 0.0) / np.maximum(away, 1e-6)
        X, Y = to_body(-pull * n, -pull * e, flow.yaw)
        return Wrench(X, Y, 0.0)

    line = replace(named("inertial_force"), name="line", force=force)
    trial = sailed_with(
        WAM_V.with_effects(AddedEffect(line, {"force": 4.0, "direction": 0.0})), 300.0
    )
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_spot",)
    filled = found.curve.vessel.effects[-1].values
    assert filled["acts"] == learned_spot.PULL
    assert np.hypot(filled["north"] - 5.0, filled["east"] + 3.0) < 3.0
    assert "a pull towards N " in found.summary


@pytest.mark.slow
@pytest.mark.parametrize("of", ["thrust", "wind"])
def test_what_comes_and_goes_is_told_as_a_rhythm(of: str) -> None:
    """A motor that stops for 2.5 s in each 9.1, and a wind that blows for 14 s in each 48."""

    def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
        stops = (drive.number == 1.0) * (flow.time % 9.1 < 2.5)
        return F * (1.0 - p.per_mps * stops)

    def force(flow: Flow, p: Any) -> Wrench:
        X, Y = to_body(0.0, p.force * (flow.time % 48.0 < 14.0), flow.yaw)
        return Wrench(X, Y, 0.0)

    if of == "thrust":
        cause = replace(named("advance_loss"), name="stutter", thrust=thrust)
        added, acts = AddedEffect(cause, {"per_mps": 1.0}), learned_rhythm.THRUST
    else:
        cause = replace(named("inertial_force"), name="squalls", force=force)
        added, acts = AddedEffect(cause, {"force": 30.0, "direction": 0.0}), learned_rhythm.PUSH
    trial = sailed_with(WAM_V.with_effects(added), 300.0)
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_rhythm",)
    filled = found.curve.vessel.effects[-1].values
    period = (filled["until"] - filled["since"]) / filled["times"]
    if of == "thrust":
        told = (filled["thruster"], period, filled["lasts"], filled["size"])
        assert told == pytest.approx((2.0, 9.1, 2.5, -1.0), rel=0.1)
        assert "a thrust of thruster 2 that changes and comes back every 9.1 s" in found.summary
    else:
        told = (period, filled["lasts"], filled["size"] * filled["full"], filled["direction"])
        assert told == pytest.approx((48.0, 14.0, 30.0, 0.5 * np.pi), rel=0.1)
        assert "a push over the ground that comes and goes every 48 s" in found.summary
    assert filled["acts"] == acts


def test_no_map_is_drawn_from_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    """What changes from place to place, or as time goes by, needs minutes."""
    asked: list[list[str]] = []
    monkeypatch.setattr(
        f"{diagnose.__module__}.find_free_curve",
        lambda *given, **_: asked.append([form.name for form in given[5]]),
    )
    few = DiagnoseSettings(prior=1.0, effects=(named("cubic_drag"),), most=0)
    for seconds in (100.0, 200.0):
        diagnose([sailed("cross_damping", seconds, Y_r=0.0, N_v=250.0)], WAM_V, few)
    of_a_boat = ["learned", "learned_pair", "learned_reading"]
    of_a_day = ["drag", "spot", "profile", "map", "history", "rhythm", "anomaly"]
    assert [set(forms) for forms in asked] == [
        set(of_a_boat),
        {*of_a_boat, *(f"learned_{name}" for name in of_a_day)},
    ]
    monkeypatch.setattr(thresholds, "MAX_RECORDINGS_OF_TABLES", 0)
    diagnose([sailed("cross_damping", 200.0, Y_r=0.0, N_v=250.0)], WAM_V, few)
    assert asked[2] == of_a_boat  # of many recordings each would have its own


@pytest.mark.slow
def test_soft_iron_is_told_as_an_error_of_the_heading() -> None:
    """Twice around where the catalogue's deviation goes once around."""

    def observe(report: Report, p: Any) -> Report:
        d = p.b * np.sin(2.0 * report.yaw)
        d_dot = 2.0 * p.b * np.cos(2.0 * report.yaw) * report.r
        u, v = to_body(report.u, report.v, d)
        u_dot, v_dot = to_body(report.u_dot, report.v_dot, d)
        return report._replace(
            yaw=report.yaw + d, u=u, v=v, u_dot=u_dot + d_dot * v, v_dot=v_dot - d_dot * u
        )

    iron = replace(named("compass_deviation"), name="soft_iron", observe=observe)
    trial = sailed_with(WAM_V.with_effects(AddedEffect(iron, {"b": 0.2, "c": 0.0})), 300.0)
    found = diagnose([trial], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_reading",)
    filled = found.curve.vessel.effects[-1].values
    assert (filled["acts"], filled["by"]) == (learned_reading.OF_HEADING, learned_reading.HEADING)
    places = np.linspace(0.0, 2.0 * np.pi, 60)
    p = SimpleNamespace(**filled)
    told = np.array([learned_reading.table(x, p) for x in places])
    assert np.sqrt(np.mean((told - 0.2 * np.sin(2.0 * places)) ** 2)) < 0.04
    assert "the heading that is reported is off with the heading" in found.summary


def test_a_curve_of_the_boat_is_not_looked_for_where_sensors_contradict_one_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It would be one of their errors; but such an error may be a curve."""
    asked: list[list[str]] = []
    monkeypatch.setattr(
        f"{diagnose.__module__}.find_free_curve",
        lambda *given, **_: asked.append([form.name for form in given[5]]),
    )
    few = DiagnoseSettings(effects=(named("cubic_drag"),), most=0)
    diagnose([replace(sailed(), contradictions=("a lag",))], WAM_V, few)
    assert [set(forms) for forms in asked] == [{"learned_reading", "learned_anomaly"}]


@pytest.mark.slow
def test_motors_that_warm_up_are_told_as_a_time_history() -> None:
    def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
        return F * (1.0 - p.per_mps * np.exp(-flow.time / 50.0))

    cold = replace(named("advance_loss"), name="cold", thrust=thrust)
    boat = WAM_V.with_effects(AddedEffect(cold, {"per_mps": 0.5}))
    found = diagnose([sailed_with(boat)], WAM_V, FEW)
    assert found.verdict is Verdict.UNKNOWN
    assert found.curve is not None
    assert found.curve.effects == ("learned_history",)
    filled = found.curve.vessel.effects[-1].values
    assert filled["acts"] == learned_history.THRUST
    assert filled["f0"] - filled["f8"] == pytest.approx(-0.5, abs=0.12)
    assert "a share of the thrust that changes with the time" in found.summary


@pytest.mark.slow
def test_what_was_found_is_held_against_a_curve_whatever_it_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At the noise free runs hardly tell a cause from one that lies near, so all are asked."""
    trial, asked = sailed("thruster_imbalance", port_gain=0.8), []
    monkeypatch.setattr(
        f"{diagnose.__module__}.find_free_curve", lambda *_, **how: asked.append(how)
    )
    one = DiagnoseSettings(effects=(named("thruster_imbalance"),), most=1)
    for times in (1.0, 1.5):
        asked.clear()
        stated = replace(trial, covariance=times**2 * trial.covariance)
        found = diagnose([stated], WAM_V, one)
        assert found.verdict is Verdict.EXPLAINED
        assert asked == [{"beside": False}]
    ranked = diagnose([trial], WAM_V, replace(one, most=0))
    assert not ranked.effects
    assert ranked.ranking[0].effect == "thruster_imbalance"


@pytest.mark.slow
def test_a_curve_that_comes_nowhere_near_what_was_found_is_not_fitted() -> None:
    trial, cause = sailed("thruster_imbalance", port_gain=0.8), named("thruster_imbalance")
    superset, bare = (SupersetModel.of(WAM_V, effects) for effects in ([cause], []))
    base = fit_base(bare, bare.model, [trial], FEW)
    right = rank(superset, base.model(), [cause], base).best.fit
    assert rank(bare, base.model(), FREE_FORMS, base).finalists
    assert rank(bare, base.model(), FREE_FORMS, base, rival=base).finalists
    assert not rank(bare, base.model(), FREE_FORMS, base, rival=right).finalists


def test_too_little_time_is_said() -> None:
    trial = sailed(seconds=100.0)
    short = replace(trial, usable=trial.usable & (trial.time < 40.0))
    with pytest.raises(NoUsableTimeError, match="60 s are needed"):
        diagnose([short], WAM_V, FEW)


def test_the_answer_is_plain_json_without_gaps() -> None:
    said = complete().to_dict()
    json.dumps(said, allow_nan=False)
    assert set(said) >= {"verdict", "summary", "ladder", "ranking", "refused", "unexplained"}
    assert all(np.isfinite(step["heldout_nrmse"]) for step in said["ladder"])


def test_an_empty_catalogue_gives_an_answer() -> None:
    found = diagnose([sailed()], WAM_V, DiagnoseSettings(effects=()))
    assert found.verdict is Verdict.ADEQUATE
    assert found.ranking == found.alternatives == ()
    json.dumps(found.to_dict(), allow_nan=False)


def test_a_boat_at_rest_gives_an_answer() -> None:
    trial = sailed()
    nothing = {name: np.zeros_like(getattr(trial, name)) for name in ("eta", "nu", "nu_dot")}
    still = replace(trial, **nothing, pwm=np.full_like(trial.pwm, 1500.0))
    found = diagnose([still], WAM_V, FEW)
    assert found.verdict is Verdict.ADEQUATE
    json.dumps(found.to_dict(), allow_nan=False)


def test_time_in_pieces_too_short_to_compare_over_is_said() -> None:
    trial = sailed()
    with pytest.raises(NoUsableTimeError, match="long enough to compare over"):
        diagnose([replace(trial, usable=trial.time % 2.0 < 1.5)], WAM_V, FEW)
