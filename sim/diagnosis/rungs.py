"""Fits as rungs of a ladder and rows of a ranking: with errors on unseen time and intervals."""

from collections.abc import Sequence

import numpy as np

from sim.diagnosis.answer import Candidate, Rung
from sim.diagnosis.fit import Fit
from sim.diagnosis.judged import Judge
from sim.diagnosis.ladder import Climb
from sim.diagnosis.numbers import estimates_in, vessel_of
from sim.diagnosis.ranking import Ranked, Ranking
from sim.diagnosis.verdict import rivals_of
from sim.model import Model


def ladder(climb: Climb, plain: Model, judge: Judge) -> tuple[Rung, ...]:
    """Plain, re-fitted, and a rung for each effect that was added."""
    names = [trial.name for trial in judge.trials]
    rungs = [
        Rung((), "plain", judge.plain(plain), (), {}, plain.vessel),
        _rung(climb.base, judge, names),
    ]
    return (*rungs, *(_rung(fit, judge, names) for fit in climb.fits))


def rungs_of(rows: Sequence[Ranked], judge: Judge) -> list[Rung]:
    """What was ranked, each with its own fit."""
    names = [trial.name for trial in judge.trials]
    return [_rung(row.fit, judge, names) for row in rows]


def later_rivals(climb: Climb, rivals: Sequence[Sequence[Ranked]], judge: Judge) -> list[Rung]:
    """The rivals of steps that were not chosen from the first ranking."""
    steps = zip(climb.steps, rivals, strict=True)
    return rungs_of([r for s, of in steps if s.ranking is not climb.first for r in of], judge)


def candidates_of(
    ranking: Ranking, alone: Sequence[Rung], found: Sequence[str]
) -> tuple[Candidate, ...]:
    """A ranking as it is told; `alone` has the rung of each, `found` what is on the ladder."""
    rivals = {r.name for r in rivals_of(ranking, found)}
    tied = rivals | {ranking.best.name} if rivals else set()
    return tuple(
        Candidate(
            r.name, r.probability, rung.heldout.nrmse,
            tuple(sorted(tied - {r.name})) if r.name in tied else (), _alike(ranking, r),
        )
        for r, rung in zip(ranking.finalists, alone, strict=True)
    )  # fmt: skip


def _rung(fit: Fit, judge: Judge, names: Sequence[str]) -> Rung:
    base, of_effects = estimates_in(fit, names)
    return Rung(
        fit.names, "refitted", judge.fitted(fit), base, of_effects, vessel_of(fit)
    )  # fmt: skip


def _alike(ranking: Ranking, row: Ranked) -> float:
    """Correlation of what an effect explains on unseen time with what the best one explains."""
    one, other = (ranking.unseen - r.unseen for r in (row, ranking.best))
    size = float(np.sqrt(np.sum(one**2) * np.sum(other**2)))
    return float(np.sum(one * other)) / size if size > 0.0 else 0.0
