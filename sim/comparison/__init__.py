"""How far a model is from a measurement, and in which regimes: trials in, `Comparison` out.

Here: the regimes that the error is binned by (speed, turn rate, heading, throttle, time, …), and
where it is: its share, its mean and the missing force in every bin of every regime.

A regime gives every row of the trial a value and cuts the values into bins with round edges, in
the unit that people read. Edges are half open, [from, to); the last bin keeps its end. Each bin
has one sentence for a boat's owner: degrees, m/s, per cent, with units.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.effects.words import COMPASS as COMPASS
from sim.model import Model
from sim.prediction import MissingForce, vessel_commands
from sim.prediction.free_runs import Prediction, scaled_squares
from sim.state import Eta, Floats, Ints, Nu
from sim.trial import Trial

DEGREES = 180.0 / np.pi
UNDER_WAY_MPS = 0.2  # below this speed a drift angle means nothing; chosen, not measured
MIN_BIAS = 0.3  # mean error over rms error: less is no tendency; chosen, not measured
NOISE_IN_A_BIN = 1.2  # times the noise of the whole, that a bin may show; chosen
MIN_STEADY = 0.5  # of the largest error beyond noise, of one that errs one way; chosen
THROTTLE_EDGES = np.array([-1.0, -0.75, -0.5, -0.25, -0.05, 0.05, 0.25, 0.5, 0.75, 1.0])
REVERSE_EDGES = np.array([0.0, 0.05, 0.25, 0.5, 0.75, 1.0])
ROUND_STEPS = np.array([1.0, 2.0, 2.5, 5.0, 10.0])
NAMES = {
    "speed": "speed",
    "turn_rate": "turn rate",
    "drift_angle": "drift angle",
    "throttle": "mean throttle",
    "reverse": "hardest reverse",
    "voltage": "battery",
    "time": "time",
    "north": "position north",
    "east": "position east",
}
CHANNELS = ("surge", "sway", "turn rate")
DIRECTIONS = (  # of each channel, where the boat is above the model and where below
    ("faster ahead", "slower ahead"),
    ("faster to starboard", "faster to port"),
    ("faster clockwise", "faster counter-clockwise"),
)

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Regime:
    """One variable over the trial.

    by       its name            unit   of values and edges (SI)
    value    (T,) NaN where it does not apply
    edges    (n+1,) ascending
    display  unit that people read, and how many of it make one SI unit
    """

    by: str
    unit: str
    value: Floats
    edges: Floats
    display: tuple[str, float]


def regimes_of(trial: Trial, model: Model) -> tuple[Regime, ...]:
    """All regimes with a value in usable time; throttle and reverse as the model reads them."""
    u, v, r = trial.nu[:, Nu.U], trial.nu[:, Nu.V], trial.nu[:, Nu.R]
    speed = np.hypot(u, v)
    drift = np.where(speed > UNDER_WAY_MPS, np.arctan2(v, u), np.nan)
    heading = trial.eta[:, Eta.YAW] % (2.0 * np.pi)
    found = [
        _with_round_edges("speed", "m/s", speed, trial, 8),
        _with_round_edges("turn_rate", "rad/s", r, trial, 9, ("°/s", DEGREES)),
        _with_round_edges("drift_angle", "rad", drift, trial, 9, ("°", DEGREES)),
        Regime("heading", "rad", heading, np.linspace(0.0, 2.0 * np.pi, 9), ("°", DEGREES)),
        *_throttle_regimes(trial, model),
        _with_round_edges("voltage", "V", trial.voltage, trial, 6),
        _with_round_edges("time", "s", trial.time, trial, 15),
        _with_round_edges("north", "m", trial.eta[:, Eta.NORTH], trial, 10),
        _with_round_edges("east", "m", trial.eta[:, Eta.EAST], trial, 10),
    ]
    return tuple(regime for regime in found if regime is not None)


def _throttle_regimes(trial: Trial, model: Model) -> tuple[Regime, ...]:
    """Mean throttle, and how hard the most reversed thruster runs astern."""
    count = len(model.vessel.thrusters)
    if count == 0:
        return ()
    commands = vessel_commands(model, trial)[:, :count]
    astern = np.maximum(-commands, 0.0).max(axis=1)
    return (
        Regime("throttle", "1", commands.mean(axis=1), THROTTLE_EDGES, ("", 1.0)),
        Regime("reverse", "1", astern, REVERSE_EDGES, ("", 1.0)),
    )


def _with_round_edges(
    by: str, unit: str, value: Floats, trial: Trial, max_bins: int,
    display: tuple[str, float] | None = None,
) -> Regime | None:  # fmt: skip
    """A regime whose edges are round numbers of the unit shown; None where nothing is known."""
    name, factor = display or (unit, 1.0)
    known = value[trial.usable & np.isfinite(value)] * factor
    if len(known) == 0:
        return None
    return Regime(by, unit, value, round_edges(known, max_bins) / factor, (name, factor))


def round_edges(values: Floats, max_bins: int) -> Floats:
    """Values (n,) -> at most about `max_bins` bins with round edges (m+1,) around them all.

    The bins are equal, cut for the middle 98 % of the values; the outermost two reach to the rest.
    """
    low, high = (float(q) for q in np.quantile(values, [0.01, 0.99]))
    width = max((high - low) / max_bins, 1e-9 * max(abs(high), abs(low)), 1e-6)
    power = 10.0 ** np.floor(np.log10(width))
    step = power * ROUND_STEPS[np.searchsorted(ROUND_STEPS, width / power - 1e-9)]
    first, last = np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9)
    edges = step * np.arange(first, max(last, first + 1) + 1)
    edges[0] = min(edges[0], step * np.floor(values.min() / step))
    edges[-1] = max(edges[-1], step * np.ceil(values.max() / step))
    return np.asarray(edges)


def bin_sentence(
    regime: Regime, start: float, end: float, share: float, time_share: float, mean: Triple,
    rmse: Triple, scales: Floats, noise: Floats,
) -> str:  # fmt: skip
    """The bin, its share of the squared error and of the time, and what the boat does there."""
    return (
        f"{_bin_name(regime, start, end)}: {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time; {_tendency(mean, rmse, scales, noise)}"
    )


def _bin_name(regime: Regime, start: float, end: float) -> str:
    unit, factor = regime.display
    if regime.by == "heading":
        k = round(start * DEGREES / 45.0)
        ends = f"{COMPASS[k % 8]} and {COMPASS[(k + 1) % 8]}"
        return f"heading between {ends} ({start * DEGREES:.0f}–{end * DEGREES:.0f}°)"
    if regime.by == "reverse" and start == 0.0:
        return "no thruster astern"
    if regime.by in ("throttle", "reverse"):
        return f"{NAMES[regime.by]} {_number(100 * start)} to {_number(100 * end)} %"
    span = f"{_number(start * factor)} to {_number(end * factor)}" + (f" {unit}" if unit else "")
    return f"{NAMES[regime.by]} {span}"


def place_sentence(north: float, east: float, size: float, share: float, time_share: float) -> str:
    """A square of the map, its side and the middle of it in metres from the local origin."""
    return (
        f"around {abs(north):.0f} m {'north' if north >= 0.0 else 'south'}, "
        f"{abs(east):.0f} m {'east' if east >= 0.0 else 'west'} "
        f"of the origin ({size:.0f} m square): {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time"
    )


def _tendency(mean: Triple, rmse: Triple, scales: Floats, noise: Floats) -> str:
    """Mean and rms error of u, v, r, and what noise alone shows -> which way the boat differs from
    the model, in the channel that is furthest beyond its noise.
    """
    worst = telling_channel(np.array(mean), np.array(rmse), scales, noise)
    size, factor, unit = rmse[worst], *((DEGREES, "°/s") if worst == 2 else (1.0, "m/s"))
    if abs(mean[worst]) < MIN_BIAS * size:
        return f"errors of {_plain(size * factor)} {unit} in {CHANNELS[worst]}, either way"
    verb = "turns" if worst == 2 else "moves"
    direction = DIRECTIONS[worst][0 if mean[worst] > 0 else 1]
    off = _plain(abs(mean[worst]) * factor)
    return f"the boat {verb} {off} {unit} {direction} than the model"


def _plain(value: float) -> str:
    """Two digits that count, and no power of ten."""
    return np.format_float_positional(float(f"{value:.2g}"), trim="-")


def telling_channel(mean: Floats, rmse: Floats, scales: Floats, noise: Floats) -> int:
    """Of u, v, r the one with the most error beyond noise; one that errs one way and nearly as much
    says more than one that errs either way. Ahead and sideways go by one scale: a boat that is
    4 m/s too slow is not told as 0.1 m/s to port, however little she slips.
    """
    scale = np.array([scales[:2].max(), scales[:2].max(), scales[2]])
    beyond = np.sqrt(np.maximum(rmse**2 - (NOISE_IN_A_BIN * noise) ** 2, 0.0)) / scale
    if not beyond.any():
        return int(np.argmax(rmse / scale))
    is_steady = (np.abs(mean) >= MIN_BIAS * rmse) & (beyond > 0.0)
    steady = np.where(is_steady, np.abs(mean) / scale, 0.0)
    told = steady if beyond[is_steady].max(initial=0.0) >= MIN_STEADY * beyond.max() else beyond
    return int(np.argmax(told))


def _number(value: float) -> str:
    return f"{round(value, 6) + 0.0:g}".replace("-", "−")


MAX_CELLS = 20  # of the error map along the longer side of the track
# When a square of the map is named as the worst place (both chosen, not measured).
MAX_TIME_SHARE = 0.3  # of the time spent in it: more is no place
MIN_ERROR_RATIO = 2.0  # its share of the error over its share of the time


class _ErrorShare:
    """A part of a trial: its share of the squared error and of the predicted time."""

    share: float
    time_share: float

    @property
    def excess(self) -> float:
        """Share of the error beyond the share of the time."""
        return self.share - self.time_share


@dataclass(frozen=True)
class Bin(_ErrorShare):
    """One bin of one regime.

    share, time_share   of the total squared error (in the nrmse scales) and of the predicted time
    seconds             of the trial that lie in the bin
    mean, rmse          error of u, v, r [m/s, m/s, rad/s], measured − model
    missing             mean missing force X, Y, N [N, N, N m] over the usable rows
    missing_std         of one row, from the estimate's covariance
    missing_spread      standard deviation of the missing force within the bin
    """

    by: str
    start: float
    end: float
    unit: str
    share: float
    time_share: float
    seconds: float
    mean: Triple
    rmse: Triple
    missing: Triple
    missing_std: Triple
    missing_spread: Triple
    sentence: str

    def to_row(self) -> dict[str, Any]:
        """The bin as a row of a table, one column for each number."""
        row = self.to_dict() | {"time_share": self.time_share, "seconds": self.seconds}
        for name in ("mean", "rmse", "missing", "missing_std", "missing_spread"):
            axes = "XYN" if name.startswith("missing") else "uvr"
            values = zip(axes, getattr(self, name), strict=True)
            row |= {f"{name}_{axis}": value for axis, value in values}
        return row

    def to_dict(self) -> dict[str, Any]:
        """One entry of `where` in `shadow compare --json`."""
        return {"by": self.by, "from": self.start, "to": self.end, "unit": self.unit,
                "share": self.share, "says": self.sentence}  # fmt: skip


@dataclass(frozen=True)
class ErrorMap:
    """The error on the map, in square cells.

    size         side of a cell [m]
    corner       (c, 2)  south-west corner: north, east [m]
    share        (c,)    of the total squared error
    time_share   (c,)    of the predicted time
    mean         (c, 3)  error of u, v, r
    """

    size: float
    corner: Floats
    share: Floats
    time_share: Floats
    mean: Floats


@dataclass(frozen=True)
class Place(_ErrorShare):
    """A square of the map: its middle north, east and its side [m], and its shares."""

    north: float
    east: float
    size: float
    share: float
    time_share: float

    def to_dict(self) -> dict[str, Any]:
        """`place` in `shadow compare --json`."""
        sentence = place_sentence(self.north, self.east, self.size, self.share, self.time_share)
        return {"north_m": self.north, "east_m": self.east, "size_m": self.size,
                "share": self.share, "time_share": self.time_share, "says": sentence}  # fmt: skip


def worst_place(cells: ErrorMap) -> Place | None:
    """The three by three cells that hold the most error beyond their share of time.

    None on a track so small that this would be all of it, or where the rest is as bad.
    """
    number = np.round(cells.corner / cells.size).astype(np.int64)
    near = np.abs(number[:, None] - number[None]).max(axis=2) <= 1
    share, time = near @ cells.share, near @ cells.time_share
    k = int(np.argmax(share - time))
    if time[k] >= MAX_TIME_SHARE or share[k] < MIN_ERROR_RATIO * time[k]:
        return None
    north, east = (cells.corner[k] + 0.5 * cells.size).tolist()
    return Place(north, east, 3.0 * cells.size, float(share[k]), float(time[k]))


def error_bins(
    trial: Trial, regimes: tuple[Regime, ...], prediction: Prediction, force: MissingForce,
    scales: Floats, noise: Floats,
) -> tuple[Bin, ...]:  # fmt: skip
    """All bins that hold anything, those with the most error beyond their share of time first;
    noise (3,): what it alone shows of u, v, r [m/s, m/s, rad/s].
    """
    _, rows, error = prediction.predicted_rows()
    squares = scaled_squares(error, scales)
    total = max(float(squares.sum()), 1e-300)
    numbers = [(regime, bin_of(regime.value, regime.edges)) for regime in regimes]
    bins = [(regime, n, k) for regime, n in numbers for k in np.unique(n[rows]) if k >= 0]
    out = []
    for regime, number, k in bins:
        inside, usable = number[rows] == k, trial.usable & (number == k)
        part, missing = error[inside][:, 3:], force.force[usable]
        share, time_share = float(squares[inside].sum()) / total, float(inside.mean())
        mean, rmse = _triple(part.mean(axis=0)), _triple(np.sqrt(np.mean(part**2, axis=0)))
        start, end = float(regime.edges[k]), float(regime.edges[k + 1])
        out.append(
            Bin(
                regime.by, start, end, regime.unit, share, time_share,
                seconds=float(np.count_nonzero(usable)) * trial.dt, mean=mean, rmse=rmse,
                missing=_triple(missing.mean(axis=0)),
                missing_std=_triple(np.sqrt(np.mean(force.std[usable] ** 2, axis=0))),
                missing_spread=_triple(missing.std(axis=0)),
                sentence=bin_sentence(
                    regime, start, end, share, time_share, mean, rmse, scales, noise
                ),
            )
        )  # fmt: skip
    return tuple(sorted(out, key=lambda b: -b.excess))


def bin_of(value: Floats, edges: Floats) -> Ints:
    """Values (T,), edges (n+1,) -> number of the bin (T,), −1 where there is none."""
    inside = (value >= edges[0]) & (value <= edges[-1])  # NaN is in no bin
    k = np.clip(np.searchsorted(edges, value, side="right") - 1, 0, len(edges) - 2)
    return np.where(inside, k, -1).astype(np.int64)


def _triple(values: NDArray[np.float64]) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])


def error_map(trial: Trial, prediction: Prediction, scales: Floats) -> ErrorMap:
    """The error on a grid over the map."""
    _, rows, error = prediction.predicted_rows()
    position = trial.eta[rows][:, : Eta.YAW]
    extent = position.max(axis=0) - position.min(axis=0)
    edges = round_edges(np.array([0.0, max(float(extent.max()), 1.0)]), MAX_CELLS)
    size = float(edges[1] - edges[0])
    cells, number = np.unique(np.floor(position / size), axis=0, return_inverse=True)
    number = number.reshape(-1)
    squares, count = scaled_squares(error, scales), np.bincount(number)
    return ErrorMap(
        size,
        cells * size,
        np.bincount(number, squares) / max(float(squares.sum()), 1e-300),
        count / len(rows),
        np.stack([np.bincount(number, error[:, i]) / count for i in (3, 4, 5)], axis=1),
    )


def along_trial(prediction: Prediction, scales: Floats, length: int) -> Floats:
    """Root mean square scaled error on every row of the trial (T,); NaN where none was run."""
    _, rows, error = prediction.predicted_rows()
    count = np.bincount(rows, minlength=length)
    total = np.bincount(rows, scaled_squares(error, scales), minlength=length)
    return np.sqrt(np.divide(total, count, out=np.full(length, np.nan), where=count > 0))
