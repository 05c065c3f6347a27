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

import numpy as np

from sim.diagnosis.fit import Fit
from sim.diagnosis.fit_problem import FitProblem
from sim.diagnosis.ranking import BLOCK
from sim.diagnosis.thresholds import RELIEF
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Separation
from sim.excitation.catalogue import MANOEUVRES
from sim.excitation.manoeuvre import Manoeuvre, StickLimits
from sim.excitation.sticks import manoeuvre_commands
from sim.identification.shooting import jacobian_of, residuals_of
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial

LONGEST = 240.0  # s of a manoeuvre that are looked at
GENTLE = StickLimits(throttle=0.7)  # nobody runs full ahead to settle a question
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
        return f"{self.manoeuvre.name}, {self.seconds:.0f} s: {self.manoeuvre.reveals}"


def separating(best: Fit, rivals: Sequence[Fit]) -> list[Suggested]:
    """Manoeuvres by how well they would tell the best from the nearest rival, best first."""
    return _ordered(best, lambda trial: min(_left(best, rival, trial) for rival in rivals))


def informing(fit: Fit) -> list[Suggested]:
    """Manoeuvres by how much they would tell of the numbers of a fit, best first."""
    known = _known(fit)

    def nats(trial: Trial) -> float:
        ground = _ground(fit, trial)
        J = jacobian_of(fit.unknowns, ground.seen_by(fit.unknowns, fit.z), fit.z)
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
    suited = manoeuvre.adapted_to(model.vessel, GENTLE)
    seconds = min(suited.seconds, LONGEST)
    commands = manoeuvre_commands(suited, model.vessel, like.dt, 1, GENTLE, seconds)
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


def _ground(fit: Fit, trial: Trial) -> FitProblem:
    old = fit.ground
    return FitProblem.of(
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
            jacobian_of(rival.unknowns, windows, z),
        )
        s = J.T @ r / RELIEF + known @ (z - rival.z)
        z = np.clip(z - np.linalg.lstsq(J.T @ J / RELIEF + known, s, rcond=None)[0], lower, upper)
    r = residuals_of(rival.unknowns, ground.seen_by(rival.unknowns, z), z[None])[0]
    away = z - rival.z
    return 0.5 * float(r @ r / RELIEF + away @ known @ away)


def separation(one: str, other: str) -> Separation | None:
    """Of two effects, in any order."""
    known = {effect.name: effect.separated for effect in EFFECTS}
    return known.get(one, {}).get(other) or known.get(other, {}).get(one)


def separations(names: list[str]) -> dict[tuple[str, str], Separation]:
    """Every pair among the names that a manoeuvre is known for."""
    pairs = [(a, b, separation(a, b)) for a, b in combinations(names, 2)]
    return {(a, b): found for a, b, found in pairs if found is not None}
