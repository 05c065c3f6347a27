"""The whole catalogue beside what was found so far: who explains most of unseen time.

    screen all → noise as the most promising leaves it → fit the few → held-out blocks → order

The noise is that of the most promising explanation. Estimated from what the reference leaves, it
would take the very thing that is looked for as a slow error of the sensors, and forgive it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis.fit import Fit, as_given, fitted
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.heldout import Gain, gain, per_block, probabilities, unseen
from sim.diagnosis.screening import Each, Promise, Tell, screened
from sim.effects.effect import Effect
from sim.identification.parameters import Unknowns
from sim.identification.shooting import noise_of_runs
from sim.model import Model
from sim.state import Floats

FINALISTS = 6  # that are fitted whole, at most
FEWEST = 3
HOPEFUL = 0.1  # of what the best promises
BLOCK = 25.0  # s
ROUNDS = 2  # noise and finalists in turn, as long as another one leads
CLEAR = 3.0  # t over the blocks: one is really better than the other
SHOWS = 0.02  # mean log ratio of squared errors: what it is better by can be seen


@dataclass(frozen=True)
class Ranked:
    """One effect beside the reference: fitted, and its gain on held-out time."""

    effect: Effect
    fit: Fit
    unseen: Floats
    gain: Gain
    probability: float

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name


@dataclass(frozen=True)
class Ranking:
    """The reference and all finalists on one ground, the best first."""

    reference: Fit
    unseen: Floats
    finalists: tuple[Ranked, ...]

    @property
    def best(self) -> Ranked:
        """The first."""
        return self.finalists[0]

    def led_by(self, row: Ranked) -> "Ranking":
        """The same with one of the finalists before the others."""
        return replace(self, finalists=(row, *(r for r in self.finalists if r is not row)))


def rank(
    wide: SupersetModel,
    model: Model,
    effects: Iterable[Effect],
    reference: Fit,
    tell: Tell = lambda _: None,
    each: Each = map,
) -> Ranking:
    """All effects beside those of the reference, each with everything fitted anew."""
    promises = hopeful(screened(wide, model, effects, reference, tell, each))
    leader: Promise | Ranked = promises[0]
    for _ in range(ROUNDS):
        tell(f"fitting {', '.join(p.effect.name for p in promises)}")
        ranking = _finals(reference, promises, leader, each)
        if ranking.best.name == leader.effect.name:
            break
        leader = ranking.best
    return ranking


def hopeful(promises: Sequence[Promise]) -> list[Promise]:
    """Those worth a whole fit: who promises a share of what the best does, and a few more."""
    nothing = max(p.cost for p in promises)
    least = nothing - HOPEFUL * (nothing - promises[0].cost)
    return [p for i, p in enumerate(promises[:FINALISTS]) if i < FEWEST or p.cost < least]


def _finals(
    reference: Fit, promises: Sequence[Promise], leader: "Promise | Ranked", each: Each
) -> Ranking:
    """The finalists under the noise that one of them leaves."""
    fit = leader.fit if isinstance(leader, Ranked) else leader
    ground = renewed(reference, fit.unknowns, fit.z)
    before = fitted(reference.added, reference.unknowns, ground, reference.z)

    def whole(p: Promise) -> tuple[Fit, Floats]:
        added, again = (*reference.added, p.added), as_given(p.unknowns, p.z)
        starts = [p.z] if again is None else [p.z, again]
        fits = [fitted(added, p.unknowns, ground, z) for z in starts]
        fit = min(fits, key=lambda f: f.cost)
        return fit, unseen(fit)

    fits = list(each(whole, promises))
    return _ordered(before, unseen(before), fits)


def _ordered(before: Fit, left: Floats, fits: Sequence[tuple[Fit, Floats]]) -> Ranking:
    block = before.ground.block
    found = [e for _, e in fits]
    chance = probabilities(np.array([per_block(e, block) for e in (left, *found)]))[1:]
    rows = [
        Ranked(f.added[-1].effect, f, e, gain(left, e, block), float(p))
        for (f, e), p in zip(fits, chance, strict=True)
    ]
    rows.sort(key=lambda r: -r.gain.ratio)
    return Ranking(before, left, _simpler_first(rows))


def _simpler_first(rows: list[Ranked]) -> tuple[Ranked, ...]:
    """A general effect steps behind its special case where that does as well."""
    for i, row in enumerate(rows):
        special = row.effect.general_of
        twin = next((r for r in rows[i + 1 :] if r.name == special), None)
        if twin is not None:
            block = row.fit.ground.block
            more = gain(twin.unseen, row.unseen, block)
            if more.t < CLEAR or more.log < SHOWS:
                rows.remove(twin)
                rows.insert(i, twin)
    return tuple(rows)


def renewed(reference: Fit, unknowns: Unknowns, z: Floats) -> FitProblem:
    """The ground with noise as a model with these numbers leaves it, starts linearised anew."""
    ground = reference.ground
    noise = [noise_of_runs(w, unknowns, z) for w in ground.seen_by(unknowns, z)]
    return FitProblem.of(
        ground.vessel, ground.trials, reference.unknowns, reference.z, noise, ground.settings, BLOCK
    )
