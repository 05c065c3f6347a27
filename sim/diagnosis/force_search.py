"""Causes looked for together in the forces that a model lacks, where nothing runs free.

    r = means over a second of balance(ν̇, ν, …; z) / spread,   minimise Σ ρ(r) + ‖(z − z₀) / prior‖²

Where an effect makes the boat lighter r is of as much inertia as she had: the noise of
accelerations makes less of a force then, and seems to speak for it.

Along the measured motion the forces of all causes add up, and most of their numbers act on them
nearly in proportion. Where several causes hide one another in predictions, so that the first that
is chosen stands in for all, and bends the base to go with it, here they still stand side by side.
What accelerations tell is less than what predictions do: this gives a search its beginning and
decides nothing.

One effect after another, each time that which leaves least, with the base and all numbers fitted
anew; then each is chosen again beside the others, for the first was chosen while these were
missing. Source: orthogonal forward regression (Chen, Billings and Luo, International Journal of
Control 50, 1989), with laws in the place of regressors; the equation-error form as in Klein and
Morelli, Aircraft System Identification, 2nd ed. 2016, ch. 5.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import (
    Fit,
    Fitted,
    fit_effects,
    may_join,
    places_in,
    start_values,
    unknowns_for,
    with_event_at,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel, nats_of
from sim.diagnosis.residual_terms import MEDIAN_OF_ABSOLUTE
from sim.diagnosis.screening import Mapper
from sim.diagnosis.screening_steps import moment_of
from sim.effects.effect import Effect
from sim.identification import MASSES, IdentifySettings
from sim.identification.parameters import Unknowns
from sim.identification.search import (
    damped_steps,
    moved_by_steps,
    robust_cost,
    robust_weights,
)
from sim.model import Model
from sim.prediction import ForceInputs
from sim.state import Floats, Ints
from sim.trial import Trial
from sim.vessel import AddedEffect

UNIT_ACCELERATION = np.repeat([0.0, 1.0], [6, 3])  # m/s², rad/s², in reported motion (9,)


@dataclass(frozen=True)
class ForceFit:
    """Effects beside the base: z (n,), what is left in spreads (N,), the robust cost of it."""

    added: tuple[AddedEffect, ...]
    unknowns: Unknowns
    z: Floats
    residual: Floats
    cost: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(a.effect.name for a in self.added)

    def tried(self, jacobian: Floats) -> Floats:
        """Numbers (K, n) that its slopes (N, n) lead to."""
        weight = robust_weights(self.residual, thresholds.ROBUST_SIGMAS)
        steps = damped_steps(self.unknowns, self.z, self.residual, jacobian, weight)
        return np.clip(self.z + steps, *self.unknowns.bounds)

    def promised(self, jacobian: Floats) -> float:
        """The least cost that slopes (N, n) promise."""
        tried = self.tried(jacobian)
        after = self.residual + (tried - self.z) @ jacobian.T
        return float(robust_cost(self.unknowns, tried, after, thresholds.ROBUST_SIGMAS).min())


class StandingOut(NamedTuple):
    """Effects that stand out in the missing forces, and of each the names of what did nearly as
    well in its place, the best first.
    """

    fit: ForceFit
    promising: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class ForceProblem:
    """Missing forces of trials, each axis in its own spread (3,) [N, N, N m].

    inputs  of each trial, as the superset reads it
    """

    superset: SupersetModel
    trials: tuple[Trial, ...]
    inputs: tuple[ForceInputs, ...]
    settings: IdentifySettings
    spread: Floats

    @classmethod
    def of(
        cls, superset: SupersetModel, trials: Sequence[Trial], settings: IdentifySettings
    ) -> "ForceProblem":
        """Before any fit has told how wide the forces are spread."""
        inputs = tuple(ForceInputs.of(trial, superset.model) for trial in trials)
        return cls(superset, tuple(trials), inputs, settings, np.ones(3))

    def missing(self, added: Sequence[AddedEffect], unknowns: Unknowns, z: Floats) -> Floats:
        """Means of the missing force (K, N, 3) [N, N, N m] over usable seconds, at z (K, n)."""
        lighter = any(a.effect.inertia is not None for a in added)
        each = (
            self._means(trial, inputs, unknowns.model, unknowns.theta(z, k), lighter)
            for k, (trial, inputs) in enumerate(zip(self.trials, self.inputs, strict=True))
        )
        return np.concatenate(list(each), axis=1)

    def _means(
        self, trial: Trial, inputs: ForceInputs, model: Model, thetas: Floats, lighter: bool
    ) -> Floats:
        """Of one trial, with parameters (K, P)."""
        if model.vessel is not self.superset.model.vessel:  # plugs may be mixed up in it
            inputs = ForceInputs.of(trial, model)
        force = inputs.forces(trial, model, thetas)
        if lighter:
            faster = inputs._replace(motion=inputs.motion + UNIT_ACCELERATION)
            inertia = faster.forces(trial, model, thetas) - force
            base = thetas[:, [model.names.index(name) for name in MASSES]]
            force /= np.minimum(inertia / base[:, None], 1.0)
        size = max(round(thresholds.MEAN_FORCE_S / trial.dt), 1)
        seconds = len(trial) // size
        whole = slice(seconds * size)
        usable = trial.usable[whole].reshape(seconds, size).all(axis=1)
        means = force[:, whole].reshape(len(thetas), seconds, size, 3).mean(axis=2)
        return np.asarray(means[:, usable])

    def residuals(self, added: Sequence[AddedEffect], unknowns: Unknowns, z: Floats) -> Floats:
        """What is left (K, 3 N) in spreads, at z (K, n)."""
        far = thresholds.FAR_FORCE
        r = np.nan_to_num(self.missing(added, unknowns, z) / self.spread, nan=far)
        return np.clip(r, -far, far).reshape(len(z), 3 * r.shape[1])

    def fits(self, added: Sequence[AddedEffect], unknowns: Unknowns, z: Floats) -> list[ForceFit]:
        """A fit at each z (K, n)."""
        z = np.clip(z, *unknowns.bounds)
        left = self.residuals(added, unknowns, z)
        costs = robust_cost(unknowns, z, left, thresholds.ROBUST_SIGMAS)
        each = zip(z, left, costs.tolist(), strict=True)
        return [ForceFit(tuple(added), unknowns, *one) for one in each]

    def at(self, added: Sequence[AddedEffect], unknowns: Unknowns, z: Floats) -> ForceFit:
        """A fit where it begins, at z (n,)."""
        return self.fits(added, unknowns, z[None])[0]

    def with_effects(self, fit: Fitted, added: Sequence[AddedEffect]) -> ForceFit:
        """Other effects from where a fit ended, of forces or of predictions, those that it lacks
        from where they say.
        """
        unknowns = unknowns_for(self.superset, added, len(self.trials), self.settings)
        return self.at(added, unknowns, start_values(unknowns, fit))

    def jacobian(self, fit: ForceFit, columns: Ints | None = None) -> Floats:
        """∂ residual / ∂ z: (N, n), of some columns alone if given; the others are zero."""
        wanted = np.arange(len(fit.z)) if columns is None else columns
        J = np.zeros((len(fit.residual), len(fit.z)))
        moved, step = moved_by_steps(fit.unknowns, fit.z, wanted)
        left = self.residuals(fit.added, fit.unknowns, moved[1:])
        J[:, wanted] = ((left - fit.residual) / step[:, None]).T
        return J

    def stepped(self, fit: ForceFit, jacobian: Floats) -> ForceFit:
        """The best of a few steps; where it stands if none leads down."""
        tried = self.fits(fit.added, fit.unknowns, fit.tried(jacobian))
        return min([fit, *tried], key=_cost)

    def fitted(self, fit: ForceFit) -> ForceFit:
        """As many steps as lead on."""
        for _ in range(thresholds.FORCE_STEPS):
            before, fit = fit.cost, self.stepped(fit, self.jacobian(fit))
            if fit.cost > before * (1.0 - thresholds.SETTLED_DECREASE):
                break
        return fit

    def under_what_is_left(self, fit: ForceFit) -> tuple["ForceProblem", ForceFit]:
        """The same in spreads of what a fit leaves."""
        left = np.median(np.abs(self.missing(fit.added, fit.unknowns, fit.z[None])[0]), axis=0)
        left /= MEDIAN_OF_ABSOLUTE
        problem = replace(self, spread=np.where(left > 0.0, left, self.spread))
        return problem, problem.at(fit.added, fit.unknowns, fit.z)

    def screened(self, fit: ForceFit, shared: Floats, effect: Effect) -> ForceFit | None:
        """The best start of an effect beside a fit, and a step from there; `shared` (N, n): slopes
        of the fit.
        """
        model = replace(fit.unknowns.model, theta=fit.unknowns.theta(fit.z[None], 0)[0])
        best: tuple[float, ForceFit, Floats] | None = None
        for start in self.superset.starts(effect, model, self.trials):
            begun = self.with_effects(fit, [*fit.added, AddedEffect(effect, dict(start))])
            place = places_in(fit.unknowns, begun.unknowns)
            J = self.jacobian(begun, np.flatnonzero(place < 0))
            J[:, place >= 0] = shared[:, place[place >= 0]]
            promised = begun.promised(J) if np.isfinite(J).all() else np.inf
            if promised < (np.inf if best is None else best[0]):
                best = promised, begun, J
        return None if best is None else self.stepped(best[1], best[2])

    def followed(self, begun: ForceFit) -> ForceFit:
        """All numbers fitted; the moment of an event by bisection."""
        fit, effect = self.fitted(begun), begun.added[-1].effect
        moment = moment_of(effect)
        if moment is None:
            return fit
        apart = thresholds.LONGEST_SHARE_TO_A_MOMENT * max(float(t.time[-1]) for t in self.trials)
        while apart > thresholds.MOMENT_RESOLUTION_S:
            now = fit.added[-1].values[moment]
            moved = [self._with_moment(fit, moment, now + by) for by in (-apart, apart)]
            fit = min([fit, *(self.stepped(m, self.jacobian(m)) for m in moved)], key=_cost)
            apart *= 0.5
        return self.fitted(fit)

    def _with_moment(self, fit: ForceFit, moment: str, time: float) -> ForceFit:
        """The event of the last effect at another time [s]."""
        last = fit.added[-1]
        unknowns = with_event_at(fit.unknowns, f"{last.effect.name}.{moment}", time)
        added = (*fit.added[:-1], AddedEffect(last.effect, {**last.values, moment: time}))
        return self.at(added, unknowns, fit.z)


def search_forces(
    problem: ForceProblem, effects: Iterable[Effect], most: int, mapper: Mapper = map
) -> StandingOut:
    """Effects that each leave much less of the missing force than the others do without it, at
    `most` so many.
    """
    candidates = [e for e in effects if acts_at_once(e) and not e.is_like_the_base]
    unknowns = unknowns_for(problem.superset, [], len(problem.trials), problem.settings)
    fit = problem.at([], unknowns, unknowns.start)
    promising: dict[str, tuple[str, ...]] = {}
    for _ in range(thresholds.MAX_FORCE_CHOICES):
        for _ in range(
            thresholds.FORCE_ROUNDS
        ):  # else what comes next would seem better for what this still lacks
            problem, fit = problem.under_what_is_left(fit)
            fit = problem.fitted(fit)
        found = _beside(problem, fit, candidates, mapper) if len(fit.added) < most else []
        if found and found[0].cost < thresholds.MAX_FORCE_COST * fit.cost:
            fit = _special_first(found)
        elif (swap := _chosen_again(problem, fit, candidates, mapper)) is not None:
            fit, found = swap
        else:
            break
        promising[fit.names[-1]] = tuple(f.names[-1] for f in found)
    return StandingOut(fit, {name: promising[name] for name in fit.names})


def _beside(
    problem: ForceProblem, fit: ForceFit, effects: Iterable[Effect], mapper: Mapper
) -> list[ForceFit]:
    """The effects that promise most beside those of a fit, fitted, what leaves least first."""
    others = [e for e in effects if may_join(e, fit.added)]
    screened = mapper(partial(problem.screened, fit, problem.jacobian(fit)), others)
    begun = sorted((f for f in screened if f is not None), key=_cost)[: thresholds.FOLLOWED_FORCES]
    return sorted(mapper(problem.followed, begun), key=_cost)


def _chosen_again(
    problem: ForceProblem, fit: ForceFit, effects: Sequence[Effect], mapper: Mapper
) -> tuple[ForceFit, list[ForceFit]] | None:
    """Another effect in the place of one that was chosen earlier, where that leaves noticeably less
    or is its special case and leaves hardly more; with all that was tried there.
    """
    for i in range(len(fit.added) - 1):
        place = [a for k, a in enumerate(fit.added) if k != i]
        found = _beside(problem, problem.fitted(problem.with_effects(fit, place)), effects, mapper)
        if not found:
            continue
        best, present = _special_first(found), fit.added[i].effect
        is_special = present.general_of == best.names[-1]
        share = (
            thresholds.MAX_FORCE_COST_OF_SPECIAL
            if is_special
            else 1.0 - thresholds.MIN_SHARE_IN_PLACE
        )
        if best.names[-1] != present.name and best.cost < share * fit.cost:
            return best, found
    return None


def in_place_by_forces(
    problem: ForceProblem, fit: Fit, place: int, effects: Iterable[Effect], mapper: Mapper = map
) -> list[Fit]:
    """Effects in the place of one of a fit of predictions, the others beside them, each with all
    numbers fitted to the missing forces first and to predictions from there.

    From where another effect stood, with the base bent to go with that, a tow may end at the bow
    and go no further. Not those that leave much more than what stood there: of the missing force,
    or of predictions under the noise that they leave themselves.
    """
    present = fit.effects()
    others = [a for k, a in enumerate(present) if k != place]
    problem, whole = problem.under_what_is_left(problem.with_effects(fit, present))
    whole = problem.fitted(whole)
    beside = problem.fitted(problem.with_effects(whole, others))
    tried = [e for e in effects if acts_at_once(e) and may_join(e, others)]
    screened = mapper(partial(problem.screened, beside, problem.jacobian(beside)), tried)
    most = thresholds.MAX_FORCE_COST_IN_PLACE * whole.cost
    little = thresholds.MIN_SHARE_OF_FIRST_STEP * (beside.cost - whole.cost)
    limit = max(most, beside.cost - little)
    followed = mapper(problem.followed, [f for f in screened if f and f.cost < limit])
    begun = sorted((f for f in followed if f.cost < most), key=_cost)
    before = fit.problem.deviance(fit.unknowns, fit.z)

    def within_reach(start: ForceFit) -> Fit | None:
        last: tuple[Fit, float] | None = None
        for last in _rounds(start, fit.problem):
            if nats_of(last[1] - before) > thresholds.MAX_NATS_BEHIND_AT_FIRST:
                return None
        if last is None or nats_of(last[1] - before) > thresholds.MAX_NATS_BEHIND:
            return None
        return last[0]

    return [other for other in mapper(within_reach, begun) if other is not None]


def fit_under_its_noise(start: ForceFit | Fit, problem: FitProblem) -> Fit:
    """The effects of a fit, of forces or of predictions, fitted to predictions from there under the
    noise that they leave: under that of the bare base, and from what the base became without them,
    they would be lost again.
    """
    *_, (fit, _) = _rounds(start, problem)
    return fit


def _rounds(start: ForceFit | Fit, problem: FitProblem) -> Iterator[tuple[Fit, float]]:
    """Fit and noise in turn, from the numbers of a fit, as long as that leads on; with the deviance
    on the rows of the first problem.
    """
    before, now = np.inf, problem
    for _ in range(thresholds.MAX_ROUNDS_FROM_FORCES):
        fit = fit_effects(start.added, start.unknowns, _problem_at(start, now), start.z)
        deviance = problem.deviance(fit.unknowns, fit.z)
        yield fit, deviance
        if nats_of(before - deviance) < thresholds.MIN_NATS_OF_A_ROUND:
            return
        start, now, before = fit, fit.problem, deviance


def _problem_at(start: ForceFit | Fit, old: FitProblem) -> FitProblem:
    """With the runs and the noise that some numbers leave."""
    noise = old.noise_of(start.unknowns, start.z)
    return FitProblem.of(old.vessel, old.trials, start.unknowns, start.z, noise, old.settings)


def acts_at_once(effect: Effect) -> bool:
    """Whether what an effect does is told by the motion and the commands of one moment, in a form
    of its own: lags, mixed-up plugs and curves are looked for in predictions alone.
    """
    has_memory = effect.thrust_rate or effect.angle_rate or effect.rate
    return not (has_memory or effect.wiring or effect.is_curve or effect.partial)


def _special_first(found: Sequence[ForceFit]) -> ForceFit:
    """The best, or its special case where that does nearly as well."""
    best = found[0]
    special = (f for f in found if f.names[-1] == best.added[-1].effect.general_of)
    enough = best.cost * thresholds.MAX_FORCE_COST_OF_SPECIAL
    return next((f for f in special if f.cost < enough), best)


def _cost(fit: ForceFit) -> float:
    return fit.cost
