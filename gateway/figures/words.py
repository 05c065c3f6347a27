"""What results say, in plain words: the same in the terminal, in the report and in the studio."""

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from gateway.figures import probability_text
from sim.comparison.compare import Judgement, Standing, judge
from sim.diagnosis.answer import (
    Diagnosis,
    LadderStep,
    StepBase,
    Verdict,
    fitted_values,
    recordings_of,
)
from sim.diagnosis.evidence import rivals
from sim.effects.effect import Effect
from sim.effects.words import FittedValues
from sim.identification import BASE, MASSES
from sim.identification.intervals import Estimate
from sim.identification.light_inertia import too_light
from sim.vessel import Vessel

MAY_BE_NONE = "these data allow that there is none"
MOST_MOVED = 4  # base numbers that are told beside the verdict
LITTLE_MOVED = 0.03  # of a number: no vessel file is known to that
FARTHEST_SHARE = 9.99  # of a number, that a change is told as a percentage of it
# inertia and damping that all change by one factor: forces that changed by its inverse
MIN_ALIKE, ALIKE = 4, 1.25
YAW, SURGE = ("m33", "N_r", "N_rr"), ("m11", "X_u", "X_uu")
FAR_MOVED = 0.2  # of a number: further than that of a file that was measured


def moved_numbers(step: LadderStep) -> str:
    """Base numbers whose interval no longer holds what the file gave, the furthest first, and
    whether all changed alike; empty where none left it.
    """
    far = sorted(_beyond_interval(step), key=lambda each: -abs(each[0]))
    told = [_moved(e, share) for share, e in far[:MOST_MOVED]]
    factors = [1.0 + share for share, e in far]
    alike = len(far) >= MIN_ALIKE and min(factors) > 0.0 and max(factors) < ALIKE * min(factors)
    if alike and any(e.name in MASSES for _, e in far) and not _is_little(step):
        percent = 100.0 / float(np.median(factors))
        told.append(f"all alike, as if the motors gave {percent:.0f} % of what the file says")
    elif (share := _turned_by(step, {e.name for _, e in far})) is not None:
        told.append(f"those of yaw alike, as if what turns her gave {100.0 * share:.0f} % of the "
                    f"moment in the file{_arms(step.vessel)}")  # fmt: skip
    return ", ".join(told)


def _turned_by(step: LadderStep, moved: Collection[str]) -> float | None:
    """The share of the moment in the file that turns the boat, where inertia and damping in yaw all
    moved by one factor and those of surge hardly did; else None.
    """
    factors = {e.name: 1.0 + share for share, e in _changes(step)}
    yaw = [factors[name] for name in YAW if name in factors]
    surge = [abs(factors[name] - 1.0) for name in SURGE if name in factors]
    known = "m33" in factors and all(name in moved for name in YAW if name in factors)
    if not known or len(yaw) < 2 or min(yaw) <= 0.0 or not surge:
        return None
    alike = max(yaw) < ALIKE * min(yaw)
    far = min(abs(f - 1.0) for f in yaw) > FAR_MOVED and max(surge) < 0.5 * FAR_MOVED
    return 1.0 / float(np.median(yaw)) if alike and far else None


def _arms(vessel: Vessel) -> str:
    """A hint, where motors turn the boat by their arms."""
    return " (arms of the motors?)" if vessel.has_arms else ""


def _is_little(step: LadderStep) -> bool:
    """Whether no base number moved further than what no file is known to."""
    return max((abs(share) for share, _ in _changes(step)), default=0.0) < LITTLE_MOVED


def _beyond_interval(step: LadderStep) -> list[tuple[float, Estimate]]:
    """The changes of base numbers whose interval no longer holds what the file gave."""
    return [
        each for each in _changes(step) if not each[1].ci95[0] <= each[1].before <= each[1].ci95[1]
    ]


def _changes(step: LadderStep) -> list[tuple[float, Estimate]]:
    """By which share of what it was each base number changed, of those that were not zero."""
    known = (e for e in step.base_parameters if e.name in BASE and e.before)
    return [(e.value / e.before - 1.0, e) for e in known]


def _moved(e: Estimate, share: float) -> str:
    """One number before and after; `share` of what it was that it changed by.

    From next to nothing every change is millions of percent.
    """
    percent = f" ({100.0 * share:+.0f} %)" if abs(share) < FARTHEST_SHARE else ""
    return f"{e.name} {e.before:.4g} → {e.value:.4g} {e.unit}{percent}"


def base_text(d: Diagnosis) -> str:
    """What became of the base numbers: alone, and in the vessel that is handed over."""
    numbers = moved_numbers(d.ladder[-1])
    if d.base_changed and _is_little(d.ladder[-1]):
        few = f"by less than {100.0 * LITTLE_MOVED:.0f} % each"
        return f"re-fitted, its numbers moved {few}{f': {numbers}' if numbers else ''}"
    if d.effects and numbers:
        return f"fitted along with what was found, its numbers moved: {numbers}"
    if d.effects:
        return "its numbers hold as they were given"
    if d.base_changed and d.base_may_hold:
        return f"its numbers may hold as they were given; others do a little better: {numbers}"
    if d.base_changed:
        return f"re-fitted, its numbers had to move{f': {numbers}' if numbers else ''}"
    if d.ladder[1].base is StepBase.REFITTED:
        return "its numbers stay as they were given: what a re-fit gains may be noise"
    return "its numbers hold as they were given"


