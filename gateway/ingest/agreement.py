"""Whether two sensors tell of one motion: a rate against the values that it is the rate of.

    x(t + T) − x(t) = g (∫ rate dt − τ (rate(t + T) − rate(t))) + e
    of a heading also  + b T + Σ_k d_k (sin kψ(t + T) − sin kψ(t)) + h_k (cos …),  k = 1, 2
    of a place also    + (R(ψ(t + T)) − R(ψ(t))) arm + q ∫ rate, turned by 90°, dt

Least squares over stretches of T: g is 1 where the two agree, and the values come τ [s] after the
rate; b is the gyro's bias, d and h the compass's deviation, `arm` where the antenna sits, q a frame
that is askew: none of these is a contradiction. Where the boat's turns do not tell a bias or a
deviation from a scale, usual ones widen σ instead. No model of the boat is needed: a gyro whose
scale is off, knots taken for m/s, a rate whose sign is turned round or a compass that lags would
else be looked for in the boat. Stretches that are off by several times the usual are left out (an
autopilot sets its heading anew); standard deviations are those of the sums over blocks of time
(White, Econometrica 48, 1980, by clusters).

Where it is plain which of two is wrong it is set right: of a heading and its rate the later one is
late; and a scale that is the same over long stretches is the rate's, for a heading or a place that
is smoothed lacks what is fast alone.

What shows without all that is told by `gateway.ingest.plain_mistakes`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from gateway.ingest.plain_mistakes import plain_mistakes
from gateway.ingest.sources import Choice, uniform_grid
from gateway.ingest.stretches import (
    GAP_S,
    HUGE,
    UNITS,
    ascending,
    changes,
    integrals,
    metres,
    over_ground,
    unbroken,
    value_at,
)
from gateway.samples import Quantity
from sim.state import Floats, Ints

# Chosen, not measured; what logs of other people show stands in the tests.
BLOCK_S = 25.0
FEWEST_BLOCKS = 4  # in which the boat turned or moved
# stretches [s] of a heading and of a position, and the turn or way [rad, m] in one, root mean
# square, for anything to be seen; over the long ones what is smoothed is whole
TURNS, MOVES = (2.0, 0.1), (4.0, 1.5)
LONG_TURNS, LONG_MOVES = (15.0, 0.3), (15.0, 4.0)
OUTLIER = 6.0  # medians of a stretch's error
SURE = 5.0  # standard deviations
SPIKE = 5.0  # 95 % quantiles of what the rates add up to
OFF_SHARE = 0.5  # of a stretch's own turn or way: less is no outlier
BIAS_RADPS = 0.03  # of a gyro, usual, and of a compass, once and twice around
DEVIATION_RAD = (0.08, 0.08, 0.025, 0.025)
LATE_ROUNDS, NEAR_LATE_S = 3, 0.05
SCALE_OFF, LATE_S = 0.06, 0.25  # that are told
NEAR = 0.25  # of a scale: values that are off by more may be of another axis
NEAR_UNIT = 0.03
LEAST_TURN_SHARE = 0.02  # of a turn: less is within what is assumed of compass and gyro
DEGREE, FULL_CIRCLE = np.pi / 180.0, 2.0 * np.pi  # rad
MOST_YAW = 0.99  # of the headings: a few may be damaged
LEAST_UPRIGHT = 0.8  # the cosine of a gyro that lies over


class RateAgreement(NamedTuple):
    """Scale of a rate over what its values say, how much later the values come [s], and both σ.

    deviation, deviation_std   of a compass (4,) [rad]: of the sine and cosine of the heading, then
                               of twice the heading; empty where the boat's turns do not tell it
    """

    scale: float
    scale_std: float
    late_s: float
    late_std: float
    deviation: tuple[float, ...] = ()
    deviation_std: tuple[float, ...] = ()

    @property
    def sure_deviation(self) -> tuple[float, ...]:
        """What a compass surely deviates by, of `deviation`, the rest 0; empty where that makes the
        heading turn by no other rate than is assumed of compass and gyro anyhow.
        """
        sure = tuple(
            angle if abs(angle) > SURE * std else 0.0
            for angle, std in zip(self.deviation, self.deviation_std, strict=True)
        )
        # root mean square of dψ'/dψ − 1, ψ' the heading that is shown
        share = np.sqrt(0.5 * sum((k * d) ** 2 for k, d in zip((1, 1, 2, 2), sure, strict=False)))
        return sure if share > LEAST_TURN_SHARE else ()

    @property
    def contradicts(self) -> bool:
        """Whether the scale is surely off by more than a sensor's own error.

        Its inverse was fitted: a scale of nearly nothing is as unsure as one of many times.
        """
        off = abs(self.scale - 1.0)
        return off > SCALE_OFF and off * min(1.0, abs(self.scale)) > SURE * self.scale_std

    @property
    def is_near(self) -> bool:
        """Whether the scale is that of one motion at all, if not quite."""
        return abs(self.scale - 1.0) < NEAR

    @property
    def agrees(self) -> bool:
        """Whether the scale is surely that of one motion."""
        off = abs(abs(self.scale) - 1.0)
        return off < SCALE_OFF and SURE * self.scale_std < NEAR

    def is_same_scale(self, other: "RateAgreement") -> bool:
        """Whether the scale is off by as much as another's, as far as a sensor's own error goes."""
        return self.contradicts and abs(self.scale - other.scale) < 0.5 * SCALE_OFF

    @property
    def is_late(self) -> bool:
        """Whether values surely come later, or earlier, than their rate."""
        late = abs(self.late_s)
        return late > LATE_S and late > SURE * self.late_std


class Turns(NamedTuple):
    """Headings (K,) [rad, unwrapped] at times (K,) [s], and whether the values are these.

    Else the values are places: of an antenna that may sit elsewhere than what the rate is of.
    """

    time: Floats
    heading: Floats
    are_values: bool


def rate_agreement(
    time: Floats, x: Floats, rate_time: Floats, rate: Floats, stretch_s: float, least: float,
    turns: Turns | None = None,
) -> RateAgreement | None:  # fmt: skip
    """Values (K, n) at (K,), their rates (L, n) at (L,) [s], ascending -> how the two agree.

    None where too little moved, by less than `least` in a stretch, or the two seldom overlap.
    """
    late, out = 0.0, None
    for _ in range(LATE_ROUNDS):  # the slope of a lateness holds for short ones
        found = _agreement(time, x, rate_time + late, rate, stretch_s, least, turns)
        if found is None or abs(late + found.late_s) > stretch_s:
            return None
        late += found.late_s
        out = found._replace(late_s=late)
        if abs(found.late_s) < NEAR_LATE_S:
            break
    return out


@np.errstate(all="ignore")
def _agreement(
    time: Floats, x: Floats, rate_time: Floats, rate: Floats, stretch_s: float, least: float,
    turns: Turns | None,
) -> RateAgreement | None:  # fmt: skip
    """One step from the rate's own times."""
    step = max(float(np.median(np.diff(time))), float(np.median(np.diff(rate_time))))
    first, last = max(time[0], rate_time[0]), min(time[-1], rate_time[-1]) - stretch_s
    begin = uniform_grid(float(first), float(last), 0.5 * stretch_s)
    whole = unbroken(time, begin, begin + stretch_s)
    begin = begin[whole & unbroken(rate_time, begin, begin + stretch_s)]
    if step > GAP_S or len(begin) < FEWEST_BLOCKS:
        return None
    end = begin + stretch_s
    moved, turned, change = (
        changes(t, y, begin, end)
        for t, y in ((time, x), (rate_time, integrals(rate_time, rate)), (rate_time, rate))
    )
    block = np.repeat(np.floor(begin / BLOCK_S).astype(np.int64), x.shape[1])
    X, y = np.stack([turned.ravel(), -change.ravel()], axis=1), moved.ravel()
    if not max(float(np.abs(X).max()), float(np.abs(y).max())) < HUGE:
        return None  # damaged values
    if not _is_seen(y, least, block):
        return None
    unseen = np.zeros((len(y), 0))
    if turns is not None and turns.are_values:
        own = _of_a_compass(turns, begin, end)
        # all around, and not at one rate: bias and deviation are seen beside the scale
        if _is_seen(y - own @ np.linalg.lstsq(own, y, rcond=None)[0], least, block):
            X = np.hstack([X, own])
        else:
            unseen = own * np.array([BIAS_RADPS, *DEVIATION_RAD])
    elif turns is not None:
        askew = np.stack([-turned[:, 1], turned[:, 0]], axis=1).ravel()
        X = np.column_stack([X, askew, _of_an_arm(turns, begin, end)])
    b, std = _trimmed_fit(X, y, block, unseen, least)
    g = b[0] if turns is None or turns.are_values else np.copysign(np.hypot(b[0], b[2]), b[0])
    if g == 0.0 or not np.isfinite([g, *std]).all():
        return None
    # y = g (∫ rate − τ change): the rate's scale is 1 / g
    late, late_std = b[1] / g, std[1] / abs(g)
    of_compass = slice(3, None) if turns is not None and turns.are_values else slice(0)
    return RateAgreement(
        float(1.0 / g), float(std[0] / g**2), float(late), float(late_std),
        tuple(b[of_compass].tolist()), tuple(std[of_compass].tolist()),
    )  # fmt: skip


