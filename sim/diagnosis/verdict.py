"""From what was found to one of four answers, and the sentence that says it.

Fits as rungs of a ladder and rows of a ranking: with errors on unseen time and intervals.

The numbers of a fit with their intervals, and the vessel that they make.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sim.diagnosis.answer import Candidate, LadderStep, Verdict
from sim.diagnosis.fit import Fit, interval
from sim.diagnosis.heldout import Gain, HeldOutScorer, gain
from sim.diagnosis.ladder import Climb, worth_it
from sim.diagnosis.ranking import CLEAR, Ranked, Ranking
from sim.diagnosis.residual_terms import Dependence, dependences
from sim.effects.effect import Effect, Kind
from sim.identification.intervals import NUISANCE, Estimate, estimates_of, uncertainty_of
from sim.identification.shooting import FitResult
from sim.identification.vessel_update import updated_vessel
from sim.model import Model
from sim.vessel import Vessel

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


def stands_open(effects: Sequence[Effect], rungs: Sequence[LadderStep], floor: float) -> bool:
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


def unexplained(rungs: Sequence[LadderStep], floor: float) -> float:
    """Share of the squared error above the noise that the last rung leaves."""
    first, last = rungs[0].heldout.nrmse ** 2, rungs[-1].heldout.nrmse ** 2
    above = first - min(floor**2, last)
    return float(np.clip((last - min(floor**2, last)) / above, 0.0, 1.0)) if above > 0 else 0.0


def summary_of(
    verdict: Verdict,
    rungs: Sequence[LadderStep],
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


def ladder(climb: Climb, plain: Model, judge: HeldOutScorer) -> tuple[LadderStep, ...]:
    """Plain, re-fitted, and a rung for each effect that was added."""
    names = [trial.name for trial in judge.trials]
    rungs = [
        LadderStep((), "plain", judge.plain(plain), (), {}, plain.vessel),
        _rung(climb.base, judge, names),
    ]
    return (*rungs, *(_rung(fit, judge, names) for fit in climb.fits))


def rungs_of(rows: Sequence[Ranked], judge: HeldOutScorer) -> list[LadderStep]:
    """What was ranked, each with its own fit."""
    names = [trial.name for trial in judge.trials]
    return [_rung(row.fit, judge, names) for row in rows]


def later_rivals(
    climb: Climb, rivals: Sequence[Sequence[Ranked]], judge: HeldOutScorer
) -> list[LadderStep]:
    """The rivals of steps that were not chosen from the first ranking."""
    steps = zip(climb.steps, rivals, strict=True)
    return rungs_of([r for s, of in steps if s.ranking is not climb.first for r in of], judge)


def candidates_of(
    ranking: Ranking, alone: Sequence[LadderStep], found: Sequence[str]
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


def _rung(fit: Fit, judge: HeldOutScorer, names: Sequence[str]) -> LadderStep:
    base, of_effects = estimates_in(fit, names)
    return LadderStep(
        fit.names, "refitted", judge.fitted(fit), base, of_effects, vessel_of(fit)
    )  # fmt: skip


def _alike(ranking: Ranking, row: Ranked) -> float:
    """Correlation of what an effect explains on unseen time with what the best one explains."""
    one, other = (ranking.unseen - r.unseen for r in (row, ranking.best))
    size = float(np.sqrt(np.sum(one**2) * np.sum(other**2)))
    return float(np.sum(one * other)) / size if size > 0.0 else 0.0


def estimates_in(
    fit: Fit, trials: Sequence[str]
) -> tuple[tuple[Estimate, ...], Mapping[str, tuple[Estimate, ...]]]:
    """Base numbers, and those of each effect; a choice has no interval."""
    ground = fit.ground
    shot = FitResult(
        fit.z, fit.residual, fit.slope, fit.weight, ground.begin, ground.voyage, ground.noise,
        ground.voyages,
    )  # fmt: skip
    spread = uncertainty_of(fit.unknowns, shot, ground.settings.block)
    every = estimates_of(fit.unknowns, fit.z, spread, trials)
    base = tuple(e for e in every if "." not in e.name and e.name not in NUISANCE)
    of = {name: tuple(e for e in every if e.name.startswith(f"{name}.")) for name in fit.names}
    for name in fit.names:
        of[name] = (*of[name], *_held(fit, name, {e.name for e in of[name]}))
    return base, of


def _held(fit: Fit, effect: str, there: set[str]) -> list[Estimate]:
    """Numbers that have no slope: moments of events, and what was chosen among some."""
    known = {p.name: p for a in fit.added if a.effect.name == effect for p in a.effect.parameters}
    out = []
    for key, value in fit.values(effect).items():
        name = f"{effect}.{key}"
        if name not in there:
            event = known[key].kind is Kind.MOMENT
            ends = interval(fit, name) if event else (value, value)
            out.append(Estimate(name, known[key].unit, value, value, ends, True))
    return out


def vessel_of(fit: Fit, trial: int = 0) -> Vessel:
    """The vessel with the effects and numbers of a fit, as on one trial."""
    theta, model = fit.unknowns.theta(fit.z[None], trial)[0], fit.unknowns.model
    vessel = fit.ground.vessel
    own = {u.name for u in fit.unknowns.each if u.name in model.names}
    own -= {f"{a.effect.name}.{key}" for a in fit.added for key in a.values}
    changed = {name: float(theta[model.names.index(name)]) for name in own}
    return updated_vessel(vessel, changed).with_effects(*fit.found(trial))
