"""The whole catalogue beside the effects found so far: which explains most of held-out time.

    screen all → noise as the most promising leaves it → fit the few → held-out blocks → order

The noise is that of the most promising explanation, which is the one that the screening finds most
likely under the noise that it leaves itself. Estimated from what the reference leaves, it would
take the very thing that is looked for as a slow error of the sensors, and forgive it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, fit_effects, with_given_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.heldout import Gain, gain, per_block, probabilities
from sim.diagnosis.screening import Mapper, Progress, ScreeningResult, screen
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect
from sim.model import Model

CATALOGUE = frozenset(effect.name for effect in EFFECTS)
FIRST_IMPRESSION = "first impression"  # begins the line of progress that is worth keeping


@dataclass(frozen=True)
class RankedEffect:
    """One effect beside the reference: fitted, and its gain on held-out time."""

    effect: Effect
    fit: Fit
    gain: Gain
    probability: float

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name

    def gain_over(self, other: "RankedEffect") -> Gain:
        """What this one is worth over another of the same ranking."""
        before, after = other.fit.heldout_residual, self.fit.heldout_residual
        return gain(before, after, self.fit.problem.block)


@dataclass(frozen=True)
class Ranking:
    """The reference and all finalists on one fit problem, the best first; perhaps none."""

    reference: Fit
    finalists: tuple[RankedEffect, ...]

    @property
    def best(self) -> RankedEffect:
        """The first."""
        return self.finalists[0]

    def led_by(self, row: RankedEffect) -> "Ranking":
        """The same with one of the finalists before the others."""
        return replace(self, finalists=(row, *(r for r in self.finalists if r is not row)))


def rank(
    superset: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    progress: Progress = lambda _: None, mapper: Mapper = map, closer: bool = False,
) -> Ranking:  # fmt: skip
    """All effects beside those of the reference, each with everything fitted anew.

    closer: those that declare further starts are fitted from each of them.
    """
    results = screen(superset, model, effects, reference, progress, mapper, closer)
    if not results:
        return Ranking(reference, ())
    results = select_finalists(results)
    name = results[0].name
    if not reference.names and len(results) > 1:
        others = " or ".join(r.name for r in results[1:3])
        progress(f"{FIRST_IMPRESSION}: most like {name}, then {others}, if anything is missing")
    leader: ScreeningResult | Fit = results[0]
    for _ in range(thresholds.MAX_NOISE_ROUNDS):
        progress(f"fitting {', '.join(r.name for r in results)}")
        ranking = _rank_finalists(reference, results, leader, mapper)
        if ranking.best.name == name:
            break
        name, leader = ranking.best.name, ranking.best.fit
    return ranking


def select_finalists(results: Sequence[ScreeningResult]) -> list[ScreeningResult]:
    """Those worth a whole fit: with a share of the best one's promise, and a few more.

    Fitted whatever they promise: an effect that is not of the catalogue, for somebody asks for it,
    and the special case of a general form, which comes first if it does as well.
    """
    deviance, few = [r.deviance for r in results], results[: thresholds.MAX_FINALISTS]
    least = max(deviance) - thresholds.MIN_PROMISE * (max(deviance) - deviance[0])
    chosen = [r for i, r in enumerate(few) if i < thresholds.MIN_FINALISTS or r.deviance < least]
    special = {r.added.effect.general_of for r in chosen}
    wanted = [r for r in results if r.name in special or r.name not in CATALOGUE]
    return [*chosen, *(r for r in wanted if r not in chosen)]


def _rank_finalists(
    reference: Fit, results: Sequence[ScreeningResult], leader: Fit | ScreeningResult,
    mapper: Mapper,
) -> Ranking:  # fmt: skip
    """The finalists under the noise that one of them leaves."""
    noise = reference.problem.noise_of(leader.unknowns, leader.z)
    problem = reference.problem_under(noise)
    before = fit_effects(reference.added, reference.unknowns, problem, reference.z)

    def whole(r: ScreeningResult) -> tuple[Fit, Gain]:
        again = with_given_base(r.unknowns, r.z)
        starts = [r.z] if again is None else [r.z, again]
        added = (*reference.added, r.added)
        fit = min(
            (fit_effects(added, r.unknowns, problem, z) for z in starts), key=lambda f: f.cost
        )
        return fit, gain(before.heldout_residual, fit.heldout_residual, problem.block)

    pairs = list(mapper(whole, results))
    residuals = [fit.heldout_residual for fit in (before, *(fit for fit, _ in pairs))]
    chance = probabilities(np.array([per_block(r, problem.block) for r in residuals]))[1:]
    rows = [
        RankedEffect(fit.added[-1].effect, fit, g, float(p))
        for (fit, g), p in zip(pairs, chance, strict=True)
    ]
    rows.sort(key=lambda r: -r.gain.ratio)
    return Ranking(before, _special_first(rows))


def _special_first(rows: list[RankedEffect]) -> tuple[RankedEffect, ...]:
    """A general effect steps behind its special case where that does as well."""
    for i, row in enumerate(rows):
        special = next((r for r in rows[i + 1 :] if r.name == row.effect.general_of), None)
        if special is not None:
            more = row.gain_over(special)
            if more.t < thresholds.MIN_T_BETTER or more.log_ratio < thresholds.MIN_LOG_RATIO_BETTER:
                rows.remove(special)
                rows.insert(i, special)
    return tuple(rows)