def _is_seen(y: Floats, least: float, block: Ints) -> bool:
    """Whether stretches (M,) show more than `least`, in enough blocks."""
    often = len(np.unique(block[np.abs(y) > least])) >= FEWEST_BLOCKS
    return often and float(np.sqrt(np.mean(y**2))) >= least


def _trimmed_fit(
    X: Floats, y: Floats, block: Ints, unseen: Floats, least: float
) -> tuple[Floats, Floats]:
    """Numbers b (m,) of y (N,) ≈ X (N, m) b and their standard deviations, by clusters (N,).

    Left out are rates of a spike, which would be their own scale, and what the fit before leaves
    far off. `unseen` (N, q): what a usual bias and deviation add, which these stretches cannot
    tell from a scale.
    """
    size = np.abs(X[:, 0])
    kept = size <= SPIKE * np.quantile(size[np.abs(y) > least], 0.95)
    for _ in range(3):
        b = np.linalg.lstsq(X[kept], y[kept], rcond=None)[0]
        off = np.abs(y - X @ b)
        usual = max(float(np.median(off[kept])), 1e-9)
        kept = off <= OUTLIER * usual + OFF_SHARE * np.abs(y)
    X, left, block = X[kept], (y - X @ b)[kept], block[kept]
    H = np.linalg.pinv(X.T @ X)
    sums = np.stack([X[block == k].T @ left[block == k] for k in np.unique(block)])
    variance = np.diag(H @ (sums.T @ sums) @ H) + np.sum((H @ X.T @ unseen[kept]) ** 2, axis=1)
    return b, np.sqrt(np.maximum(variance, 0.0))


