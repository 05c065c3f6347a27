"""Screening of the whole catalogue: where each effect would best begin, and what it promises.

From each start a damped Gauss–Newton step or two of the effect's own numbers together with those
of the reference, whose slopes are worked out once; from the best start as many as lead on. This
costs little enough to try a hundred starts: the fit that decides comes later, for the few that
promise most.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import (
    Fit,
    fit_effects,
    start_values,
    unknowns_for,
    with_event_at,
    with_given_base,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.effects.effect import Effect, Kind, Values
from sim.identification.parameters import Unknowns
from sim.identification.search import (
    MOMENT_STARTS,
    damped_steps,
    robust_cost,
    robust_weights,
    start_points,
)
from sim.identification.shooting import jacobian_of, residuals_and_slopes, residuals_of
from sim.model import Model
from sim.state import Floats, Ints
from sim.vessel import AddedEffect

Progress = Callable[[str], None]  # is given what is being done, in words
Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # maps as `map` does


@dataclass(frozen=True)
class ScreeningResult:
    """One effect at the best start found: z (n,) of its unknowns, and the cost there.

    place     column (n,) of each unknown in the reference's z, −1 of what that does not hold
    deviance  −2 log likelihood under the noise that it leaves itself; known once it is the best
    residual  at z, on the rows that it was screened on last; None where it was moved since
    """

    added: AddedEffect
    unknowns: Unknowns
    z: Floats
    cost: float
    place: Ints
    deviance: float = np.inf
    residual: Floats | None = None

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.added.effect.name


def screen(
    superset: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    progress: Progress = lambda _: None, mapper: Mapper = map, closer: bool = False,
    rival: Fit | None = None,
) -> list[ScreeningResult]:  # fmt: skip
    """All effects beside those that the reference holds, the most promising first.

    Each start is judged under the noise that the reference leaves; the effects are then put in
    order under the noise that each of them leaves. What is missing may be most of the noise of the
    reference, and under that noise the cause itself is forgiven (a compass that is off by a few
    degrees is as good as a receiver whose sway errs by as much).

    `model` is the vessel as the reference has it: waves are looked for in what it lacks. Where the
    reference moved the base far, the search begins from the base as it was given too: what stands
    in for the missing effect keeps it from its place. `mapper` may be that of a pool of threads:
    the kernels leave the interpreter free. `closer`: effects that declare further starts are fitted
    whole from each of them, on few rows. `rival`: another fit; an effect of whose starts none comes
    near what that explains of few rows is left out.
    """
    given = with_given_base(reference.unknowns, reference.z)
    references = [reference] if given is None else [reference, replace(reference, z=given)]
    # of a stiff hull fewer rows, for the same work
    stiffness = max(like.problem.stiffness(like.unknowns, like.z) for like in references)
    share = max(1.0 / stiffness, thresholds.MIN_SCREENED_SHARE)
    pairs = [
        [
            _Screening.of(superset, like, like.problem.thinned(round(share * rows)))
            for rows in (thresholds.SCREENED_ROWS, thresholds.COARSE_ROWS)
        ]
        for like in references
    ]

    def best(effect: Effect) -> ScreeningResult | None:
        progress(effect.name)
        starts, found = start_points(effect, model, reference.problem.trials), []
        measured = effect.measured is not None and effect.name in superset.measured
        if effect.measured is not None and measured:
            starts = [effect.measured.values]
        for fine, coarse in pairs:
            begins = [fine.at(effect, start) for start in starts]
            if len(starts) > thresholds.MANY_STARTS or rival is not None:
                begins = coarse.few(begins)
                least = min((r.cost for r in begins), default=np.inf)
                if rival is not None and least >= coarse.cost_of(rival):
                    continue
            found.append(fine.best(begins))
        if closer and effect.more_starts is not None and not measured:
            length = max(float(t.time[-1]) for t in reference.problem.trials)
            found.append(_closer(effect, effect.more_starts(length), *pairs[0]))
        return min((r for r in found if r is not None), key=lambda r: r.cost, default=None)

    results = {r.name: r for r in mapper(best, effects) if r is not None}
    for general in list(results.values()):
        special = results.get(general.added.effect.general_of)
        again = _from_general(pairs[0][0], special, general) if special else None
        if again is not None and again.cost < results[again.name].cost:
            results[again.name] = again
    fine = pairs[0][0]
    judged = mapper(fine.with_deviance, results.values())
    return sorted(judged, key=lambda r: r.deviance)


def _closer(
    effect: Effect, starts: Sequence[Values], fine: "_Screening", coarse: "_Screening"
) -> ScreeningResult | None:
    """The best of whole fits from each of the further starts; None where none can be fitted."""
    begins = [coarse.at(effect, start) for start in starts]
    fits = sorted((coarse.fitted(r) for r in begins), key=lambda r: r.cost)
    again = [fine.fitted(r) for r in fits[: thresholds.MAX_CLOSER_FITS]]
    moment = next((p.name for p in effect.parameters if p.kind is Kind.MOMENT), None)
    best = min(again, key=lambda r: r.cost)
    if not np.isfinite(best.cost):
        return None
    return best if moment is None else fine.fitted(fine._closed_in(best, moment))


def _from_general(
    screening: "_Screening", special: ScreeningResult, general: ScreeningResult
) -> ScreeningResult | None:
    """A special case begun where its general form ended; None where they share no parameter.

    A general form with more starts may lead where those of the special case do not.
    """
    found, name = general.unknowns, general.name
    theta = found.theta(np.clip(general.z, *found.bounds)[None], 0)[0]
    own = {
        key.partition(".")[2]: float(x)
        for key, x in zip(found.model.names, theta, strict=True)
        if key.startswith(f"{name}.")
    }
    start = {key: own.get(key, value) for key, value in special.added.values.items()}
    if not own.keys() & start.keys():
        return None
    return screening.best([screening.at(special.added.effect, start)])


@dataclass(frozen=True)
class _Screening:
    """The reference on few rows, with its slopes there."""

    superset: SupersetModel
    reference: Fit
    problem: FitProblem
    jacobian: Floats

    @classmethod
    def of(cls, superset: SupersetModel, reference: Fit, problem: FitProblem) -> "_Screening":
        unknowns, z = reference.unknowns, reference.z
        jacobian = jacobian_of(unknowns, problem.run_sets_for(unknowns, z), z)
        return cls(superset, reference, problem, jacobian)

    def best(self, begins: Sequence[ScreeningResult]) -> ScreeningResult | None:
        """From every beginning one step; from the best one more, as long as they lead on."""
        tried = [r for r in map(self._step, begins) if r is not None]
        if not tried:
            return None
        best = min(tried, key=lambda r: r.cost)
        for _ in range(thresholds.MAX_SCREENING_STEPS):
            further = self._step(best)
            if further is None or further.cost >= best.cost * (1.0 - thresholds.MIN_COST_DECREASE):
                break
            best = further
        parameters = best.added.effect.parameters
        moment = next((p.name for p in parameters if p.kind is Kind.MOMENT), None)
        return best if moment is None else self._closed_in(best, moment)

    def _closed_in(self, best: ScreeningResult, moment: str) -> ScreeningResult:
        """The moment of an event by bisection: no slope leads to it.

        First all along the recording again: few rows may have none around the moment itself.
        """
        longest = max(float(t.time[-1]) for t in self.problem.trials)
        every = np.linspace(0.0, longest, 2 * MOMENT_STARTS + 3)[1:-1]
        best = self._best_moment(best, moment, every)
        apart = 0.25 * longest / (MOMENT_STARTS + 1)
        while apart > thresholds.MOMENT_RESOLUTION_S:
            now = best.added.values[moment]
            best = self._best_moment(best, moment, (now - apart, now + apart))
            apart *= 0.5
        return best

    def _best_moment(
        self, best: ScreeningResult, moment: str, times: Iterable[float]
    ) -> ScreeningResult:
        """One step from each of these moments; the best where none leads further down."""
        tried = []
        for time in map(float, times):
            added = AddedEffect(best.added.effect, {**best.added.values, moment: time})
            unknowns = with_event_at(best.unknowns, f"{best.name}.{moment}", time)
            moved = replace(best, added=added, unknowns=unknowns, residual=None)
            tried.append(self._step(moved))
        return min([best, *(r for r in tried if r is not None)], key=lambda r: r.cost)

    def fitted(self, r: ScreeningResult) -> ScreeningResult:
        """Everything fitted from there, with slopes of its own at each step."""
        added = (*self.reference.added, r.added)
        try:
            fit = fit_effects(added, r.unknowns, self.problem, np.clip(r.z, *r.unknowns.bounds))
        except (ValueError, np.linalg.LinAlgError):  # the model is lost at this start
            return replace(r, cost=np.inf)
        return replace(r, z=fit.z, cost=fit.cost, residual=None)

    def few(self, begins: Sequence[ScreeningResult]) -> list[ScreeningResult]:
        """Where those lead that lead furthest: two steps from all, two more from every fourth."""
        left, keep = list(begins), max(len(begins) // 4, thresholds.MANY_STARTS)
        for most in (keep, thresholds.MANY_STARTS // 2):
            for _ in range(thresholds.COARSE_STEPS):
                left = [r for r in map(self._step, left) if r is not None]
            left = sorted(left, key=lambda r: r.cost)[:most]
        return [replace(r, residual=None) for r in left]  # they go on to other rows

    def cost_of(self, fit: Fit) -> float:
        """What another fit leaves of these rows, as the starts are judged."""
        run_sets = self.problem.run_sets_for(fit.unknowns, fit.z)
        left = residuals_of(fit.unknowns, run_sets, fit.z[None])
        cost = robust_cost(fit.unknowns, fit.z[None], left, thresholds.ROBUST_SIGMAS)
        return float(cost[0])

    def with_deviance(self, r: ScreeningResult) -> ScreeningResult:
        """The same, judged under its own noise."""
        return replace(r, deviance=self.problem.deviance(r.unknowns, r.z))

    def at(self, effect: Effect, start: Values) -> ScreeningResult:
        """A start, before the first step."""
        added = AddedEffect(effect, dict(start))
        trials, settings = len(self.problem.trials), self.problem.settings
        unknowns = unknowns_for(self.superset, [*self.reference.added, added], trials, settings)
        z = start_values(unknowns, self.reference)
        known = {(u.name, u.trial): i for i, u in enumerate(self.reference.unknowns.each)}
        place = np.array([known.get((u.name, u.trial), -1) for u in unknowns.each])
        return ScreeningResult(added, unknowns, z, np.inf, place)

    def _step(self, r: ScreeningResult) -> ScreeningResult | None:
        """The best of a few Levenberg–Marquardt steps; None where the model is lost."""
        unknowns, z = r.unknowns, np.clip(r.z, *r.unknowns.bounds)
        own, shared = np.flatnonzero(r.place < 0), np.flatnonzero(r.place >= 0)
        run_sets = self.problem.run_sets_for(unknowns, z)
        residual, J = residuals_and_slopes(unknowns, run_sets, z, own, known=r.residual)
        J[:, shared] = self.jacobian[:, r.place[shared]]
        if not np.isfinite(J).all():
            return None
        weight = robust_weights(residual, thresholds.ROBUST_SIGMAS)
        tried = np.clip(z + damped_steps(unknowns, z, residual, J, weight), *unknowns.bounds)
        left = residuals_of(unknowns, run_sets, tried)
        costs = robust_cost(unknowns, tried, left, thresholds.ROBUST_SIGMAS)
        k = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        here = float(robust_cost(unknowns, z, residual, thresholds.ROBUST_SIGMAS))
        if here <= costs[k]:
            return replace(r, z=z, cost=here, residual=residual)
        return replace(r, z=tried[k], cost=float(costs[k]), residual=left[k])