RUNS_AWAY = (
    "this vessel runs away from every start, as the boat did not: check its numbers, or compare "
    "over a shorter --horizon"
)


def judgement_text(standing: Standing) -> str:
    """How an error stands beside the noise floor, as the end of a sentence."""
    match standing.judgement:
        case Judgement.ADEQUATE:
            return "no more than noise"
        case Judgement.WRONG:
            if standing.by_channel:
                return louder_text(standing.louder)
            times = standing.error / max(standing.floor, 1e-9)
            return f"{times:.1f} times what noise alone would show"
    if standing.runs_away:
        return f"it cannot be judged: {RUNS_AWAY}"
    return f"these data cannot judge it, noise alone would show {standing.floor:.2f}"


def louder_text(louder: Mapping[str, float]) -> str:
    """Channels that err more than noise where all together do not."""
    each = " and ".join(f"{times:.1f} times in {name}" for name, times in louder.items())
    return f"{each} what noise alone would show"


def nowhere_text(standing: Standing) -> str:
    """What is said where no range of speed, heading or throttle stands out."""
    match standing.judgement:
        case Judgement.ADEQUATE:
            return "nowhere worse than noise"
        case Judgement.WRONG:
            return "wrong everywhere alike"
    if standing.runs_away:
        return RUNS_AWAY
    return "these data cannot tell where: noise hides the motion"


def headline(
    effect: Effect, values: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]] | None = None, start_time_ns: int = 0,
) -> str:  # fmt: skip
    """What an effect with its fitted numbers says: its own words, else what it looks like.

    start_time_ns  UTC of the first sample, for moments by the clock; 0: not known

    A sentence without a full stop; it begins with a capital letter.
    """
    if effect.in_words is not None:
        text = effect.in_words(FittedValues(values, ci95 or {}, start_time_ns))
    else:
        text = f"{effect.name.replace('_', ' ')}: {effect.looks_like}"
    return text[0].upper() + text[1:]


def cause_text(step: LadderStep, effect: str, start_time_ns: int = 0) -> str:
    """What one effect of a step says, with its fitted numbers: on each recording, where these
    differ.

    start_time_ns  UTC of the first sample, for moments by the clock; 0: not known

    "The compass reads 7.5° too far to port (6.9–8.2°)". Where all its intervals hold the numbers
    with which the effect does nothing, that is said.
    """
    added = next(a.effect for a in step.vessel.effects if a.effect.name == effect)
    recordings = recordings_of(step, effect)
    if len(recordings) < 2:
        found = fitted_values(step, effect, start_time_ns)
        text = _says(added, found)
        return f"{text}; but {MAY_BE_NONE}" if _may_be_none(added, found.ci95) else text
    told, silent = [], []
    for name in recordings:
        found = fitted_values(step, effect, recording=name)
        if _may_be_none(added, found.ci95):
            silent.append(name)
        else:
            text = _says(added, found)
            told.append(f"{name}: {text[0].lower()}{text[1:]}")
    if silent:
        told.append(f"on {' and '.join(silent)} {MAY_BE_NONE}")
    return "; ".join([f"{said(effect).capitalize()}, recording by recording", *told])


def _says(effect: Effect, found: FittedValues) -> str:
    return headline(effect, found.values, found.ci95, found.start_time_ns)


def _may_be_none(effect: Effect, intervals: Mapping[str, tuple[float, float]]) -> bool:
    """Whether the effect does nothing anywhere within its intervals: a magnitude at zero, or all
    numbers where they do nothing.
    """
    neutral = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
    neutral |= {p.name: 0.0 for p in effect.parameters if p.direction and p.lower == 0.0}
    known = {name: intervals[name] for name in neutral if name in intervals}
    return bool(known) and all(low <= neutral[n] <= high for n, (low, high) in known.items())


def why_not_texts(
    d: Diagnosis, tried: Iterable[str], contradicted: Collection[str] = ()
) -> dict[str, str]:
    """Each effect that was tried and not chosen -> why not, in a sentence.

    contradicted   effects whose own curve points away from what is missing
    """
    tied = {step.effects[-1] for step in rivals(d)}
    chance = {row.effect: row.probability for row in d.told_ranking}
    shown = {True: "It would help here, and is not believed", False: "These data cannot show it"}
    out = {each.effect: f"{shown[each.doubted]}: {each.reason}." for each in d.refused}
    for step in d.alternatives:
        name = step.effects[-1]
        if name not in d.effects and name not in d.best.effects and name not in out:
            text = _why_not(d, step, name in tied, name in contradicted)
            if name in chance and d.effects and chance[d.effects[0]] > chance[name]:
                best, own = probability_text(chance[d.effects[0]]), probability_text(chance[name])
                text += f" Alone, {said(d.effects[0])} is {best} probable, this one {own}."
            out[name] = text
    known = {*out, *d.effects, *(row.effect for row in d.ranking)}
    promised = "Not among the most promising in the first look at all effects: it was not fitted."
    return out | {name: promised for name in tried if name not in known}


