"""What does as well as an effect that was found: what the answer has to name beside it."""

from collections.abc import Sequence
from dataclasses import replace

from sim.diagnosis import thresholds
from sim.diagnosis.heldout import HeldOutScorer, RankedEffect, Ranking, rank
from sim.diagnosis.ladder import EffectSearch, Selection
from sim.diagnosis.verdict import rivals_of


def all_rivals_of(step: Ranking, search: EffectSearch, selection: Selection) -> list[RankedEffect]:
    """What does as well as the effect of a step, also of what these trials cannot show.

    Beside all the others, and no more: what did as well while those were missing, or beside what
    went again, may not beside them.
    """
    names = selection.fit.names
    shown = rivals_of(step, names)
    beside = {*names} - {step.best.name}
    chosen = step
    if shown and (len(selection.steps) > 1 or beside != {*step.reference.names}):
        chosen = _beside_others(step, search, selection, shown)
    rivals = [
        row
        for ranking in (chosen, beside_unshown(step, search))
        for row in predict_as_well(rivals_of(ranking, names), ranking, search.scorer)
    ]
    return rivals[: thresholds.MAX_EXPLANATIONS - 1]


def predict_as_well(
    rivals: Sequence[RankedEffect], ranking: Ranking, scorer: HeldOutScorer
) -> list[RankedEffect]:
    """Those whose free predictions of unseen time err hardly more than those of the best.

    From one moment to the next a motor that points askew may do as well as one that is weak; over
    ten seconds it does not.
    """
    if not rivals:
        return []
    most = thresholds.MAX_RIVAL_RATIO * scorer.score_fit(ranking.best.fit).nrmse
    return [r for r in rivals if scorer.score_fit(r.fit).nrmse <= most]


def _beside_others(
    step: Ranking, search: EffectSearch, selection: Selection, rivals: list[RankedEffect]
) -> Ranking:
    """The effect of a step and rivals of it, fitted beside all other effects that were found."""
    name, others = step.best.name, {row.name for row in rivals}
    search.progress(f"whether {name} is told from {' and '.join(sorted(others))}")
    at = selection.fit.names.index(name)
    found = search.in_place_of(selection.fit, {at}, {name, *others})
    row = next((r for r in found.finalists if r.name == name), None)
    return step if row is None else found.led_by(row)


def beside_unshown(step: Ranking, search: EffectSearch) -> Ranking:
    """The best of a step among those of its look-alikes that these trials cannot show.

    Where such a one does as well, on few headings say, the best is not established.
    """
    best = step.best.effect
    alike = [e for e in search.unshown if best.looks_like_effect(e)]
    if not alike:
        return replace(step, finalists=(step.best,))
    search.progress(f"whether {best.name} is told from {', '.join(e.name for e in alike)}")
    fit = step.reference
    found = rank(search.superset, fit.model(), [best, *alike], fit, mapper=search.mapper)
    row = next((r for r in found.finalists if r.name == best.name), None)
    return replace(step, finalists=(step.best,)) if row is None else found.led_by(row)
