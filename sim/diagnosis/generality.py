"""Whether an effect that was found is true of the boat, or of these recordings only.

    on recordings   each left out in turn: squared errors there, without and with the effect
    its numbers     none that no boat has, or that a good sensor is off by anyway
    its moment      something is seen on both sides of it
    on headings     nats won on unseen time by the sector of the heading that they were won in

Blocks of one recording share its day. A compass that is turned, iron on board, a current and a hull
that is not alike on both sides push the boat to the same side as long as it sails one way: what is
true of the boat has to win on opposite headings too.
"""

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.feedback import NOT_BEFORE_MOTION, acts_before_motion
from sim.diagnosis.fit import Fit
from sim.diagnosis.heldout import HeldOutScorer, RankedEffect, gain_on_recordings, nats_won
from sim.diagnosis.limits import sameness_of, smallness_of, strain_of
from sim.diagnosis.screening_steps import moment_of
from sim.effects.effect import Scope, Shown
from sim.state import Eta, Floats

WIDTH_DEG = 360 // thresholds.HEADING_SECTORS
OF_HEADING = {Shown.OPPOSITE, Shown.CIRCLES}


def doubt_of(row: RankedEffect, reference: Fit, scorer: HeldOutScorer) -> str:
    """Why a ranked effect is not believed of the boat, in words; empty where it is.

    `reference` is that of its ranking. What is of a day is learnt on each day anew.
    """
    doubt = doubt_of_numbers(row)
    if doubt:
        return doubt
    if row.effect.scope is not Scope.BOAT:
        return ""
    if not _wins_on_recordings(row, reference, scorer):
        return "it wins nothing on recordings that the fit did not see: it is not alike on all"
    seen = _sectors_where_it_counts(row, reference)
    if seen is not None and not _opposite(seen):
        return f"it was seen on headings from {in_words(seen)} alone: sail opposite headings"
    if Shown.COMMANDS in row.effect.shown_by and not acts_before_motion(reference, row.fit):
        return NOT_BEFORE_MOTION
    return ""


def doubt_of_numbers(row: RankedEffect) -> str:
    """Why what was fitted to a ranked effect is nothing that would be told, as a rival neither."""
    strain = strain_of(row.found, row.fit.problem.vessel)
    if strain:
        return f"{strain}: it stands in for something else"
    if row.effect.disbelieved is not None:
        why = row.effect.disbelieved(row.found.values, row.fit.problem.trials)
        if why:
            return f"{why}: it stands in for something else"
    if row.effect.undone is not None:
        given, fitted = row.fit.problem.vessel.dynamics, row.fit.vessel().dynamics
        why = row.effect.undone(row.found.values, given, fitted)
        if why:
            return why
    small = smallness_of(row.found) or sameness_of(row.found)
    if small or _shows_both_sides(row):
        return small
    return "nothing was seen on one side of its moment: a change is not told"


def _shows_both_sides(row: RankedEffect) -> bool:
    """Whether the recordings reach far enough to both sides of the moment of an event: a motor that
    has been weak from the first second on has not failed while she sailed.
    """
    moment = moment_of(row.effect)
    if moment is None:
        return True
    at, last = row.found.values[moment], max(float(t.time[-1]) for t in row.fit.problem.trials)
    return min(at, last - at) >= thresholds.MIN_BESIDE_A_MOMENT_S


def unseen_headings(row: RankedEffect, reference: Fit) -> str:
    """On which headings an effect was seen, in words, where they are few; else empty."""
    seen = _sectors_where_it_counts(row, reference)
    if seen is None or len(seen) >= thresholds.MIN_SECTORS_FOR_CIRCLES:
        return ""
    return f"{row.name} was seen on headings from {in_words(seen)} alone"


def _sectors_where_it_counts(row: RankedEffect, reference: Fit) -> list[int] | None:
    """`seen_sectors` of what is of the boat and shown by headings; None of all else."""
    if row.effect.scope is not Scope.BOAT or not OF_HEADING & set(row.effect.shown_by):
        return None
    return seen_sectors(row, reference)


def seen_sectors(row: RankedEffect, reference: Fit) -> list[int]:
    """Numbers of the sectors, from north, that a noticeable share of the gain was won in."""
    before, after = reference.heldout_residual, row.fit.heldout_residual
    sector = (_headings(row.fit) % (2.0 * np.pi) // np.radians(WIDTH_DEG)).astype(np.int64)
    won = np.bincount(sector, nats_won(before, after), thresholds.HEADING_SECTORS)
    least = thresholds.MIN_SEEN_SECTOR_SHARE * np.maximum(won, 0.0).sum()
    return [int(i) for i in np.flatnonzero(won > least)]


def in_words(sectors: list[int]) -> str:
    """Sectors as ranges of degrees, neighbours as one; not all of them."""
    count, parts = thresholds.HEADING_SECTORS, []
    for begin in (i for i in sectors if (i - 1) % count not in sectors):
        width = next(n for n in range(1, count) if (begin + n) % count not in sectors)
        parts.append(f"{WIDTH_DEG * begin}° to {WIDTH_DEG * (begin + width) % 360}°")
    return " and ".join(parts)


def _wins_on_recordings(row: RankedEffect, reference: Fit, scorer: HeldOutScorer) -> bool:
    """Of fewer than `MIN_RECORDINGS` nothing is known, and nothing held against it."""
    g = gain_on_recordings(reference, row.fit)
    if g is None:
        return True
    before, after = scorer.score_recordings(reference), scorer.score_recordings(row.fit)
    falls = before is None or after is None or after.nrmse < before.nrmse
    return falls and g.nats > thresholds.MIN_NATS_ON_RECORDINGS


def _opposite(sectors: list[int]) -> bool:
    """Whether two of them lie far enough apart."""
    count = thresholds.HEADING_SECTORS
    apart = [min((a - b) % count, (b - a) % count) for a in sectors for b in sectors]
    return max(apart, default=0) >= thresholds.MIN_SECTORS_APART


def _headings(fit: Fit) -> Floats:
    """Heading [rad] at the begin of the run of each residual (N,)."""
    places = fit.problem.places
    out = np.empty(len(places.begin))
    for i, trial in enumerate(fit.problem.trials):
        mine = places.trial == i
        at = np.searchsorted(trial.time, places.begin[mine]).clip(max=len(trial.time) - 1)
        out[mine] = trial.eta[at, Eta.YAW]
    return out
