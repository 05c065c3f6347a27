"""From what was found to one of four answers, and the sentence that says it."""

from collections.abc import Sequence

import numpy as np

from sim.diagnosis.answer import Rung, Verdict
from sim.diagnosis.heldout import Gain, gain
from sim.diagnosis.ladder import Climb, worth_it
from sim.diagnosis.leftover import Dependence, dependences
from sim.diagnosis.ranking import CLEAR, Ranked, Ranking
from sim.effects.effect import Effect

NAMED = 3  # explanations of one thing, at most
TIED = 0.7  # of the best one's gain: an explanation that does nearly as well
LEFT = 25.0  # nats that a group of terms must foretell beside the best model
FORM = 0.06  # of what the effects won: an effect of the right kind leaves so much by its form
FAR_FORM = 0.02  # the same where the error stands above the noise: what leaves more is no form
GROUP = 1.0  # the same of a part: one frequency of a whole group of waves
STANDS = 1.45  # floors of noise: a complete model leaves less
FAR = 5.0  # floors of noise: an effect of the right kind leaves less, whatever its form
REST = 0.03  # … or less than this share of what the base alone left above the noise


def rivals_of(ranking: Ranking, found: Sequence[str] = ()) -> list[Ranked]:
    """Who explains unseen time as well as the best, as far as blocks of it can tell.

    What was found beside it in the end is no rival.
    """
    best = ranking.best
    if not worth_it(best.gain):
        return []
    out = []
    for row in ranking.finalists[1:]:
        better = gain(row.unseen, best.unseen, best.fit.ground.block)
        if row.effect.general_of == best.name or row.name in found:
            continue
        if row.gain.log > TIED * best.gain.log and better.t < CLEAR:
            out.append(row)
    return out[: NAMED - 1]


def verdict_of(
    climb: Climb, rivals: Sequence[Sequence[Ranked]], left: Sequence[Dependence], stands: bool
) -> Verdict:
    """One of four: what is left counts most, then whether anything was found.

    `stands`: the error that is left cannot be noise.
    """
    if left or stands:
        return Verdict.UNKNOWN
    if not climb.steps:
        return Verdict.ADEQUATE
    return Verdict.CONFOUNDED if any(rivals) else Verdict.EXPLAINED


def stands_open(effects: Sequence[Effect], rungs: Sequence[Rung], floor: float) -> bool:
    """Whether the last rung's error cannot be noise, whatever it follows or does not.

    An effect in nature's own form may leave a few floors: up to 3.5 in the blind test's right
    answers. Beside what is but a part of what nature does (one train of waves) nothing is said.
    """
    base, last = rungs[1].heldout.nrmse, rungs[-1].heldout.nrmse
    if any(e.partial for e in effects) or last <= (FAR if effects else STANDS) * floor:
        return False
    return last**2 - floor**2 > REST * (base**2 - floor**2)


def left_over(climb: Climb, above: bool) -> list[Dependence]:
    """What the last fit leaves that follows something; `above`: its error stands above the noise.

    However small: a free run of ten seconds may hardly tell what six hundred of them do.
    """
    return [d for d in dependences(climb.fit) if matters(d.gain, climb, above)]


def matters(g: Gain, climb: Climb, above: bool) -> bool:
    """Whether what is left is more than a form that nature chose a little differently."""
    won = sum(step.chosen.gain.nats for step in climb.steps)
    form = FAR_FORM if above else FORM
    if any(a.effect.partial for a in climb.fit.added):
        form = GROUP
    return worth_it(g) and g.nats > max(LEFT, form * won)


def unexplained(rungs: Sequence[Rung], floor: float) -> float:
    """Share of the squared error above the noise that the last rung leaves."""
    first, last = rungs[0].heldout.nrmse ** 2, rungs[-1].heldout.nrmse ** 2
    above = first - min(floor**2, last)
    return float(np.clip((last - min(floor**2, last)) / above, 0.0, 1.0)) if above > 0 else 0.0


def summary_of(
    verdict: Verdict,
    rungs: Sequence[Rung],
    rivals: Sequence[Sequence[Ranked]],
    left: Sequence[Dependence],
    floor: float,
) -> str:
    first, base, last = rungs[0].heldout.nrmse, rungs[1].heldout.nrmse, rungs[-1].heldout.nrmse
    names = " and ".join(rungs[-1].effects)
    fell = f"the error on unseen time falls from {first:.3f} to {last:.3f} (noise {floor:.3f})"
    if verdict is Verdict.ADEQUATE:
        return (
            "no effect of the catalogue is missing as far as these data can tell: "
            f"{first:.3f} as given, {base:.3f} with the base re-fitted (noise {floor:.3f})"
        )
    if verdict is Verdict.EXPLAINED:
        return f"{names}: {fell}"
    if verdict is Verdict.CONFOUNDED:
        others = sorted({r.name for step in rivals for r in step})
        return f"{names}: {fell}; these data cannot tell it from {' or '.join(others)}"
    known = f"{names} helps, {fell}, but " if rungs[-1].effects else ""
    follows = "what is left is no noise, and follows nothing that was looked for"
    says = left[0].says if left else follows
    return f"{known}something is missing that the catalogue does not hold: {says}"
