"""From what was found to one of four answers, and the sentence that gives it."""

from collections.abc import Sequence

from sim.comparison.compare import Judgement, judge
from sim.diagnosis import thresholds
from sim.diagnosis.answer import LadderStep, StepBase, Verdict
from sim.diagnosis.free_curve import FreeCurve
from sim.diagnosis.generality import doubt_of_numbers
from sim.diagnosis.heldout import Gain, HeldOutScore, RankedEffect, Ranking
from sim.diagnosis.ladder import Selection
from sim.diagnosis.residual_terms import Dependence, dependences, without_repeats
from sim.diagnosis.worth import is_worth_it, share_left
from sim.effects.effect import Effect

TIME = "time"  # of `force_terms.GROUPS`


def rivals_of(ranking: Ranking, found: Sequence[str] = ()) -> list[RankedEffect]:
    """Effects that explain held-out time as well as the best, as far as blocks of it can tell.

    What was found beside it in the end is no rival, nor what has numbers that would not be told.
    """
    if not ranking.finalists or not is_worth_it(ranking.best.gain):
        return []
    best, out = ranking.best, []
    for row in ranking.finalists[1:]:
        better = best.gain_over(row)
        if row.effect.general_of == best.name or row.name in found:
            continue
        if doubt_of_numbers(row):
            continue
        close = row.gain.log_ratio > thresholds.MIN_SHARE_OF_BEST * best.gain.log_ratio
        if close and better.t < thresholds.MIN_T_BETTER:
            out.append(row)
    return out[: thresholds.MAX_EXPLANATIONS - 1]


DRIFT = (
    "; in free runs more is left than noise that comes anew at each moment{}: so do errors of the "
    "measured velocities that last, gusts, and weak causes"
)
FOLLOWS_NOTHING = ", and it follows nothing that was looked for"


def verdict_of(
    selection: Selection, rivals: Sequence[Sequence[RankedEffect]], left: Sequence[Dependence],
    above_noise: bool,
) -> Verdict:  # fmt: skip
    """One of four: what is left counts most, then whether anything was found.

    `above_noise`: the error that is left cannot be noise, or sensors contradict one another.
    """
    if left or above_noise:
        return Verdict.UNKNOWN
    if not selection.steps:
        return Verdict.ADEQUATE
    return Verdict.CONFOUNDED if any(rivals) else Verdict.EXPLAINED


def is_above_noise(
    effects: Sequence[Effect], ladder: Sequence[LadderStep], floor: float, share: Sequence[float]
) -> bool:
    """Whether the last step's error cannot be noise, whatever it depends on.

    `share`: of u, v, r, `Diagnosis.noise_share`. Errors of the measured velocities that last for
    seconds lead a free run astray, and are no more than is stated from one moment to the next.

    An effect in nature's own form may leave a few floors, but not much of what it was to explain.
    Beside what is but a part of nature (a train of waves) the error tells little, for the rest of
    the sea is left; but what leaves the most of it explains nothing.
    """
    last = ladder[-1].heldout.nrmse
    if last <= thresholds.MAX_FLOORS * floor:
        return False
    if any(e.partial for e in effects):
        return _is_more_than(thresholds.MAX_SHARE_LEFT_BY_PART, last, floor, ladder, floor)
    if not effects and is_as_stated(share) and _may_drift(ladder[-1].heldout, floor):
        return False
    most = _share_of_form(effects)
    if effects and last <= thresholds.MAX_FLOORS_WITH_EFFECTS * floor:
        most = max(most, thresholds.MAX_SHARE_LEFT)
    return _is_more_than(most, last, floor, ladder, floor)


def _may_drift(error: HeldOutScore, floor: float) -> bool:
    """Whether an error of free runs is so small, or lies in so few blocks of time, that
    errors of the measured velocities that last may be all that it is: a boat that is unstable on
    course may turn the other way than a free run does, and once is enough.
    """
    low = error.nrmse if error.ci95 is None else error.ci95[0]
    once = low <= thresholds.MAX_FLOORS * floor
    most = thresholds.MAX_FLOORS_OF_A_TURN if once else thresholds.MAX_FLOORS_OF_DRIFT
    return error.nrmse <= most * floor


def is_as_stated(share: Sequence[float]) -> bool:
    """Whether what is left from moment to moment may be the noise that the recordings state, and
    errors of the measured velocities that last.
    """
    *along, turn = share
    return (
        max(along) < thresholds.MAX_NOISE_SHARE_ALONE and turn < thresholds.MAX_NOISE_SHARE_OF_TURN
    )


