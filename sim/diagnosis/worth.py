"""What an effect has to be worth on held-out time: to be added, to be kept, to help."""

from collections.abc import Sequence

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit
from sim.diagnosis.heldout import Gain, HeldOutScorer
from sim.effects.effect import Effect, Scope


def is_missed(effect: Effect, g: Gain) -> bool:
    """Whether an effect is worth so much that it would be missed.

    Waves come in groups that no single frequency follows for long: they are believed even where
    one loses now and then.
    """
    enough = g.nats > thresholds.MIN_NATS_IN_FEW_BLOCKS
    return (effect.partial and enough and g.lost < thresholds.MAX_LOST_PARTIAL) or is_worth_it(g)


def is_worth_it(g: Gain) -> bool:
    """Large enough to matter, and in most blocks; or in few blocks alone, but there beyond doubt.

    What shows only when the boat brakes is told by the two or three blocks in which it does.
    """
    large = g.log_ratio > thresholds.MIN_LOG_RATIO_PER_BLOCK
    enough = g.nats > thresholds.MIN_NATS_IN_FEW_BLOCKS
    in_most, in_few = g.t > thresholds.MIN_T_OVER_BLOCKS, g.lost < thresholds.MAX_LOST
    return (large and in_most) or (enough and in_few)


def is_at_floor(noise_share: Sequence[float]) -> bool:
    """Whether no more is left in u, v, r than the recordings state as noise (`Fit.noise_share`)."""
    return max(noise_share) < thresholds.MAX_NOISE_SHARE


def share_left(before: float, after: float, floor: float) -> float:
    """Share of the squared error above the noise that is left; 0 where there was none."""
    noise = min(floor, after) ** 2
    above = before**2 - noise
    return min((after**2 - noise) / above, 1.0) if above > 0.0 else 0.0


def helps(scorer: HeldOutScorer, before: Sequence[Fit], after: Fit) -> bool:
    """Whether predictions of unseen time become noticeably better than with any of the fits before,
    and than as given; at the noise floor of the first of them more is asked.
    """
    scorer = scorer.shared_with(after)
    best = min([scorer.given, *(scorer.score_fit(fit).nrmse for fit in before)])
    at_floor = is_at_floor(before[0].noise_share) or best <= scorer.noise_floor
    ratio = thresholds.MAX_NRMSE_RATIO_AT_FLOOR if at_floor else thresholds.MAX_NRMSE_RATIO
    return scorer.score_fit(after).nrmse < ratio * best


def is_worse_elsewhere(scorer: HeldOutScorer, before: Fit, after: Fit) -> bool:
    """Whether recordings that are left out in turn are predicted noticeably worse by the later fit.

    Not known of fewer than `MIN_RECORDINGS`, nor where the two differ in effects of a day, whose
    numbers the recording that is left out has given itself.
    """
    of_a_day = [
        {a.effect.name for a in fit.added if a.effect.scope is not Scope.BOAT}
        for fit in (before, after)
    ]
    if of_a_day[0] != of_a_day[1]:
        return False
    a, b = (scorer.score_recordings(fit) for fit in (before, after))
    return a is not None and b is not None and a.nrmse < thresholds.MAX_NRMSE_RATIO * b.nrmse
