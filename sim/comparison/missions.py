"""The same mission sailed twice: where do two tracks part, and where does one fall behind?

    begin   where each boat is first under way; both tracks are counted from there
    match   the path through both tracks, forwards in both, on which the distances between matched
            places add up to the least (dynamic time warping), over equal lengths of each track
    gap     the matched place of the second track, to starboard of the first [m]
    lag     how much later the second boat is at the matched place [s]

Valid for: two passages of one mission from one start. Source: Sakoe and Chiba, Dynamic programming
algorithm optimization for spoken word recognition, IEEE Trans. ASSP 26 (1978), symmetric form
without slope constraint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.state import Floats, Ints
from sim.trial import Trial

# All chosen, not measured.
UNDER_WAY_SHARE, UNDER_WAY_S = 0.5, 2.0  # of the speed that a quarter of the time exceeds; for so
POINTS = 800  # of each track
SHORTEST_M = 5.0  # of a passage
PARTED_M = 2.0  # what two positions of a satellite receiver differ by is no parting
ROUNDING_M = 0.5  # a parting is no shorter, along the track, than the gap that makes it one …
DRIVEN_US = 5.0  # an output whose pulses spread less is not driven
HARDLY_SHARE = 0.1  # of the extent of the mission: a median gap beyond is another mission


class TrackTooShortError(ValueError):
    """A passage that nothing can be said about; the message says why."""


@dataclass(frozen=True)
class Passage:
    """One boat's passage.

    time     (T,) s
    north    (T,) m, east likewise
    yaw_rate (T,) rad/s
    pulses   by channel (T,) µs, NaN where it gave none
    """

    name: str
    time: Floats
    north: Floats
    east: Floats
    yaw_rate: Floats
    pulses: Mapping[int, Floats] = field(default_factory=dict)

    @classmethod
    def of_trial(cls, trial: Trial) -> "Passage":
        """A passage as the boat's own sensors saw it."""
        pulses = {channel: trial.pwm[:, k] for k, channel in enumerate(trial.channels)}
        north, east = trial.eta[:, 0], trial.eta[:, 1]
        return cls(trial.name, trial.time, north, east, trial.nu[:, 2], pulses)

    @property
    def speed(self) -> Floats:
        """Over ground (T,) [m/s]."""
        return np.hypot(np.gradient(self.north, self.time), np.gradient(self.east, self.time))

    def under_way(self) -> "Passage":
        """The part from the first motion to the last; time and place count from its start."""
        speed = self.speed
        fast = speed > UNDER_WAY_SHARE * float(np.quantile(speed, 0.75))
        hold = max(round(UNDER_WAY_S / float(np.median(np.diff(self.time)))), 1)
        starts = np.flatnonzero(np.convolve(fast, np.ones(hold), "valid") >= hold)
        if not len(starts):
            raise TrackTooShortError(f"{self.name}: is never under way")
        cut = slice(int(starts[0]), int(starts[-1]) + hold)
        length = float(np.hypot(np.diff(self.north[cut]), np.diff(self.east[cut])).sum())
        if length < SHORTEST_M:
            raise TrackTooShortError(f"{self.name}: {length:.1f} m under way: too short to compare")
        return Passage(
            self.name,
            self.time[cut] - self.time[cut][0],
            self.north[cut] - self.north[cut][0],
            self.east[cut] - self.east[cut][0],
            self.yaw_rate[cut],
            {channel: pulses[cut] for channel, pulses in self.pulses.items()},
        )

    @property
    def along(self) -> Floats:
        """Length of the track up to each moment (T,) [m]."""
        return np.append(0.0, np.hypot(np.diff(self.north), np.diff(self.east)).cumsum())


@dataclass(frozen=True)
class Parting:
    """A stretch of the first track [m along it] on which the second lies more than `limit` away."""

    start: float
    end: float
    time: float  # s after the beginning, of the first boat, where it starts
    gap: float  # m, the largest, to starboard positive
    turning: float  # rad/s, mean yaw rate of the first boat from shortly before to the end


