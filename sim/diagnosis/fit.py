"""A vessel with effects, fitted: base, effects and offsets in time together, on one fit problem.

    minimise  Σ ρ(rᵢ(z)) + ‖(z − z₀) / prior‖²,     r: whitened errors without what starts explain

The base is fitted along with every effect: a base that is frozen where it is a little off is
blamed on whatever effect lies nearest.

The moment of an event (a fault, a load taken aboard) has no slope: nothing changes until it passes
a sample, nor while the motor that failed rests. So it is moved along the trial, with all other
numbers following to first order,

    rise(t) = c(t) − min c,     c(t) = ½ min over δ of ‖√w (r_t + J δ)‖² + priors

and its interval holds all moments around the best whose rise stays below that of a Gaussian at its
limit (profile likelihood: Venzon and Moolgavkar, Applied Statistics 37, 1988).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis import thresholds
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.effects.effect import Effect, Kind
from sim.identification import BASE, IdentifySettings, updated_vessel
from sim.identification.intervals import NUISANCE, Estimate, estimates_of, uncertainty_of
from sim.identification.noise import Noise
from sim.identification.parameters import Unknown, Unknowns, unknowns_of
from sim.identification.search import (
    SearchLimits,
    damped_steps,
    robust_cost,
    robust_weights,
    search,
)
from sim.identification.shooting import (
    FitInputs,
    FitResult,
    fit_by_shooting,
    jacobian_of,
    residuals_of,
)
from sim.model import Model
from sim.state import Floats, Ints
from sim.vessel import AddedEffect, Vessel

Rows = NDArray[np.bool_] | slice
MEASURED = "does not count: these recordings measured what it stands for"


class PartialFits(NamedTuple):
    """Numbers (K, n) without each of K parts of the rows in turn, and all residuals then (K, N)."""

    z: Floats
    residual: Floats


@dataclass(frozen=True)
class Fit:
    """Effects beside the re-fitted base: z (n,) and what is left, (N,) whitened.

    told  estimates of numbers that are held, as other predictions of the same data have them
    """

    added: tuple[AddedEffect, ...]
    unknowns: Unknowns
    problem: FitProblem
    z: Floats
    residual: Floats
    told: tuple[Estimate, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(a.effect.name for a in self.added)

    @cached_property
    def jacobian(self) -> Floats:
        """∂ residual / ∂ z: (N, n)."""
        run_sets = self.problem.run_sets_for(self.unknowns, self.z)
        return jacobian_of(self.unknowns, run_sets, self.z)

    @cached_property
    def weight(self) -> Floats:
        """How much each residual counts, (N,): outliers less."""
        return robust_weights(self.residual, thresholds.ROBUST_SIGMAS)

    def steps(self, residual: Floats, rows: Rows = slice(None)) -> Floats:
        """Gauss–Newton steps (K, n) that some residuals ask for, the first not damped."""
        return damped_steps(
            self.unknowns, self.z, residual[rows], self.jacobian[rows], self.weight[rows]
        )

    @cached_property
    def fold_fits(self) -> PartialFits:
        """Without each fold of the problem in turn."""
        return self._fits_to([seen for seen, _ in self.problem.folds])

    @cached_property
    def recording_fits(self) -> PartialFits:
        """Without each trial in turn; what holds on that trial only keeps its numbers."""
        numbers = range(len(self.problem.trials))
        own = np.array([[u.trial == k for u in self.unknowns.each] for k in numbers])
        return self._fits_to([self.problem.places.trial != k for k in numbers], ~own)

    def _fits_to(
        self, rows: Sequence[NDArray[np.bool_]], free: NDArray[np.bool_] | None = None
    ) -> PartialFits:
        """The best of a few damped Gauss–Newton steps to each of K sets of rows (N,), none where
        all are worse; `free` (K, n): the numbers that may move.
        """
        steps = np.array([self.steps(self.residual, seen) for seen in rows])
        if free is not None:
            steps = steps * free[:, None]
        steps = np.concatenate([np.zeros_like(steps[:, :1]), steps], axis=1)
        z = np.clip(self.z + steps, *self.unknowns.bounds)
        residual = self.at(z.reshape(-1, len(self.z))).reshape(*z.shape[:2], -1)
        bend, counted = thresholds.ROBUST_SIGMAS, np.array(rows)[:, None]
        best = robust_cost(self.unknowns, z, residual, bend, counted).argmin(axis=1)
        part = np.arange(len(z))
        return PartialFits(z[part, best], residual[part, best])

    @cached_property
    def heldout_residual(self) -> Floats:
        """Residuals (N,) of each block as the fit without it leaves them."""
        out = self.residual.copy()
        for k, (_, heldout) in enumerate(self.problem.folds):
            out[heldout] = self.fold_fits.residual[k, heldout]
        return out

    @cached_property
    def noise(self) -> tuple[Noise, ...]:
        """Of each trial, as the fit leaves it."""
        return self.problem.noise_of(self.unknowns, self.z)

    @property
    def left_out_residual(self) -> Floats:
        """Residuals (N,) of each trial as the fit without it leaves them."""
        trial = self.problem.places.trial
        return np.asarray(self.recording_fits.residual[trial, np.arange(len(trial))])

    @property
    def noise_share(self) -> tuple[float, float, float]:
        """Standard deviation of what is left in u, v, r, over what the trials state for their
        measured velocities, the largest of all trials.
        """
        pairs = zip(self.noise, self.problem.run_sets, strict=True)
        u, v, r = np.max([noise.sigma / w.track_std for noise, w in pairs], axis=0)
        return float(u), float(v), float(r)

    @property
    def cost(self) -> float:
        """What the search lowered."""
        return float(robust_cost(self.unknowns, self.z, self.residual, thresholds.ROBUST_SIGMAS))

    def at(self, z: Floats) -> Floats:
        """Residuals (K, N) at other numbers z (K, n)."""
        return residuals_of(self.unknowns, self.problem.run_sets_for(self.unknowns, z[0]), z)

    @cached_property
    def renewed_problem(self) -> FitProblem:
        """With the noise that the fit leaves, starts linearised anew."""
        return self.problem_under(self.noise)

    def problem_under(self, noise: Sequence[Noise], like: "Fitted | None" = None) -> FitProblem:
        """The same under a noise of each trial, that of another model perhaps."""
        old, like = self.problem, like or self
        new = FitProblem.of(old.vessel, old.trials, self.unknowns, self.z, noise, old.settings)
        return new.under_colour_of(like.unknowns, like.z) if old.is_coloured else new

    def model(self, trial: int = 0) -> Model:
        """The vessel with these effects and numbers, as on one trial."""
        theta = self.unknowns.theta(self.z[None], trial)[0]
        return replace(self.unknowns.model, theta=theta)

    def values(self, effect: str, trial: int = 0) -> dict[str, float]:
        """The parameters of one of the effects, as found on a trial."""
        model = self.model(trial)
        places = {n: i for i, n in enumerate(model.names) if n.startswith(f"{effect}.")}
        return {n.partition(".")[2]: float(model.theta[i]) for n, i in places.items()}

    def effects(self, trial: int = 0) -> tuple[AddedEffect, ...]:
        """The effects with the parameters found."""
        return tuple(AddedEffect(a.effect, self.values(a.effect.name, trial)) for a in self.added)

    def vessel(self, trial: int = 0) -> Vessel:
        """The vessel with these effects and numbers, as on one trial."""
        model = self.model(trial)
        own = {u.name for u in self.unknowns.each if u.name in model.names}
        own -= {f"{a.effect.name}.{key}" for a in self.added for key in a.values}
        changed = {name: float(model.theta[model.names.index(name)]) for name in own}
        return updated_vessel(self.problem.vessel, changed).with_effects(*self.effects(trial))

    def estimates(self) -> tuple[tuple[Estimate, ...], Mapping[str, tuple[Estimate, ...]]]:
        """Base numbers, and those of each effect, with intervals; a choice has none."""
        problem, places = self.problem, self.problem.places
        result = FitResult(
            self.z, self.residual, self.jacobian, self.weight, places.begin, places.trial,
            problem.noise, problem.tracks,
        )  # fmt: skip
        uncertainty = uncertainty_of(self.unknowns, result, problem.settings.block)
        trials, told = [trial.name for trial in problem.trials], {e.name: e for e in self.told}
        found = estimates_of(self.unknowns, self.z, uncertainty, trials, problem.settings.filtered)
        every = [told.get(e.name, e) for e in found]
        base = tuple(e for e in every if "." not in e.name and e.name not in NUISANCE)
        of_effects = {}
        for a in self.added:
            name = a.effect.name
            fitted = tuple(e for e in every if e.name.startswith(f"{name}."))
            of_effects[name] = (*fitted, *_without_slope(self, a, {e.name for e in fitted}))
        return base, of_effects


def _without_slope(fit: Fit, added: AddedEffect, fitted: set[str]) -> list[Estimate]:
    """Numbers that have no slope: moments of events, and what was chosen among some."""
    known, out = {p.name: p for p in added.effect.parameters}, []
    for key, value in fit.values(added.effect.name).items():
        name = f"{added.effect.name}.{key}"
        if name not in fitted:
            event = known[key].kind is Kind.MOMENT
            ends = event_interval(fit, name) if event else (value, value)
            measured = added.effect.measured
            doubt = MEASURED if measured is not None and key in measured.values else ""
            out.append(Estimate(name, known[key].unit, value, value, ends, True, doubt=doubt))
    return out


def may_join(effect: Effect, added: Iterable[AddedEffect]) -> bool:
    """Whether an effect may stand beside some: none holds it, whole or as a part, and what it is
    one more of is there.
    """
    present = [a.effect for a in added]
    names = {e.name for e in present}
    held = effect.name in {*names, *(e.contains for e in present)} or effect.contains in names
    return not held and (not effect.beside or effect.beside in names)


def is_needed(effect: Effect, added: Iterable[AddedEffect]) -> bool:
    """Whether another one of them is there only because this one is."""
    return any(a.effect.beside == effect.name for a in added)


def unknowns_for(
    superset: SupersetModel, added: Sequence[AddedEffect], trials: int, settings: IdentifySettings
) -> Unknowns:
    """What is fitted with these effects in the vessel; they give where its effects start.

    What is known of a parameter beforehand stays where it was, wherever an earlier fit ended.
    """
    free = [name for a in added for name in superset.free_names(a.effect)]
    model = superset.with_added(added)
    unknowns = unknowns_of(model, trials, replace(settings, free=(*settings.free, *free)))
    pairs = ((a.effect.name, p) for a in added for p in a.effect.parameters if p.prior)
    known = {f"{name}.{p.name}": p.start for name, p in pairs}
    each = (replace(u, start=known[u.name]) if u.name in known else u for u in unknowns.each)
    return replace(unknowns, each=tuple(_bounded(u) for u in each))


def _bounded(u: Unknown) -> Unknown:
    """A number that was given may be off by a few times its doubt, and no more.

    Without a limit the base takes a shape that no hull has, to stand in for what is missing; from
    there no effect finds its way back.
    """
    if u.name not in BASE or u.assumed:
        return u
    far = thresholds.MAX_BASE_SIGMAS * u.prior
    return replace(u, lower=max(u.lower, u.start - far), upper=min(u.upper, u.start + far))


class Fitted(Protocol):
    """Numbers z (n,) that were found for unknowns."""

    @property
    def unknowns(self) -> Unknowns: ...
    @property
    def z(self) -> Floats: ...


def start_values(unknowns: Unknowns, like: Fitted | None) -> Floats:
    """z (n,) where another fit ended, as far as both look for the same numbers."""
    if like is None:
        return unknowns.start.copy()
    place = places_in(like.unknowns, unknowns)
    return np.where(place >= 0, like.z[place], unknowns.start)


def places_in(other: Unknowns, unknowns: Unknowns) -> Ints:
    """Column (n,) of each unknown among others, −1 of what those do not hold."""
    known = {(u.name, u.trial): i for i, u in enumerate(other.each)}
    return np.array([known.get((u.name, u.trial), -1) for u in unknowns.each])


def with_given_base(unknowns: Unknowns, z: Floats) -> Floats | None:
    """z (n,) with the base as it was given; None where it has hardly left that.

    A base that stood in for what is missing may have ended where no effect finds its way back.
    """
    base = np.array([u.name in BASE for u in unknowns.each])
    if not np.any(base & (np.abs(unknowns.prior_residuals(z)) > thresholds.RESTART_SIGMAS)):
        return None
    return np.where(base, unknowns.start, z)


def from_given_base(
    added: Sequence[AddedEffect], unknowns: Unknowns, problem: FitProblem, z: Floats
) -> Floats | None:
    """z (n,) with the base as it was given and the effects fitted to that; None where the base has
    hardly left it.

    A wind that stood in for the currents of several days, on a hull that a fit bent to go with it,
    is far from what it is on the hull as given: beside that even the right effect looks wrong.
    """
    given = with_given_base(unknowns, z)
    if given is None:
        return None
    base = np.array([u.name in BASE for u in unknowns.each])
    return fit_effects(added, unknowns.fixed(base), problem, given).z


def fit_effects(
    added: Sequence[AddedEffect], unknowns: Unknowns, problem: FitProblem, z: Floats
) -> Fit:
    """The best z from a start, by least squares with bounds."""
    run_sets = problem.run_sets_for(unknowns, z)
    residuals = partial(residuals_of, unknowns, run_sets)
    slopes: dict[bytes, Floats] = {}  # the last alone: those where the search ends

    def jacobian(z: Floats) -> Floats:
        slopes.clear()
        return slopes.setdefault(z.tobytes(), jacobian_of(unknowns, run_sets, z))

    limits = SearchLimits(thresholds.ROBUST_SIGMAS, thresholds.MAX_EVALUATIONS)
    found = search(residuals, jacobian, unknowns, z, limits)
    left, z = found.fun[: len(problem.block)], np.asarray(found.x)
    fit = Fit(tuple(added), unknowns, problem, z, left)
    if z.tobytes() in slopes:
        fit.__dict__["jacobian"] = slopes[z.tobytes()]  # as `cached_property` keeps it
    return fit


def event_names(fit: Fit) -> tuple[str, ...]:
    """Names `effect.parameter` of the moments of all events of a fit."""
    return tuple(
        f"{a.effect.name}.{p.name}"
        for a in fit.added
        for p in a.effect.parameters
        if p.kind is Kind.MOMENT
    )


def with_event_moved(fit: Fit, name: str) -> Fit:
    """The same with an event moved to where the data have it."""
    times, rise, z = _profile(fit, name)
    best = int(np.argmin(rise))
    moved = replace(fit, unknowns=with_event_at(fit.unknowns, name, times[best]), z=z[best])
    return replace(moved, residual=moved.at(moved.z[None])[0])


def event_interval(fit: Fit, name: str) -> tuple[float, float]:
    """95 % interval [s] of the moment of an event: from where it stands to where the data have it.

    The two are one after `with_event_moved`; a rival's event may stand beside.
    """
    times, rise, _ = _profile(fit, name)
    here, best = int(np.argmin(np.abs(times - _moment(fit, name)))), int(np.argmin(rise))
    low, high = min(here, best), max(here, best)
    while low > 0 and rise[low] < thresholds.MAX_EVENT_NATS:
        low -= 1
    while high < len(times) - 1 and rise[high] < thresholds.MAX_EVENT_NATS:
        high += 1
    return float(times[low]), float(times[high])


def _profile(fit: Fit, name: str) -> tuple[Floats, Floats, Floats]:
    """Moments (M,) [s], how much worse than the best of them (M,), the other numbers (M, n).

    An event that stands outside the longest trial is looked for at its ends.
    """
    trial = max(fit.problem.trials, key=len)
    apart = np.geomspace(trial.dt, trial.time[-1], thresholds.EVENT_POINTS)
    times = _moment(fit, name) + np.concatenate([-apart[::-1], [0.0], apart])
    inside = times[(times >= 0.0) & (times <= trial.time[-1])]
    times = inside if len(inside) else np.array([0.0, float(trial.time[-1])])
    cost, z = [], []
    for t in times:
        r = replace(fit, unknowns=with_event_at(fit.unknowns, name, t)).at(fit.z[None])[0]
        step = fit.steps(r)[0]
        left, pull = r + fit.jacobian @ step, fit.unknowns.prior_residuals(fit.z + step)
        cost.append(0.5 * (fit.weight @ left**2 + pull @ pull))
        z.append(np.clip(fit.z + step, *fit.unknowns.bounds))
    return times, np.array(cost) - min(cost), np.array(z)


def _moment(fit: Fit, name: str) -> float:
    model = fit.unknowns.model
    return float(model.theta[model.names.index(name)])


def with_event_at(unknowns: Unknowns, name: str, time: float) -> Unknowns:
    """The unknowns of a model with the event `effect.parameter` at another time [s]."""
    model = unknowns.model
    theta = model.theta.copy()
    theta[model.names.index(name)] = time
    return replace(unknowns, model=replace(model, theta=theta))


def final_fit(fit: Fit) -> Fit:
    """The same effects with their last numbers; the problem is that of the new fit."""
    for name in event_names(fit):
        fit = with_event_moved(fit, name)
    problem, unknowns = fit.problem, fit.unknowns
    trials, settings = problem.trials, problem.settings
    last = replace(settings, horizons=settings.horizons[-1:])
    shot = fit_by_shooting(FitInputs(unknowns, trials, last), fit.z)
    own = FitProblem.of(problem.vessel, trials, unknowns, shot.z, shot.noise, settings, shot.tracks)
    final = replace(fit, problem=own, z=shot.z)
    return replace(final, residual=final.at(shot.z[None])[0])
