"""Samples that a table repeats until the next one (zero-order hold), put back to their own times.

A receiver of 5 Hz on a grid of 10 Hz shows each fix twice; taken as it stands the boat rests every
other row. Sometimes a row slips: a fix then shows once or three times although the receiver kept
its period (the distance from fix to fix shows it). So the period is followed, row by row:

    T_k = n_k p + median (t − n p) over the fixes around    n_k periods p since the first fix

A row that slips does not move the fix: most of those around it hold the phase. Where a value
repeats because the boat stands still, the periods between count as fixes of the same place; where
it jumps afterwards, the source was silent.

Repair of a table: the sources to use, and a sentence for each thing that was wrong.

Held values go back to their own times; rates that were smoothed towards both sides give way to the
positions and headings that they were made from; accelerations are compared and never used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from gateway.estimation import FilterSettings, WhiteNoise
from gateway.ingest.agreement import rate_agreement
from gateway.ingest.log import BoatSamples
from gateway.ingest.plain_mistakes import plain_mistakes
from gateway.ingest.sources import (
    NOT_SMOOTHED,
    Choice,
    Smoothing,
    acceleration_agreement,
    acceleration_std,
    estimated_white_std,
    intervals,
    rate_hz,
    smoothing,
)
from gateway.ingest.stretches import metres, over_ground
from gateway.samples import Quantity, Samples
from sim.state import Floats, Ints

# Chosen for receivers of 1 to 10 Hz on tables of 10 to 50 Hz; tests with held, slipping and
# resting fixes hold them (tests/gateway/ingest/test_traps.py).
FEWEST = 20  # changes of the value: fewer do not show a period
ONE_ROW = 0.3  # share of changes that come after a single row: above it nothing is held
SLIP = 0.25  # of a period, by which a fix may be early
AROUND = 51  # fixes that one phase is taken from
CATCH_UP = 0.02  # share of a fix's lateness that is the drift of the clocks
STILL = 4.0  # typical changes: a larger jump after a hold was a silence
LONGEST = 10  # rows in a period
SAME_PERIOD = 0.02  # of the rough period, by which the fitted one may differ


def undo_hold(samples: Samples) -> Samples | None:
    """One source on a grid of rows -> its values at their own times; None: nothing is held."""
    if len(samples) < FEWEST:
        return None
    time = samples.seconds(int(samples.vehicle_time_ns[0]))
    if np.any(np.diff(time) <= 0.0):
        return None
    rows = changed_rows(samples.values)
    period = hold_period(time, rows)
    if period is None:
        return None
    at, of = sample_times(time, samples.values, rows, period)
    shown = np.clip(np.searchsorted(time, at, side="left"), 0, len(time) - 1)
    moments = samples.vehicle_time_ns[0] + np.round(at * 1e9).astype(np.int64)
    late = samples.receive_time_ns[shown] - samples.vehicle_time_ns[shown]
    return replace(
        samples,
        order=samples.order[shown],
        vehicle_time_ns=moments,
        receive_time_ns=moments + late,
        values=samples.values[of],
    )


def changed_rows(values: Floats) -> Ints:
    """Values (K, n) -> rows whose value differs from that of the row before, the first included."""
    differs = np.any(values[1:] != values[:-1], axis=1)
    return np.flatnonzero(np.concatenate([[True], differs]))


def hold_period(time: Floats, rows: Ints) -> float | None:
    """Period [s] with which new values come, where that is slower than the rows."""
    steps = np.diff(rows)
    steps = steps[steps <= LONGEST]
    if len(steps) < FEWEST or np.mean(steps == 1) > ONE_ROW:
        return None
    usual = int(np.argmax(np.bincount(steps)))
    if usual < 2:
        return None
    rough = usual * float(np.median(np.diff(time)))
    number = _period_numbers(time[rows], rough)
    fine = float(np.polyfit(number, time[rows], 1)[0])
    return fine if abs(fine / rough - 1.0) < SAME_PERIOD else rough


def sample_times(time: Floats, values: Floats, rows: Ints, period: float) -> tuple[Floats, Ints]:
    """Times (n,) [s] of all periods with a fix, and the row (n,) that holds the value of each."""
    number = _period_numbers(time[rows], period)
    phase = median_filter(time[rows] - period * number, AROUND, mode="nearest")
    change = np.linalg.norm(np.diff(values[rows], axis=0), axis=1)
    still = change <= STILL * np.median(change)
    last = int((time[-1] - period * number[-1] - phase[-1]) / period + SLIP)
    ends = np.append(np.where(still, number[1:], number[:-1] + 1), number[-1] + min(last, LONGEST))
    seen = np.diff(np.append(rows, len(time))) * float(np.median(np.diff(time)))  # [s] in rows
    ends = np.minimum(ends, number + (seen / period).astype(np.int64) + 2)  # a gap holds no fixes
    at, of = [], []
    for first, end, offset, row in zip(number, ends, phase, rows, strict=True):
        numbers = np.arange(first, max(end, first + 1))
        at.append(offset + period * numbers)
        of.append(np.full(len(numbers), row))
    return np.concatenate(at), np.concatenate(of).astype(np.int64)


def _period_numbers(shown: Floats, period: float) -> Ints:
    """Number of the period in which each new value (n,) came, counted from the first."""
    clock, number, out = float(shown[0]), 0, [0]
    for moment in shown[1:].tolist():
        passed = max(int(np.floor((moment - clock) / period + SLIP)), 1)
        due = clock + passed * period
        clock = min(moment, due + CATCH_UP * (moment - due))
        number += passed
        out.append(number)
    return np.array(out, np.int64)


MAY_BE_HELD = ("position", "velocity", "yaw", "yaw rate")
MADE_FROM = {"velocity": "positions", "yaw rate": "headings"}  # a rate -> what it is the rate of
UNUSED = "accelerations are not used: motion follows from positions, headings and rates"
# smallest errors of a column [rad, m]: below them its values are a simulation's
LEAST_YAW_RAD, LEAST_POSITION_M = 0.001, 0.003
SLOW_S, OTHER_UNIT = 10.0, 0.3  # stretches that no window smooths; a scale that none explains


@dataclass(frozen=True)
class RepairedTable:
    """The sources to use, and one sentence for each thing that was wrong."""

    choices: Mapping[str, Choice]
    notices: tuple[str, ...]


def repair_table(decoded: BoatSamples, choices: Mapping[str, Choice]) -> RepairedTable:
    """The sources of a table -> those that hold; a log of messages comes back as it is."""
    if not decoded.tabular or "yaw" not in choices:
        return RepairedTable(choices, decoded.notices)
    out, notices = dict(choices), list(decoded.notices)
    for name in MAY_BE_HELD:
        if name in out:
            out[name], about = _at_own_times(out[name])
            notices += about
    mistakes = plain_mistakes(out)
    rates = {name: NOT_SMOOTHED if name in mistakes else s for name, s in _smoothings(out).items()}
    notices += _about_accelerations(out, decoded.of(Quantity.ACCELERATION))
    if any(rate.found for rate in rates.values()):
        left_out = [n for n in ("velocity", "yaw rate") if n in out and _replaceable(n, out)]
        notices.append(_about_smoothing(rates, left_out))
        notices += [text for name, text in mistakes.items() if name in left_out]
        out = {name: choice for name, choice in out.items() if name not in left_out}
    return RepairedTable(out, tuple(notices))


def settings_for(
    decoded: BoatSamples, choices: Mapping[str, Choice], settings: FilterSettings
) -> FilterSettings:
    """For a table: the same with errors as rough as its columns, and accelerations as hard.

    Positions that stand in for velocities must not wander more from fix to fix than they do.
    """
    if not decoded.tabular or "yaw" not in choices:
        return settings
    source = choices["yaw"].samples.equivalent
    if source in settings.sources:
        return settings
    heading = choices["yaw"].samples
    start_ns, turned = int(heading.vehicle_time_ns[0]), np.unwrap(heading.values, axis=0)
    noise = WhiteNoise(yaw_rad=estimated_white_std(turned, LEAST_YAW_RAD))
    turns = acceleration_std(heading.seconds(start_ns), turned)
    settings = replace(
        settings,
        sources={**settings.sources, source: noise},
        yaw_acceleration_radps2=max(turns, settings.yaw_acceleration_radps2),
    )
    if "position" not in choices or "velocity" in choices:
        return settings
    place = choices["position"]
    path = metres(place.samples.values, place.samples.quantity)
    white = estimated_white_std(path, LEAST_POSITION_M)
    wander = 2.0 * settings.position_error_m**2 / (max(place.rate_hz, 0.1) * white**2)
    hard = acceleration_std(place.samples.seconds(start_ns), path)
    return replace(
        settings,
        sources={**settings.sources, source: replace(noise, position_m=white)},
        surge_acceleration_mps2=max(hard, settings.surge_acceleration_mps2),
        sway_acceleration_mps2=max(0.5 * hard, settings.sway_acceleration_mps2),
        position_error_tau_s=max(wander, settings.position_error_tau_s),
    )


def _at_own_times(choice: Choice) -> tuple[Choice, list[str]]:
    """Held values at their own times."""
    samples = undo_hold(choice.samples)
    if samples is None:
        return choice, []
    rate = rate_hz(samples)
    notice = (
        f"{choice.name} comes at {rate:.1f} Hz and is repeated on rows of {choice.rate_hz:.0f} Hz: "
        "each value is taken once, at its own time"
    )
    longest = float(intervals(samples).max())
    return replace(choice, samples=samples, rate_hz=rate, longest_gap_s=longest), [notice]


def _replaceable(name: str, choices: Mapping[str, Choice]) -> bool:
    """The motion follows from another source too."""
    return name == "yaw rate" or "position" in choices


def _smoothings(choices: Mapping[str, Choice]) -> dict[str, Smoothing]:
    """Rate -> how it was smoothed, where there is something to compare it with."""
    yaw = choices["yaw"].samples
    start = int(yaw.vehicle_time_ns[0])
    heading = np.unwrap(yaw.values[:, 0])
    at = yaw.seconds(start)
    out = {}
    if "yaw rate" in choices:
        rate = choices["yaw rate"].samples
        out["yaw rate"] = _if_ascending(at, heading[:, None], rate.seconds(start), rate.values)
    if "velocity" in choices and "position" in choices:
        velocity, place = choices["velocity"].samples, choices["position"].samples
        when = velocity.seconds(start)
        moves = velocity.values
        if velocity.quantity is Quantity.BODY_VELOCITY:
            moves = over_ground(moves, np.interp(when, at, heading))
        out["velocity"] = _if_ascending(
            place.seconds(start), metres(place.values, place.quantity), when, moves
        )
    return out


def _if_ascending(time: Floats, x: Floats, rate_time: Floats, rate: Floats) -> Smoothing:
    """A table whose clock runs backwards shows no smoothing, nor does a rate of another unit,
    nor a single row.

    A rate of a few per cent of what the values say is not one that a window took so much from.
    """
    if min(len(time), len(rate_time)) < 2:
        return NOT_SMOOTHED
    if np.any(np.diff(time) <= 0.0) or np.any(np.diff(rate_time) <= 0.0):
        return NOT_SMOOTHED
    slow = rate_agreement(time, x, rate_time, rate, SLOW_S, 0.0)
    if slow is not None and slow.contradicts and abs(slow.scale - 1.0) > OTHER_UNIT:
        return NOT_SMOOTHED
    return smoothing(time, x, rate_time, rate)


def _about_accelerations(
    choices: Mapping[str, Choice], accelerations: Sequence[Samples]
) -> list[str]:
    """A sentence about accelerations, which are not used either way."""
    if not accelerations:
        return []
    moving = choices.get("velocity")
    if moving is None or moving.samples.quantity is not Quantity.BODY_VELOCITY:
        return [UNUSED]
    start = int(moving.samples.vehicle_time_ns[0])
    time, (u, v) = moving.samples.seconds(start), moving.samples.values.T
    if len(time) < 3 or np.any(np.diff(time) <= 0.0):
        return [UNUSED]
    yaw = choices["yaw"].samples
    turned = np.interp(time, yaw.seconds(start), np.unwrap(yaw.values[:, 0]))
    r = np.gradient(turned, time)
    reported = np.interp(time, accelerations[0].seconds(start), accelerations[0].values[:, 0])
    agreement = acceleration_agreement(time, reported, np.gradient(u, time) - r * v)
    if agreement is None or agreement.good:
        return [UNUSED]
    return [
        f"surge acceleration holds gravity: it reads {agreement.slope:.1f} m/s² where the speed "
        f"changes by 1.0 m/s² and is {agreement.bias:+.2f} m/s² off in the mean; {UNUSED}"
    ]


def _about_smoothing(rates: Mapping[str, Smoothing], left_out: Sequence[str]) -> str:
    names = [name for name, rate in rates.items() if rate.found]
    window = max(rates[name].window_s for name in names)
    verb = "is" if len(names) == 1 else "are"
    how = (
        f"{' and '.join(MADE_FROM[n] for n in left_out)} are taken instead of "
        f"{' and '.join(left_out)}"
        if left_out
        else "there is nothing to take instead: lags found from it are too short"
    )
    return (
        f"{' and '.join(names)} {verb} smoothed over about {window:.1f} s to both sides, so motion "
        f"shows before its command: {how}"
    )