@dataclass(frozen=True)
class MissionComparison:
    """Two passages, matched at equal lengths of the first.

    along  (n,) m along the first track, passed at `time` (n,) [s] by the first boat
    gap    (n,) m to the matched place of the second track, to starboard positive
    lag    (n,) s by which the second boat passes there later
    limit  m: with a larger gap they are said to have parted
    """

    first: Passage
    second: Passage
    along: Floats
    time: Floats
    gap: Floats
    lag: Floats
    limit: float
    partings: tuple[Parting, ...]

    @property
    def same_mission(self) -> bool:
        """False where the tracks have little in common."""
        extent = float(np.hypot(np.ptp(self.first.north), np.ptp(self.first.east)))
        return float(np.median(np.abs(self.gap))) <= HARDLY_SHARE * extent

    @property
    def apart_at_once(self) -> Floats:
        """Distance between the boats at the same time since their beginnings (n,) [m]."""
        first, second = (
            [np.interp(self.time, p.time, place) for place in (p.north, p.east)]
            for p in (self.first, self.second)
        )
        return np.hypot(second[0] - first[0], second[1] - first[1])

    @property
    def slowest(self) -> tuple[float, float, float]:
        """The eighth of the track with the largest change of lag: from, to [m], change [s]."""
        edges = np.linspace(0, len(self.along) - 1, 9).astype(int)
        change = np.diff(self.lag[edges])
        k = int(np.argmax(np.abs(change)))
        return float(self.along[edges[k]]), float(self.along[edges[k + 1]]), float(change[k])

    def mean_pulses(self) -> dict[int, tuple[float, float]]:
        """Mean pulse of each channel that both drive: of the first, of the second [µs]."""
        out = {}
        for channel in sorted(self.first.pulses.keys() & self.second.pulses.keys()):
            both = [p.pulses[channel] for p in (self.first, self.second)]
            if all(np.isfinite(pulses).any() and np.nanstd(pulses) > DRIVEN_US for pulses in both):
                out[channel] = float(np.nanmean(both[0])), float(np.nanmean(both[1]))
        return out


def compare_missions(first: Passage, second: Passage, limit: float = 0.0) -> MissionComparison:
    """Match two passages; `limit` [m] is raised to what receivers differ by."""
    one, two = first.under_way(), second.under_way()
    a, b = _equal_lengths(one), _equal_lengths(two)
    i, j = _warped(a[:, 1:3], b[:, 1:3])
    matched = np.array([np.mean(b[j[i == k]], axis=0) for k in range(len(a))])
    course = np.arctan2(np.gradient(a[:, 2]), np.gradient(a[:, 1]))
    off = matched[:, 1:3] - a[:, 1:3]
    side = -np.sin(course) * off[:, 0] + np.cos(course) * off[:, 1]
    gap = np.copysign(np.hypot(off[:, 0], off[:, 1]), side)
    along, limit = a[:, 3], max(limit, PARTED_M)
    partings = tuple(_partings(one, along, a[:, 0], gap, limit))
    return MissionComparison(
        one, two, along, a[:, 0], gap, matched[:, 0] - a[:, 0], limit, partings
    )


def _equal_lengths(p: Passage) -> Floats:
    """(POINTS, 4): time, north, east, along, at equal lengths of the track."""
    along = p.along + 1e-9 * np.arange(len(p.time))  # a boat that rests does not go back
    at = np.linspace(0.0, along[-1], POINTS)
    columns = [np.interp(at, along, column) for column in (p.time, p.north, p.east)]
    return np.column_stack([*columns, at])


def _warped(a: Floats, b: Floats) -> tuple[Ints, Ints]:
    """Places (n, 2), (m, 2) -> indices of the cheapest path through both, from end to end.

    The table is filled diagonal by diagonal: each needs the two before it alone.
    """
    cost = np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1))
    n, m = cost.shape
    total = np.full((n + 1, m + 1), np.inf)
    total[0, 0] = 0.0
    for d in range(2, n + m + 1):
        i = np.arange(max(1, d - m), min(n, d - 1) + 1)
        j = d - i
        least = np.minimum(
            np.minimum(total[i - 1, j], total[i, j - 1]) + cost[i - 1, j - 1],
            total[i - 1, j - 1] + 2.0 * cost[i - 1, j - 1],
        )
        total[i, j] = least
    path = [(n, m)]
    while path[-1] != (1, 1):
        i, j = path[-1]  # type: ignore[assignment]
        straight = total[i - 1, j - 1] + 2.0 * cost[i - 1, j - 1]
        ways = {(i - 1, j - 1): straight, (i - 1, j): total[i - 1, j] + cost[i - 1, j - 1],
                (i, j - 1): total[i, j - 1] + cost[i - 1, j - 1]}  # fmt: skip
        path.append(min(ways, key=lambda place: ways[place]))
    rows, columns = np.array(path[::-1]).T - 1
    return rows, columns


def _partings(
    first: Passage, along: Floats, time: Floats, gap: Floats, limit: float
) -> Sequence[Parting]:
    """Stretches beyond the limit in the order of the track; specks are left out."""
    beyond = np.abs(gap) > limit
    edges = np.flatnonzero(np.diff(np.concatenate([[0], beyond.astype(int), [0]])))
    found = []
    for begin, end in zip(edges[::2], edges[1::2] - 1, strict=True):
        if along[end] - along[begin] < ROUNDING_M:
            continue
        inside = (first.time >= time[begin] - UNDER_WAY_S) & (first.time <= time[end])
        worst = int(begin + np.argmax(np.abs(gap[begin : end + 1])))
        turning = float(np.mean(first.yaw_rate[inside])) if inside.any() else 0.0
        found.append(
            Parting(
                float(along[begin]), float(along[end]), float(time[begin]), float(gap[worst]),
                turning,
            )
        )  # fmt: skip
    return found