def does_without_effects(
    curve: FreeCurve, selection: Selection, ladder: Sequence[LadderStep], floor: float,
    above_noise: bool,
) -> bool:  # fmt: skip
    """Whether a curve alone predicts clearly better than all effects of the last step.

    In free runs, where these show more than noise (`floor`), or from one moment to the next by more
    than their form leaves. In a sea the latter: commands answer it, and over ten seconds a curve of
    commands tells what the sea did.
    """
    if not curve.replaces:
        return False
    last = ladder[-1].heldout.nrmse
    most = thresholds.MAX_IN_PLACE_RATIO * last
    in_a_sea = selection.fit.problem.is_coloured
    if selection.fits and not in_a_sea and last > floor and curve.step.heldout.nrmse < most:
        return True
    if curve.over is None or curve.over.log_ratio < thresholds.MIN_LOG_RATIO_IN_PLACE:
        return False
    return is_more_than_form(curve.over, selection, above_noise)


def is_curve_above_form(
    curve: FreeCurve, effects: Sequence[Effect], ladder: Sequence[LadderStep], floor: float
) -> bool:
    """Whether a curve beside effects takes away more error than nature's own form leaves."""
    last, after = ladder[-1].heldout.nrmse, curve.step.heldout.nrmse
    return _is_more_than(_share_of_form(effects), last, after, ladder, floor)


def _is_more_than(
    share: float, error: float, after: float, ladder: Sequence[LadderStep], floor: float
) -> bool:
    """Whether the squared error between two is more than a share of what the base alone left above
    the noise; of the whole motion (1) at most: free runs of a hull that is unstable on course may
    err by ten times that, and a share of it would be as much as there is to explain.
    """
    base = min(ladder[1].heldout.nrmse, 1.0)
    return error**2 - after**2 > share * (base**2 - floor**2)


def _share_of_form(effects: Sequence[Effect]) -> float:
    """The share of the base's error that nature's own form may leave."""
    return max([thresholds.MIN_SHARE_OF_BASE_ERROR, *(e.unsteady for e in effects)])


def is_above_stated(effects: Sequence[Effect], share: Sequence[float]) -> bool:
    """Whether surge and sway are left with more than the recordings state as noise can be.

    `share`: of u, v, r, `Diagnosis.noise_share`. The yaw rate tells nothing here: gusts shake it.
    """
    if any(e.partial for e in effects):
        return False
    most = thresholds.MAX_NOISE_SHARE_WITH_EFFECTS if effects else thresholds.MAX_NOISE_SHARE_ALONE
    return max(share[:2]) > most


def remaining_dependences(selection: Selection, above_noise: bool) -> list[Dependence]:
    """What the last fit leaves that depends on something; `above_noise`: by more than one floor.

    However small: a free run of ten seconds may hardly tell what six hundred of them do.
    """
    return without_repeats(
        [
            d
            for d in dependences(selection.fit)
            if is_more_than_form(d.gain, selection, above_noise, of_time=d.on == TIME)
        ]
    )


def is_more_than_form(
    g: Gain, selection: Selection, above_noise: bool, *, of_time: bool = False
) -> bool:
    """Whether what is left is more than a form that nature chose a little differently.

    `of_time`: it depends on the time, as gusts do that a steady wind leaves.
    """
    won = sum(step.best.gain.nats for step in selection.steps)
    share = thresholds.MAX_FORM_SHARE_ABOVE_NOISE if above_noise else thresholds.MAX_FORM_SHARE
    if any(a.effect.partial for a in selection.fit.added):
        share = thresholds.MAX_FORM_SHARE_PARTIAL
    if of_time:
        share = max([share, *(a.effect.unsteady for a in selection.fit.added)])
    return is_worth_it(g) and g.nats > max(thresholds.MIN_RESIDUAL_NATS, share * won)


def seen_one_step_ahead(selection: Selection) -> RankedEffect | None:
    """The first of the ranking where nothing was added, but from one moment to the next it is worth
    what a curve has to be; no free run shows it.
    """
    first = next(iter(selection.first.finalists), None)
    if first is None or selection.steps or not is_worth_it(first.gain):
        return None
    return first if first.gain.log_ratio >= thresholds.MIN_LOG_RATIO_IN_PLACE else None


def unexplained_share(ladder: Sequence[LadderStep], floor: float) -> float:
    """Share of the squared error above the noise that the last step leaves."""
    return share_left(ladder[0].heldout.nrmse, ladder[-1].heldout.nrmse, floor)


