"""What results say, in plain words: the same in the terminal, in the report and in the studio."""

from collections.abc import Mapping

from sim.comparison.compare import Judgement, judge
from sim.diagnosis.answer import Diagnosis, LadderStep, Verdict
from sim.diagnosis.evidence import rivals
from sim.effects.effect import Effect
from sim.effects.headlines import headline


def judgement_text(error: float, floor: float) -> str:
    """How an error stands beside the noise floor, as the end of a sentence."""
    match judge(error, floor):
        case Judgement.ADEQUATE:
            return "no more than noise"
        case Judgement.WRONG:
            return f"{error / max(floor, 1e-9):.1f} times what noise alone would show"
    return f"these data cannot judge it, noise alone would show {floor:.2f}"


def nowhere_text(error: float, floor: float) -> str:
    """What is said where no range of speed, heading or throttle stands out."""
    match judge(error, floor):
        case Judgement.ADEQUATE:
            return "nowhere worse than noise"
        case Judgement.WRONG:
            return "wrong everywhere alike"
    return "these data cannot tell where: noise hides the motion"


def cause_text(step: LadderStep, effect: str, start_time_ns: int = 0) -> str:
    """What one effect of a step says, with its fitted numbers: of several recordings the first's.

    start_time_ns  UTC of the first sample, for moments by the clock; 0: not known

    "The compass reads 7.5° too far to port (6.9–8.2°)". Where all its intervals hold the numbers
    with which the effect does nothing, that is said.
    """
    added = next(a for a in step.vessel.effects if a.effect.name == effect)
    intervals: dict[str, tuple[float, float]] = {}
    for e in step.parameters.get(effect, ()):
        intervals.setdefault(e.name.rpartition(".")[2], e.ci95)
    text = headline(added.effect, added.values, intervals, start_time_ns)
    return (
        f"{text}; but these data allow that there is none"
        if _may_be_none(added.effect, intervals)
        else text
    )


def _may_be_none(effect: Effect, intervals: Mapping[str, tuple[float, float]]) -> bool:
    """Whether the effect does nothing anywhere within its intervals."""
    neutral = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
    known = {name: intervals[name] for name in neutral if name in intervals}
    return bool(known) and all(low <= neutral[n] <= high for n, (low, high) in known.items())


def diagnosis_texts(d: Diagnosis) -> tuple[str, ...]:
    """The answer in sentences, what matters first; it claims no more than the verdict does."""
    last = d.ladder[-1]
    begun = d.start_time_ns
    found = tuple(f"{cause_text(last, name, begun)}." for name in last.effects)
    if d.verdict is Verdict.ADEQUATE:
        error = min(step.heldout.nrmse for step in d.ladder)
        if judge(error, d.noise_floor) is Judgement.UNJUDGED:
            return ("These data cannot tell whether anything is missing: noise hides the motion.",)
        return ("Nothing is missing that these data could tell.",)
    if d.verdict is Verdict.UNKNOWN:
        helps = tuple(f"What helps, but not enough: {text}" for text in found)
        return ("Something is missing that the catalogue does not hold.", *helps)
    if d.verdict is Verdict.CONFOUNDED:
        return (*found, *(f"These data cannot tell that from another cause: {text}." for text in
                          (cause_text(s, s.effects[-1], begun) for s in rivals(d))))  # fmt: skip
    return found
