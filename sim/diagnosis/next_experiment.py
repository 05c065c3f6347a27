"""The next manoeuvre: which one would tell the most of what these data leave open.

    rivals     nats = ½ min_z [ |r(z)|² + (z − ẑ)ᵀ H (z − ẑ) ]
               r: what the rival leaves of a voyage that the best model makes; H: what it must not
               forget of the data there are
    numbers    nats = ½ log det(1 + H⁻¹ JᵀJ),  J: slopes of the same voyage

Each manoeuvre of the library is simulated by the best model, with the noise of the sensors as it
was found. Source: Fedorov and Leonov, Optimal Design for Nonlinear Response Models, 2013 (T- and
D-optimality). What separates a pair of effects in words stands with the effects
(`Effect.separated`): where the two differ at all, and what makes the boat go there.

**Refusals**: effects that these data cannot show, and what a recording would have to hold.

A guess on data that cannot show the thing is worse than no answer: a lag cannot be seen through
commands at 2 Hz, a compass deviation not on one heading, a loss astern not on a voyage ahead.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit
from sim.diagnosis.fit_problem import FitProblem
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Separation, Shown
from sim.excitation import Manoeuvre, StickLimits, manoeuvre_commands
from sim.excitation.catalogue import MANOEUVRES
from sim.identification.shooting import jacobian_of, residuals_of
from sim.model import Model
from sim.prediction import vessel_commands
from sim.state import Eta, Floats, Nu
from sim.trial import Trial
from sim.vessel import Vessel

LIMITS = StickLimits(throttle=thresholds.MAX_THROTTLE)


@dataclass(frozen=True)
class SuggestedManoeuvre:
    """A manoeuvre, how long it takes [s], and the nats that it is expected to tell."""

    manoeuvre: Manoeuvre
    seconds: float
    nats: float

    @property
    def description(self) -> str:
        """In words."""
        return f"{self.manoeuvre.name}, {self.seconds:.0f} s: {self.manoeuvre.reveals}"


def by_separation(best: Fit, rivals: Sequence[Fit]) -> list[SuggestedManoeuvre]:
    """Manoeuvres by how well they would tell the best from the nearest rival, best first."""
    return _ordered(best, lambda trial: min(_nats_against(rival, trial) for rival in rivals))


def by_information(fit: Fit) -> list[SuggestedManoeuvre]:
    """Manoeuvres by how much they would tell of the numbers of a fit, best first."""
    known = _information(fit)

    def nats(trial: Trial) -> float:
        problem = _problem_on(fit, trial)
        J = jacobian_of(fit.unknowns, problem.run_sets_for(fit.unknowns, fit.z), fit.z)
        more = np.linalg.slogdet(known + J.T @ J / thresholds.ROWS_PER_INDEPENDENT_ROW)[1]
        return 0.5 * float(more - np.linalg.slogdet(known)[1])

    return _ordered(fit, nats)


def _ordered(best: Fit, nats: Callable[[Trial], float]) -> list[SuggestedManoeuvre]:
    """Most nats per second first; without manoeuvres that the model cannot make."""
    out = []
    for manoeuvre in MANOEUVRES:
        trial = simulated_trial(best.model(), manoeuvre, best.problem.trials[0])
        if np.isfinite(trial.nu).all() and np.isfinite(expected := nats(trial)):
            seconds = float(trial.time[-1]) + trial.dt
            out.append(SuggestedManoeuvre(manoeuvre, seconds, expected))
    return sorted(out, key=lambda s: -s.nats / s.seconds)


def simulated_trial(model: Model, manoeuvre: Manoeuvre, like: Trial) -> Trial:
    """The voyage that a model makes of a manoeuvre, with sensors as in another trial."""
    suited = manoeuvre.adapted_to(model.vessel, LIMITS)
    seconds = min(suited.seconds, thresholds.MAX_MANOEUVRE_S)
    commands = manoeuvre_commands(suited, model.vessel, like.dt, 1, LIMITS, seconds)
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


def _problem_on(fit: Fit, trial: Trial) -> FitProblem:
    old = fit.problem
    return FitProblem.of(old.vessel, [trial], fit.unknowns, fit.z, old.noise[:1], old.settings)


def _information(fit: Fit) -> Floats:
    """What the data and the priors tell of z already: (n, n)."""
    P = np.diag(np.array([u.prior for u in fit.unknowns.each]) ** -2.0)
    J = fit.jacobian
    return np.asarray(J.T @ (fit.weight[:, None] * J) / thresholds.ROWS_PER_INDEPENDENT_ROW + P)


def _nats_against(rival: Fit, trial: Trial) -> float:
    """Nats by which the rival falls behind on a voyage that the best model makes."""
    problem, known = _problem_on(rival, trial), _information(rival)
    lower, upper = rival.unknowns.bounds
    z = rival.z
    for _ in range(thresholds.RIVAL_STEPS):
        run_sets = problem.run_sets_for(rival.unknowns, z)
        r = residuals_of(rival.unknowns, run_sets, z[None])[0]
        J = jacobian_of(rival.unknowns, run_sets, z)
        H = J.T @ J / thresholds.ROWS_PER_INDEPENDENT_ROW + known
        s = J.T @ r / thresholds.ROWS_PER_INDEPENDENT_ROW + known @ (z - rival.z)
        z = np.clip(z - np.linalg.lstsq(H, s, rcond=None)[0], lower, upper)
    r = residuals_of(rival.unknowns, problem.run_sets_for(rival.unknowns, z), z[None])[0]
    away = z - rival.z
    return 0.5 * float(r @ r / thresholds.ROWS_PER_INDEPENDENT_ROW + away @ known @ away)


def separation(one: str, other: str) -> Separation | None:
    """What separates two effects, in any order; None where nothing is known to."""
    known = {effect.name: effect.separated for effect in EFFECTS}
    return known.get(one, {}).get(other) or known.get(other, {}).get(one)


def separations(names: Sequence[str]) -> dict[tuple[str, str], Separation]:
    """Every pair among the names that a manoeuvre is known for."""
    pairs = [(a, b, separation(a, b)) for a, b in combinations(names, 2)]
    return {(a, b): known for a, b, known in pairs if known is not None}


@dataclass(frozen=True)
class Refusal:
    """An effect that is not judged, and why; or, `doubted`, would help and is not believed."""

    effect: str
    reason: str
    doubted: bool = False


@dataclass(frozen=True)
class RecordingContent:
    """What the trials hold between them.

    seconds, longest   of usable time in all, and in one trial
    sectors            of eight, that headings under way lie in
    astern             s with a motor astern
    voltage_variation  standard deviation over mean; 0 where it was not measured
    rates_hz           the lowest of each stream
    """

    seconds: float
    longest: float
    sectors: int
    astern: float
    voltage_variation: float
    rates_hz: Mapping[str, float]

    @classmethod
    def of(cls, model: Model, trials: Sequence[Trial]) -> "RecordingContent":
        """Of the usable rows."""
        eta, nu = (np.concatenate([getattr(t, k)[t.usable] for t in trials]) for k in ("eta", "nu"))
        heading = eta[np.abs(nu[:, Nu.U]) > thresholds.MIN_UNDER_WAY_MPS, Eta.YAW] % (2.0 * np.pi)
        sector = (heading // (2.0 * np.pi / thresholds.HEADING_SECTORS)).astype(int)
        share = np.bincount(sector, minlength=thresholds.HEADING_SECTORS) / max(len(sector), 1)
        motors = len(model.vessel.thrusters)
        commands = [vessel_commands(model, t)[t.usable, :motors] for t in trials]
        astern = [np.any(c < thresholds.ASTERN_COMMAND, axis=1).sum() for c in commands]
        volts: Floats = np.concatenate([t.voltage[t.usable] for t in trials])
        volts = volts[np.isfinite(volts)]
        measured = len(volts) > 1 and np.mean(volts) > 0.0
        rates: dict[str, float] = {}
        for t in trials:
            for name, rate in t.rates_hz.items():
                rates[name] = min(rate, rates.get(name, np.inf))
        seconds = [float(t.usable.sum()) * t.dt for t in trials]
        return cls(
            sum(seconds), max(seconds), int(np.sum(share > thresholds.MIN_SECTOR_SHARE)),
            sum(float(rows) * t.dt for rows, t in zip(astern, trials, strict=True)),
            float(np.std(volts) / np.mean(volts)) if measured else 0.0, rates,
        )  # fmt: skip


def refusals(effects: Sequence[Effect], content: RecordingContent, vessel: Vessel) -> list[Refusal]:
    """Effects that cannot be told from recordings of this content with this vessel, and why."""
    out = []
    for effect in effects:
        lacking = vessel.unmet_needs(effect)
        reasons = [f"it needs {lacking} in the vessel file" if lacking else ""]
        reasons += [_missing_from(content, shown) for shown in effect.shown_by]
        if reason := next(filter(None, reasons), ""):
            out.append(Refusal(effect.name, reason))
    return out


def _missing_from(content: RecordingContent, shown: Shown) -> str:
    """What the trials lack of one thing that has to be shown, in words; empty where nothing."""
    sectors = f"headings in {content.sectors} of {thresholds.HEADING_SECTORS} sectors"
    match shown:
        case Shown.COMMANDS | Shown.VELOCITY:
            name = "commands" if shown is Shown.COMMANDS else "velocity"
            rate, needed = content.rates_hz.get(name, np.inf), thresholds.MIN_RATE_HZ
            if rate < (1.0 - thresholds.RATE_TOLERANCE) * needed:
                return f"{name} at {rate:.1f} Hz: {needed:g} Hz are needed to tell it"
        case Shown.CHANGE if content.longest < thresholds.MIN_CHANGE_S:
            needed = thresholds.MIN_CHANGE_S
            return f"{content.longest:.0f} s: {needed:.0f} s are needed to tell a change in time"
        case Shown.ASTERN if content.astern < thresholds.MIN_ASTERN_S:
            astern = f"{content.astern:.0f} s"
            return f"motors ran astern for {astern}: go astern, and brake from speed"
        case Shown.CIRCLES if content.sectors < thresholds.MIN_SECTORS_FOR_CIRCLES:
            return f"{sectors}: sail full circles"
        case Shown.OPPOSITE if content.sectors < thresholds.MIN_SECTORS_FOR_OPPOSITE:
            return f"{sectors}: sail opposite headings"
        case Shown.VOLTAGE if content.voltage_variation < thresholds.MIN_VOLTAGE_VARIATION:
            known = "hardly changed" if content.voltage_variation > 0.0 else "was not measured"
            return f"the voltage {known}: a run on a full and on a tired battery is needed"
    return ""