def summary_of(
    verdict: Verdict, ladder: Sequence[LadderStep], rivals: Sequence[Sequence[RankedEffect]],
    left: Sequence[Dependence], floor: float, curve: FreeCurve | None = None,
    period: float | None = None, contradictions: Sequence[str] = (), strained: Sequence[str] = (),
    small: RankedEffect | None = None, drifts: bool = False,
) -> str:  # fmt: skip
    """The answer in one sentence; `period` [s]: that of what is left, where it swings.

    `contradictions`: of sensors; what a model of the boat leaves may be theirs. `strained`: numbers
    of what was found that no boat has. `small`: an effect that was not added, though it is seen.
    `drifts`: over seconds more is left than noise, from moment to moment no more than is stated.
    """
    first, base, last = (ladder[i].heldout.nrmse for i in (0, 1, -1))
    names = " and ".join(ladder[-1].effects)
    fell = f"{_changed(first, last)} (noise {floor:.3f}){_on_others(ladder)}"
    if verdict is Verdict.ADEQUATE:
        refit = f"{base:.3f} with the base re-fitted"
        if ladder[1].base is StepBase.KEPT:
            refit = "no better with the base re-fitted"
        numbers = f"{first:.3f} as given, {refit} (noise {floor:.3f})"
        if drifts:
            numbers += DRIFT.format("" if small is not None else FOLLOWS_NOTHING)
        seen = ""
        if small is not None:
            seen = f"; only from one moment to the next is {small.name} seen, with "
            seen += f"{_percent_less(small.gain)} % less of the squared error"
        if judge(min(first, base), floor) is Judgement.UNJUDGED:
            hidden = "these data cannot tell whether anything is missing, noise hides it"
            return f"{hidden}: {numbers}{seen}"
        whole = "no effect of the catalogue is missing as far as these data can tell"
        if seen:
            whole = "no prediction needs another effect of the catalogue"
        return f"{whole}: {numbers}{seen}"
    if verdict is not Verdict.UNKNOWN:
        noisy = ""
        if last > thresholds.MAX_FLOORS * floor:
            noisy = (
                f"; {last / floor:.1f} times the noise is left, and weaker causes may hide in it"
            )
        others = sorted({r.name for step in rivals for r in step})
        rest = f"; these data cannot tell it from {' or '.join(others)}" if others else ""
        return f"{names}: {fell}{noisy}{rest}"
    one = "s" if len(ladder[-1].effects) == 1 else ""
    known = f"{names} help{one}, {fell}, but " if names else ""
    contradict = ""
    if contradictions:
        contradict = (f"the sensors contradict one another ({'; '.join(contradictions)}): that "
                      "comes before any effect")  # fmt: skip
    if curve is not None:
        without = first if curve.replaces else last  # beside effects, what it adds to them
        below = f"{_changed(without, curve.step.heldout.nrmse)} (noise {floor:.3f})"
        nearest = f"; nearest to it come{one} {names}, {fell}" if names and curve.replaces else ""
        if curve.over is not None and (less := _percent_less(curve.over)) > 0:
            below += f"; from one moment to the next it leaves {less} % less of the squared error"
            below += f" than {_against(curve.against, ladder[-1].effects)}"
        if curve.as_well:
            kinds = " or ".join(effect.looks_like for effect in curve.as_well)
            below += f"; as well does a curve that {kinds}"
        if curve.formula is not None:
            below += f"; as well does {curve.formula.formula.text} ({curve.formula.nrmse:.3f})"
        told = curve.description
        if contradict:
            told = f"{contradict}; as an error of a sensor: {told}"
        return (
            f"{'' if nearest else known}something is missing that the catalogue does not hold: "
            f"{told}; with that curve {below}{nearest}"
        )
    rest = "what is left is no noise, and follows nothing that was looked for"
    if contradict:
        rest = contradict
    elif strained:
        rest = f"{' and '.join(strained)}, so {names} must stand for something else"
    elif left:
        rest = left[0].description
    elif period is not None:
        rest = (f"what is left swings with a period of some {period:.1f} s, as in a sea, or under "
                "a controller that hunts")  # fmt: skip
    return f"{known}something is missing that the catalogue does not hold: {rest}"


def _against(names: Sequence[str], told: Sequence[str]) -> str:
    """What a curve was held against: what was found, or else the best of the ranking."""
    best = "" if set(names) <= set(told) else ", the first of the ranking"
    return f"{' and '.join(names)}{best}" if names else "the boat without it"


def _percent_less(g: Gain) -> int:
    """By how much the squared error is smaller."""
    return round(100.0 * (1.0 - 1.0 / g.ratio))


def _on_others(ladder: Sequence[LadderStep]) -> str:
    """Where recordings that were left out are predicted no better than as given, that; else ""."""
    given, last = ladder[0].left_out, ladder[-1].left_out
    if given is None or last is None or last.nrmse < given.nrmse:
        return ""
    numbers = f"{given.nrmse:.3f} as given, {last.nrmse:.3f} so"
    return f", but not that on recordings which the fit did not see: {numbers}"


def _changed(first: float, last: float) -> str:
    """From where to where the error on unseen time goes, as it is printed."""
    a, b = f"{first:.3f}", f"{last:.3f}"
    if a == b:
        return f"the error on unseen time stays at {a}"
    return f"the error on unseen time {'falls' if last < first else 'rises'} from {a} to {b}"
