"""Whether two sensors tell of one motion: a rate against the values that it is the rate of.

    x(t + T) − x(t) = g ∫ rate dt − τ (rate(t + T) − rate(t)) + e
    of a heading also  + b T + d (sin x(t + T) − sin x(t)) + h (cos x(t + T) − cos x(t))

Least squares over stretches of T: g is 1 where the two agree, and the values come τ [s] after the
rate; b is the gyro's bias, d and h the compass's deviation, which are effects of the catalogue and
contradict nothing. No model of the boat is needed: a gyro whose scale is off, knots taken for m/s,
a rate whose sign is turned round or a compass that lags would else be looked for in the boat.
Stretches that are off by several times the usual are left out once (an autopilot sets its
heading anew); standard deviations are those of the sums over blocks of time (White, Econometrica
48, 1980, by clusters).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gateway.ingest.mapping import Origin, to_local
from gateway.ingest.sources import Choice, uniform_grid
from gateway.samples import Quantity, Samples
from sim.state import Floats, Ints

# Chosen, not measured; what logs of other people show stands in the tests.
TURN_S, MOVE_S = 2.0, 4.0  # stretches of a heading, of a position
GAP_S = 0.6  # a longer silence ends a stretch
BLOCK_S = 25.0
FEWEST_BLOCKS = 4  # in which the boat turned or moved
LEAST_TURN_RAD, LEAST_MOVE_M = 0.1, 1.5  # in a stretch, root mean square, for anything to be seen
OUTLIER = 6.0  # medians of a stretch's error
SURE = 5.0  # standard deviations
HUGE = 1e6  # rad or m in a stretch, in whatever unit: no boat
SCALE_OFF, LATE_S = 0.06, 0.2  # that are told
UNITS = {  # rate over what the values say -> the usual mistake
    57.296: "degrees taken for radians", 1.0 / 57.296: "radians taken for degrees",
    1.9438: "knots taken for m/s", 0.5144: "m/s taken for knots",
    3.6: "km/h taken for m/s", 1.0 / 3.6: "m/s taken for km/h",
    100.0: "cm/s taken for m/s", 0.01: "m/s taken for cm/s", 2.2369: "mph taken for m/s",
}  # fmt: skip
NEAR_UNIT = 0.06


class RateAgreement(NamedTuple):
    """Scale of a rate over what its values say, how much later the values come [s], and both σ."""

    scale: float
    scale_std: float
    late_s: float
    late_std: float

    @property
    def contradicts(self) -> bool:
        """Whether the scale is surely off by more than a sensor's own error."""
        off = abs(self.scale - 1.0)
        return off > SCALE_OFF and off > SURE * self.scale_std

    @property
    def is_late(self) -> bool:
        """Whether values surely come later, or earlier, than their rate."""
        late = abs(self.late_s)
        return late > LATE_S and late > SURE * self.late_std


def rate_agreement(
    time: Floats, x: Floats, rate_time: Floats, rate: Floats, stretch_s: float, least: float,
    heading: bool = False,
) -> RateAgreement | None:  # fmt: skip
    """Values (K, n) at (K,), their rates (L, n) at (L,) [s], ascending -> how the two agree.

    None where too little moved, by less than `least` in a stretch, or the two seldom overlap.
    `heading`: x is one of a compass [rad].
    """
    step = max(float(np.median(np.diff(time))), float(np.median(np.diff(rate_time))))
    first, last = max(time[0], rate_time[0]), min(time[-1], rate_time[-1]) - stretch_s
    begin = uniform_grid(float(first), float(last), 0.5 * stretch_s)
    whole = _unbroken(time, begin, begin + stretch_s)
    begin = begin[whole & _unbroken(rate_time, begin, begin + stretch_s)]
    if step > GAP_S or len(begin) < FEWEST_BLOCKS:
        return None
    end = begin + stretch_s
    moved, turned, change = (
        np.stack([_at(t, y[:, i], end) - _at(t, y[:, i], begin) for i in range(x.shape[1])], axis=1)
        for t, y in ((time, x), (rate_time, _integrals(rate_time, rate)), (rate_time, rate))
    )
    block = np.repeat(np.floor(begin / BLOCK_S).astype(np.int64), x.shape[1])
    X, y, seen = np.stack([turned.ravel(), -change.ravel()], axis=1), moved.ravel(), moved.ravel()
    if not max(float(np.abs(X).max()), float(np.abs(y).max())) < HUGE:
        return None  # damaged values
    if heading:  # a boat that circles steadily tells no scale from a bias
        own = _of_a_compass(time, x[:, 0], begin, end)
        seen = y - own @ np.linalg.lstsq(own, y, rcond=None)[0]
        X = np.hstack([X, own])
    often = len(np.unique(block[np.abs(seen) > least])) >= FEWEST_BLOCKS
    if not often or np.sqrt(np.mean(seen**2)) < least:
        return None
    (g, late, *_), (g_std, late_std, *_) = _trimmed_fit(X, y, block)
    if g == 0.0:
        return None
    # y = g ∫ rate: the rate's scale is 1 / g
    return RateAgreement(1.0 / g, g_std / g**2, late, late_std)