def _of_a_compass(turns: Turns, begin: Floats, end: Floats) -> Floats:
    """What a gyro's bias and a compass's deviation, hard and soft iron, add to a stretch (M, 5)."""
    was, now = (value_at(turns.time, turns.heading, at) for at in (begin, end))
    around = [f(k * now) - f(k * was) for k in (1.0, 2.0) for f in (np.sin, np.cos)]
    return np.stack([end - begin, *around], axis=1)


def _of_an_arm(turns: Turns, begin: Floats, end: Floats) -> Floats:
    """What a metre ahead and one to starboard add to each stretch, north and east (2 M, 2)."""
    was, now = (value_at(turns.time, turns.heading, at) for at in (begin, end))
    c, s = np.cos(now) - np.cos(was), np.sin(now) - np.sin(was)
    return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1).reshape(-1, 2)


class Reconciled(NamedTuple):
    """The sources of a boat, set right where it is plain which of two is wrong, and a sentence for
    each pair of sensors that do not tell of one motion.

    deviation   of the compass, where the gyro surely tells one (`RateAgreement.sure_deviation`)
    """

    choices: Mapping[str, Choice]
    contradictions: tuple[str, ...]
    deviation: tuple[float, ...] = ()


def reconciled(choices: Mapping[str, Choice]) -> Reconciled:
    """What contradicts, and the sources without what is surely wrong of it."""
    out, told, deviation = _reconciled(choices)
    plain = plain_mistakes(choices)
    more = (text for name, text in plain.items() if not any(name in t for t in told))
    return Reconciled(out, (*told, *more), deviation)