def _why_not(d: Diagnosis, step: LadderStep, tied: bool, contradicted: bool) -> str:
    """Of one step that was fitted and not chosen: its error beside that without it, and beyond."""
    beside, error = step.effects[:-1], step.heldout.nrmse
    before = next((s for s in d.ladder[1:] if s.effects == beside), d.ladder[1])
    chosen = next((s for s in d.ladder[2:] if len(s.effects) > len(before.effects)), None)
    there = f" beside {' and '.join(map(said, beside))}" if beside else ""
    first = (
        f"With it{there} the error on unseen time is {error:.3f}, without it "
        f"{before.heldout.nrmse:.3f}"
    )
    if contradicted:
        return f"{first}, and its own curve points away from what is missing."
    if chosen is None:
        return f"{first}: not enough to be sure of it." if error < before.heldout.nrmse else (
            f"{first}: it predicts no better."
        )  # fmt: skip
    more = " and ".join(map(said, chosen.effects[len(before.effects) :]))
    if error >= before.heldout.nrmse:
        return f"{first}: it predicts no better; with {more} it is {chosen.heldout.nrmse:.3f}."
    if tied:
        return f"{first}, with {more} {chosen.heldout.nrmse:.3f}: these data cannot tell the two."
    return f"{first}, with {more} {chosen.heldout.nrmse:.3f}."


def said(effect: str) -> str:
    """The name of an effect as it stands in a sentence."""
    return effect.replace("_", " ")


def diagnosis_texts(d: Diagnosis) -> tuple[str, ...]:
    """The answer in sentences, what matters first; it claims no more than the verdict does."""
    last = d.ladder[-1]
    light = too_light(last.base_parameters, last.vessel)
    return (*_answer_texts(d), *(f"{text}." for text in light))


def _what_helps_texts(d: Diagnosis, found: Sequence[str]) -> tuple[str, ...]:
    """Of an answer that nothing in the catalogue is: the curve that it looks like first, and what
    `found` says of the effects that help, or only come near to that curve. Of what may be none
    nothing is said.
    """
    sure = [text for text in found if not text.endswith(f"{MAY_BE_NONE}.")]
    if d.curve is None:
        return tuple(f"What helps, but not enough: {text}" for text in sure)
    curve = cause_text(d.curve, d.curve.effects[-1], d.start_time_ns)
    curve = curve.replace(f"but {MAY_BE_NONE}", "how much of it these data do not tell")
    looks = f"It looks like {curve[0].lower()}{curve[1:]}."
    if not d.curve_stands_alone:
        return (looks, *(f"What helps beside it: {text}" for text in sure))
    nearest = ", ".join(map(said, d.effects))
    return (looks, f"Nearest to it in the catalogue, but not it: {nearest}.")


def _answer_texts(d: Diagnosis) -> tuple[str, ...]:
    """What was found, and what is missing."""
    last = d.ladder[-1]
    begun = d.start_time_ns
    causes = [cause_text(last, name, begun) for name in last.effects]
    causes.sort(key=lambda text: text.endswith(f"but {MAY_BE_NONE}"))  # the sure ones first
    found = tuple(f"{text}." for text in causes)
    if d.verdict is Verdict.ADEQUATE:
        error = min(step.heldout.nrmse for step in d.ladder)
        if judge(error, d.noise_floor) is Judgement.UNJUDGED:
            return ("These data cannot tell whether anything is missing: noise hides the motion.",)
        far = max((abs(share) for share, _ in _beyond_interval(last)), default=0.0)
        if d.base_changed and far > FAR_MOVED:
            if d.base_may_hold:
                return ("Nothing is missing that these data could tell.",
                        "Other numbers than the vessel file's predict a little better "
                        f"({moved_numbers(last)}); errors of the measured velocities that last may "
                        "do that too.")  # fmt: skip
            return (f"Numbers of the vessel file are off: {moved_numbers(last)}.",
                    "Nothing else is missing that these data could tell.")  # fmt: skip
        return ("Nothing is missing that these data could tell.",)
    if d.verdict is Verdict.UNKNOWN:
        missing = "Something is missing that the catalogue does not hold."
        return (missing, *_what_helps_texts(d, found))
    if d.verdict is Verdict.CONFOUNDED:
        return (*found, *(f"These data cannot tell that from another cause: {text}." for text in
                          (cause_text(s, s.effects[-1], begun) for s in rivals(d))))  # fmt: skip
    return found