def _trimmed_fit(X: Floats, y: Floats, block: Ints) -> tuple[list[float], list[float]]:
    """Numbers b (m,) of y (N,) ≈ X (N, m) b and their standard deviations, by clusters (N,).

    Rows that the first fit leaves far off are left out of the second.
    """
    kept = np.ones(len(y), bool)
    for _ in range(2):
        b = np.linalg.lstsq(X[kept], y[kept], rcond=None)[0]
        off = np.abs(y - X @ b)
        kept = off <= OUTLIER * max(float(np.median(off)), 1e-9)
    X, left, block = X[kept], (y - X @ b)[kept], block[kept]
    H = np.linalg.pinv(X.T @ X)
    sums = np.stack([X[block == k].T @ left[block == k] for k in np.unique(block)])
    variance = np.diag(H @ (sums.T @ sums) @ H)
    return b.tolist(), np.sqrt(np.maximum(variance, 0.0)).tolist()


def _of_a_compass(time: Floats, heading: Floats, begin: Floats, end: Floats) -> Floats:
    """What a gyro's bias and a compass's deviation add to each stretch (M, 3)."""
    was, now = (_at(time, heading, at) for at in (begin, end))
    turned = np.sin(now) - np.sin(was), np.cos(now) - np.cos(was)
    return np.stack([end - begin, *turned], axis=1)


def contradictions(choices: Mapping[str, Choice]) -> tuple[str, ...]:
    """A sentence for each pair of sensors of one boat that do not tell of one motion."""
    out = []
    if "yaw" not in choices:
        return ()
    start = int(choices["yaw"].samples.vehicle_time_ns[0])
    at, heading = _ascending(choices["yaw"].samples, start)
    if len(at) < 2:
        return ()
    turned = np.unwrap(heading[:, :1], axis=0)
    if "yaw rate" in choices:
        when, rate = _ascending(choices["yaw rate"].samples, start)
        if len(when) > 1:
            found = rate_agreement(at, turned, when, rate[:, :1], TURN_S, LEAST_TURN_RAD, True)
            out += _told(found, choices["yaw rate"], choices["yaw"], "the turn of the heading")
    if "velocity" in choices and "position" in choices:
        when, velocity = _ascending(choices["velocity"].samples, start)
        then, place = _ascending(choices["position"].samples, start)
        if len(when) > 1 and len(then) > 1:
            if choices["velocity"].samples.quantity is Quantity.BODY_VELOCITY:
                velocity = over_ground(velocity, np.interp(when, at, turned[:, 0]))
            if choices["position"].samples.quantity is Quantity.GLOBAL_POSITION:
                place = to_local(place, Origin(*map(float, place[0])))
            found = rate_agreement(then, place, when, velocity, MOVE_S, LEAST_MOVE_M)
            out += _told(found, choices["velocity"], choices["position"], "the change of position")
    return tuple(out)


def over_ground(velocity: Floats, yaw: Floats) -> Floats:
    """Velocities ahead and to starboard (K, 2), headings (K,) -> towards north, east (K, 2)."""
    c, s = np.cos(yaw), np.sin(yaw)
    u, v = velocity.T
    return np.stack([c * u - s * v, s * u + c * v], axis=1)


def _told(found: RateAgreement | None, rate: Choice, values: Choice, change: str) -> list[str]:
    """What contradicts, in words; nothing where nothing does."""
    if found is None:
        return []
    out = []
    if found.contradicts:
        size = abs(found.scale)
        mistakes = [m for factor, m in UNITS.items() if abs(size / factor - 1.0) < NEAR_UNIT]
        wrong = f"{mistakes[0]}?" if mistakes else "one of the two has a wrong scale"
        if abs(size - 1.0) <= SCALE_OFF:
            wrong = "the sign of one of the two is turned round"
        out.append(
            f"{rate.name} ({rate.source}) is {found.scale:.3g} ± {2.0 * found.scale_std:.1g} times "
            f"{change} ({values.source}): {wrong}"
        )
    elif found.is_late:
        order = "after" if found.late_s > 0.0 else "before"
        out.append(
            f"{values.name} ({values.source}) comes {abs(found.late_s):.2f} ± "
            f"{2.0 * found.late_std:.1g} s {order} {rate.name} ({rate.source})"
        )
    return out


def _ascending(samples: Samples, start_ns: int) -> tuple[Floats, Floats]:
    """Times (K,) [s] that rise and values (K, n) that are known."""
    time, values = samples.seconds(start_ns), np.asarray(samples.values, np.float64)
    good = np.isfinite(values).all(axis=1)
    time, values = time[good], values[good]
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    new = np.concatenate([[True], np.diff(time) > 0.0]) if len(time) else np.zeros(0, bool)
    return time[new], values[new]


def _unbroken(time: Floats, begin: Floats, end: Floats) -> np.ndarray:
    """Which stretches (M,) hold no silence of the times (K,)."""
    gaps = np.concatenate([[0.0], np.cumsum(np.diff(time) > GAP_S)])
    first = np.clip(np.searchsorted(time, begin, side="right") - 1, 0, len(time) - 1)
    last = np.clip(np.searchsorted(time, end), 0, len(time) - 1)
    return np.asarray(gaps[first] == gaps[last])


def _integrals(time: Floats, rate: Floats) -> Floats:
    """Integrals of rates (L, n) from the first time on."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(steps, axis=0)])


def _at(time: Floats, y: Floats, when: Floats) -> Floats:
    return np.interp(when, time, y)