def _reconciled(choices: Mapping[str, Choice]) -> Reconciled:
    right, out = dict(choices), list[str]()
    deviation: tuple[float, ...] = ()
    if "yaw" not in choices:
        return Reconciled(right, ())
    start = int(choices["yaw"].samples.vehicle_time_ns[0])
    at, heading = ascending(choices["yaw"].samples, start)
    if len(at) < 2:
        return Reconciled(right, ())
    turned = np.unwrap(heading[:, :1], axis=0)
    if "yaw rate" in choices:
        when, rate = ascending(choices["yaw rate"].samples, start)
        if len(when) > 1:
            found = _turns_agree(at, heading[:, 0], when, rate[:, :1])
            if found is None or not found.is_near:
                out += _other_unit(at, heading[:, 0], when, rate[:, :1], choices)
                found = None if out else found
            told, mended = _judged(
                found, partial(_turns_agree, at, heading[:, 0], when, rate[:, :1], long=True),
                choices["yaw rate"], choices["yaw"], "the turn of the heading",
            )  # fmt: skip
            out += told
            right |= mended
            deviation = found.sure_deviation if found is not None and not told else ()
            at, heading = ascending(right["yaw"].samples, start)
            turned = np.unwrap(heading[:, :1], axis=0)
    if "velocity" in choices and "position" in choices:
        when, velocity = ascending(choices["velocity"].samples, start)
        then, place = ascending(choices["position"].samples, start)
        if len(when) > 1 and len(then) > 1:
            if choices["velocity"].samples.quantity is Quantity.BODY_VELOCITY:
                velocity = over_ground(velocity, np.interp(when, at, turned[:, 0]))
            place = metres(place, choices["position"].samples.quantity)
            turns = Turns(at, turned[:, 0], False)
            stretches = (*MOVES, turns)
            found = rate_agreement(then, place, when, velocity, *stretches)
            mirrored = None
            if found is None or not found.is_near:
                mirrored = rate_agreement(then, place[:, ::-1], when, velocity, *stretches)
            if mirrored is not None and mirrored.agrees:
                out.append(
                    f"velocity ({choices['velocity'].source}) and position "
                    f"({choices['position'].source}) are mirror images: north and east of one are "
                    "exchanged, or the sign of one of them is turned round"
                )
                found = None
            told, mended = _judged(
                found, partial(rate_agreement, then, place, when, velocity, *LONG_MOVES, turns),
                choices["velocity"], choices["position"], "the change of position",
            )  # fmt: skip
            out += told
            right |= mended
    return Reconciled(right, tuple(out), deviation)


