"""The next manoeuvre: which one would tell the most of what these data leave open.

    rivals     nats = ½ min_z [ |r(z)|² + (z − ẑ)ᵀ H (z − ẑ) ]
               r: what the rival leaves of a voyage that the best model sails; H: what it must not
               forget of the data there are
    numbers    nats = ½ log det(1 + H⁻¹ JᵀJ),  J: slopes of the same voyage

Each manoeuvre of the library is sailed by the best model, with the noise of the sensors as it was
found. Source: Fedorov and Leonov, Optimal Design for Nonlinear Response Models, 2013 (T- and
D-optimality).

What would tell two effects apart that explain the same recording: in words, and as a manoeuvre.

One row per pair, from DESIGN §13 and from the laws: where the two differ at all, and what makes the
boat go there. A pair that is in no row has no such place that is known.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sim.diagnosis.fit import Fit
from sim.diagnosis.fit_problem import Ground
from sim.diagnosis.ranking import BLOCK
from sim.diagnosis.thresholds import RELIEF
from sim.excitation.catalogue import MANOEUVRES
from sim.excitation.manoeuvre import Limits, Manoeuvre
from sim.excitation.sticks import commands_of
from sim.identification.shooting import residuals_of, slope_of
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial

LONGEST = 240.0  # s of a manoeuvre that are looked at
GENTLE = Limits(throttle=0.7)  # nobody runs full ahead to settle a question
STEPS = 2


@dataclass(frozen=True)
class Suggested:
    """A manoeuvre, how long it takes [s], and the nats that it is expected to tell."""

    manoeuvre: Manoeuvre
    seconds: float
    nats: float

    @property
    def says(self) -> str:
        """In words."""
        return f"{self.manoeuvre.name}, {self.seconds:.0f} s: {self.manoeuvre.tells}"


def separating(best: Fit, rivals: Sequence[Fit]) -> list[Suggested]:
    """Manoeuvres by how well they would tell the best from the nearest rival, best first."""
    return _ordered(best, lambda trial: min(_left(best, rival, trial) for rival in rivals))


def informing(fit: Fit) -> list[Suggested]:
    """Manoeuvres by how much they would tell of the numbers of a fit, best first."""
    known = _known(fit)

    def nats(trial: Trial) -> float:
        ground = _ground(fit, trial)
        J = slope_of(fit.unknowns, ground.seen_by(fit.unknowns, fit.z), fit.z)
        told = np.linalg.slogdet(known + J.T @ J / RELIEF)[1] - np.linalg.slogdet(known)[1]
        return 0.5 * float(told)

    return _ordered(fit, nats)


def _ordered(best: Fit, nats: Callable[[Trial], float]) -> list[Suggested]:
    model = replace(best.unknowns.model, theta=best.unknowns.theta(best.z[None], 0)[0])
    out = []
    for manoeuvre in MANOEUVRES:
        trial = sailed(model, manoeuvre, best.ground.trials[0])
        if np.isfinite(trial.nu).all():
            seconds = float(trial.time[-1]) + trial.dt
            out.append(Suggested(manoeuvre, seconds, nats(trial)))
    return sorted(out, key=lambda s: -s.nats / s.seconds)


def sailed(model: Model, manoeuvre: Manoeuvre, like: Trial) -> Trial:
    """The voyage that a model makes of a manoeuvre, with sensors as in another trial."""
    suited = manoeuvre.suited(model.vessel, GENTLE)
    seconds = min(suited.seconds, LONGEST)
    commands = commands_of(suited, model.vessel, like.dt, 1, GENTLE, seconds)
    known = like.voltage[like.usable & np.isfinite(like.voltage)]
    volts = np.full(len(commands), known.mean() if len(known) else np.nan)
    _, reports = model.simulate(commands, like.dt, voltage=volts)
    motion = reports[0, :-1]
    channels, pwm = model.vessel.pulses(commands)
    count = len(commands)
    return Trial(
        name=manoeuvre.name, time=like.dt * np.arange(count, dtype=np.float64), eta=motion[:, :3],
        nu=motion[:, 3:6], nu_dot=motion[:, 6:9],
        covariance=np.broadcast_to(like.covariance[like.usable].mean(axis=0), (count, 9, 9)),
        channels=channels, pwm=pwm, voltage=volts, wind=np.full((count, 2), np.nan),
        usable=np.ones(count, np.bool_),
    )  # fmt: skip


def _ground(fit: Fit, trial: Trial) -> Ground:
    old = fit.ground
    return Ground.of(
        old.vessel, [trial], fit.unknowns, fit.z, old.noise[:1], old.settings, BLOCK
    )  # fmt: skip


def _known(fit: Fit) -> Floats:
    """What the data and the owner told of z already: (n, n)."""
    P = np.diag(np.array([u.prior for u in fit.unknowns.each]) ** -2.0)
    return np.asarray(fit.slope.T @ (fit.weight[:, None] * fit.slope) / RELIEF + P)


def _left(best: Fit, rival: Fit, trial: Trial) -> float:
    """Nats by which the rival falls behind on a voyage that the best model sails."""
    ground, known = _ground(rival, trial), _known(rival)
    lower, upper = rival.unknowns.bounds
    z = rival.z
    for _ in range(STEPS):
        windows = ground.seen_by(rival.unknowns, z)
        r, J = (
            residuals_of(rival.unknowns, windows, z[None])[0],
            slope_of(rival.unknowns, windows, z),
        )
        s = J.T @ r / RELIEF + known @ (z - rival.z)
        z = np.clip(z - np.linalg.lstsq(J.T @ J / RELIEF + known, s, rcond=None)[0], lower, upper)
    r = residuals_of(rival.unknowns, ground.seen_by(rival.unknowns, z), z[None])[0]
    away = z - rival.z
    return 0.5 * float(r @ r / RELIEF + away @ known @ away)


class Separation(NamedTuple):
    """What to do, and the excitation of `shadow plan` that comes nearest to it."""

    says: str
    excitation: str


ROUND = "full circles at two speeds: one turns with the boat, the other stays with the compass rose"
DRIFT = "drift with the motors off, then run one course at two speeds"
EITHER = "spin on the spot to the left and to the right, and go astern"
SPOT = "turn on the spot, then the same turns at speed"
EDGES = "steps and quick swings: a lag rounds them, a delay only moves them"
LONG = "the same run at the beginning and at the end, with a coast to a stop in each"
COAST = "accelerate to full speed, then coast to a stop: without thrust only drag is left"
RAMP = "a slow ramp of the throttle through neutral and up to full"

PAIRS: dict[tuple[str, str], Separation] = {
    ("steady_current", "varying_current"): Separation(
        "stay out longer than one period: the same circles again and again", "circles"
    ),
    ("steady_current", "steady_wind"): Separation(DRIFT, "still"),
    ("steady_current", "inertial_force"): Separation(DRIFT, "still"),
    ("steady_current", "heading_offset"): Separation(ROUND, "circles"),
    ("steady_current", "compass_deviation"): Separation(
        "full circles, ahead and astern: a deviation keeps its sign astern", "circles"
    ),
    ("steady_wind", "inertial_force"): Separation(
        "full circles at two speeds: the apparent wind grows with the boat's own speed", "circles"
    ),
    ("steady_wind", "compass_deviation"): Separation(
        "full circles, ahead and astern, and a drift with the motors off", "circles"
    ),
    ("steady_wind", "thruster_imbalance"): Separation(
        "full circles: wind changes its side, a motor does not; then motors off", "circles"
    ),
    ("steady_wind", "thruster_misalignment"): Separation(
        "full circles: wind changes its side, a motor does not; then motors off", "circles"
    ),
    ("cross_damping", "cg_offset"): Separation(SPOT, "spin"),
    ("cross_damping", "antenna_offset"): Separation(
        "spin on the spot: an antenna moves although no force acts on the boat", "spin"
    ),
    ("cross_damping", "hull_lift"): Separation(SPOT, "spin"),
    ("cg_offset", "antenna_offset"): Separation(SPOT, "spin"),
    ("cg_offset", "heading_offset"): Separation(
        "long straight runs, ahead and astern: an offset of the heading shows there", "steps"
    ),
    ("cg_offset", "thruster_imbalance"): Separation(EITHER, "spin"),
    ("cg_offset", "thruster_misalignment"): Separation(EITHER, "spin"),
    ("cubic_drag", "thrust_curve"): Separation(COAST, "steps"),
    ("cubic_drag", "advance_loss"): Separation(COAST, "steps"),
    ("towed_load", "advance_loss"): Separation(COAST, "steps"),
    ("drag_growth", "payload_change"): Separation(LONG, "steps"),
    ("drag_growth", "battery_sag"): Separation(
        LONG + "; and once with a fresh battery at the end", "steps"
    ),
    ("drag_growth", "thruster_fault"): Separation(
        LONG + "; a motor that fails also turns the boat", "steps"
    ),
    ("payload_change", "thruster_fault"): Separation(
        LONG + "; a motor that fails also turns the boat", "steps"
    ),
    ("battery_sag", "thruster_fault"): Separation(
        "one run with a full and one with a tired battery", "steps"
    ),
    ("battery_sag", "thrust_curve"): Separation(
        "one run with a full and one with a tired battery", "ramp"
    ),
    ("thruster_deadband", "thrust_curve"): Separation(RAMP, "ramp"),
    ("reverse_loss", "astern_stall"): Separation(
        "astern from rest, and astern while still running ahead", "reversals"
    ),
    ("thruster_imbalance", "thruster_misalignment"): Separation(EITHER, "reversals"),
    ("thruster_imbalance", "steering_offset"): Separation(
        "straight runs at two throttles, then coast with the helm amidships", "steps"
    ),
    ("thruster_misalignment", "steering_offset"): Separation(
        "straight runs at two throttles, then coast with the helm amidships", "steps"
    ),
    ("thruster_lag", "command_delay"): Separation(EDGES, "chirp"),
    ("thruster_lag", "velocity_latency"): Separation(
        "quick turns with a gyro in the log: a gyro is not late, a receiver's velocity is", "zigzag"
    ),
    ("command_delay", "velocity_latency"): Separation(
        "quick turns with a gyro in the log: a gyro is not late, a receiver's velocity is", "zigzag"
    ),
    ("thruster_lag", "steering_lag"): Separation(
        "steps of the throttle with the helm still, then of the helm at one throttle", "steps"
    ),
    ("command_delay", "steering_lag"): Separation(
        "steps of the throttle with the helm still, then of the helm at one throttle", "steps"
    ),
    ("compass_deviation", "heading_offset"): Separation(
        "full circles: a deviation changes with the heading, an offset does not", "circles"
    ),
}


def separation(one: str, other: str) -> Separation | None:
    """Of two effects, in any order."""
    return PAIRS.get((one, other)) or PAIRS.get((other, one))


def separations(names: list[str]) -> dict[tuple[str, str], Separation]:
    """Every pair among the names that a manoeuvre is known for."""
    pairs = [(a, b, separation(a, b)) for a, b in combinations(names, 2)]
    return {(a, b): found for a, b, found in pairs if found is not None}
