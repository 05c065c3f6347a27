"""Whether numbers of the hull are further off than they were trusted to be.

One number that is off by a factor of three stops at the limit that its prior sets. Then the others
go to theirs, and an effect that scales all forces, or bends one of them, stands in for it: a moment
of inertia that is three times too large was told as motors that push half as much again. So where
numbers stand at their limits, what was found is fitted with more room for them; where fewer effects
do as well then, or the error falls further, the whole search is worth another run.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.answer import Diagnosis, LadderStep, Verdict
from sim.diagnosis.candidates import CandidateSearch
from sim.diagnosis.fit import (
    Fit,
    fit_effects,
    start_values,
    unknowns_for,
    with_given_base,
)
from sim.identification import BASE
from sim.vessel import AddedEffect


def numbers_at_limit(step: LadderStep, prior: float) -> list[str]:
    """Names of base numbers that went as far from the file as that relative prior allows."""
    return numbers_beyond(step, thresholds.LIMIT_SHARE * thresholds.MAX_BASE_SIGMAS * prior)


def numbers_beyond(step: LadderStep, share: float) -> list[str]:
    """Names of base numbers that are off by that share of what the file says, or further."""
    known = (e for e in step.base_parameters if e.name in BASE and e.before)
    return [e.name for e in known if abs(e.value - e.before) >= share * abs(e.before)]


def is_worth_more_room(fit: Fit, base: Fit, search: CandidateSearch) -> bool:
    """Whether with more room for the base numbers some of the effects of a fit, or none, do as well
    as all of them, or all do much better; `base`: without effects, with that room.
    """
    error, alone = _floors(fit, search), _floors(base, search)
    if alone < (thresholds.MAX_RIVAL_RATIO if fit.added else thresholds.MUCH_BETTER_RATIO) * error:
        return True
    effects = fit.effects()
    tried = [(effects, thresholds.MUCH_BETTER_RATIO)] if effects else []
    if len(effects) > 1:
        fewer = (tuple(a for a in effects if a is not one) for one in effects)
        tried += [(some, thresholds.MAX_ROOM_RATIO) for some in fewer]
    for some, ratio in tried:
        search.progress(f"more room beside {' and '.join(a.effect.name for a in some)}")
        other = _with_room(some, fit, base, search)
        if other is not None and _floors(other, search) < ratio * error:
            return True
    return False


def _floors(fit: Fit, search: CandidateSearch) -> float:
    """Error of a fit on unseen time in noise floors, by its own rulers where these are better."""
    scorer = search.scorer.shared_with(fit)
    return scorer.score_fit(fit).nrmse / scorer.noise_floor


def _with_room(
    added: Sequence[AddedEffect], like: Fit, base: Fit, search: CandidateSearch
) -> Fit | None:
    """These effects fitted as another fit has them, with the priors of `base`; None where the model
    is lost from every start.
    """
    problem = replace(like.renewed_problem, settings=base.problem.settings)
    unknowns = unknowns_for(search.superset, added, len(problem.trials), problem.settings)
    z = start_values(unknowns, like)
    fits = []
    for start in (z, start_values(unknowns, base), with_given_base(unknowns, z)):
        if start is not None:
            with suppress(ValueError, np.linalg.LinAlgError):
                fits.append(fit_effects(added, unknowns, problem, start))
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.cost)
    return fit_effects(added, unknowns, best.renewed_problem, best.z)


def is_simpler(other: Diagnosis, than: Diagnosis) -> bool:
    """Whether a diagnosis with more room for the base says as much with fewer effects, or predicts
    much better with as many, or knows where the first did not.
    """
    error, before = (d.ladder[-1].heldout.nrmse / d.noise_floor for d in (other, than))
    if other.verdict is Verdict.UNKNOWN:  # a hull that is bent to go with it explains nothing
        return False
    if than.verdict is Verdict.UNKNOWN:
        return error < before
    more = len(other.effects) - len(than.effects)
    if more < 0:
        return error < thresholds.MAX_ROOM_RATIO * before
    return more == 0 and error < thresholds.MUCH_BETTER_RATIO * before