def _judged(
    found: RateAgreement | None, over_long: Callable[[], RateAgreement | None], rate: Choice,
    values: Choice, change: str,
) -> tuple[list[str], dict[str, Choice]]:  # fmt: skip
    """What contradicts, in words; and by name what is set right: a rate of a wrong scale, and the
    later of a heading and its rate.

    Where both scale and time are off nothing is, for values that are filtered are late and lack
    what is fast; nor a scale that is not the same over long stretches. Positions may be late or
    velocities early, and no fit needs the places: these stay.
    """
    right: dict[str, Choice] = {}
    if found is None:
        return [], right
    if found.is_near and found.contradicts and not found.is_late:
        long = over_long()
        if long is not None and long.is_same_scale(found):
            samples = replace(rate.samples, values=rate.samples.values / found.scale)
            right[rate.name] = replace(rate, samples=samples)
    elif found.is_near and found.is_late and not found.contradicts and values.name == "yaw":
        late = values if found.late_s > 0.0 else rate
        time = late.samples.vehicle_time_ns - round(abs(found.late_s) * 1e9)
        right[late.name] = replace(late, samples=replace(late.samples, vehicle_time_ns=time))
    return _told(found, rate, values, change, right), right


def _turns_agree(
    at: Floats, yaw: Floats, when: Floats, rate: Floats, long: bool = False
) -> RateAgreement | None:
    """Headings (K,) [rad] at (K,) and yaw rates (L, 1) at (L,) [s] -> how the two agree."""
    turned = np.unwrap(yaw)
    stretches = LONG_TURNS if long else TURNS
    return rate_agreement(at, turned[:, None], when, rate, *stretches, Turns(at, turned, True))


def _other_unit(
    at: Floats, yaw: Floats, when: Floats, rate: Floats, choices: Mapping[str, Choice]
) -> list[str]:
    """A sentence where headings agree with their rate once they are taken in the other unit.

    Their ratio does not show it: a heading of some degrees hardly turns at all, and one that wraps
    elsewhere than at a full circle does not turn as it should.
    """
    largest = float(np.quantile(np.abs(yaw), MOST_YAW))  # in the right unit about a full circle
    if largest <= FULL_CIRCLE * DEGREE:
        factor, mistake = 1.0 / DEGREE, "radians taken for degrees"
    elif largest > FULL_CIRCLE:
        factor, mistake = DEGREE, "degrees taken for radians"
    else:
        return []
    found = _turns_agree(at, factor * yaw, when, rate)
    if found is None or not found.agrees or found.scale < 0.0:
        return []
    return [
        f"yaw ({choices['yaw'].source}) turns as yaw rate ({choices['yaw rate'].source}) says "
        f"where it is taken {factor:.3g} times: {mistake}?"
    ]


def _told(
    found: RateAgreement, rate: Choice, values: Choice, change: str, right: Iterable[str]
) -> list[str]:
    """What contradicts, in words, and what of it is set `right`; nothing where nothing does."""
    out, mended = list[str](), "".join(right)
    takes = f"comparisons and fits take {mended}"
    if found.contradicts:
        size = abs(found.scale)
        mistakes = [f"{m}?" for factor, m in UNITS.items() if abs(size / factor - 1.0) < NEAR_UNIT]
        if found.scale < 0.0:
            mistakes = ["the sign of one of the two is turned round", *mistakes]
        elif rate.name == "yaw rate" and LEAST_UPRIGHT < size < 1.0:
            over = np.degrees(np.arccos(size))
            mistakes = [f"a wrong scale, or a gyro that lies over by {over:.0f}°"]
        wrong = ", ".join(mistakes) or "one of the two has a wrong scale"
        does = f"; {takes} {1.0 / found.scale:.3g} times" if mended else ""
        out.append(
            f"{rate.name} ({rate.source}) is {found.scale:.3g} ± {2.0 * found.scale_std:.1g} times "
            f"{change} ({values.source}): {wrong}{does}"
        )
    if found.is_late and found.is_near:
        order = "after" if found.late_s > 0.0 else "before"
        does = f": {takes} that much earlier" if mended else ""
        out.append(
            f"{values.name} ({values.source}) comes {abs(found.late_s):.2f} ± "
            f"{2.0 * found.late_std:.1g} s {order} {rate.name} ({rate.source}){does}"
        )
    return out
