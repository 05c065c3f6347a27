"""Where the error is: its share, its mean and the missing force in every bin of every regime."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.comparison.regimes import Regime, Triple, bin_sentence, place_sentence, round_edges
from sim.prediction.free_runs import Prediction
from sim.prediction.missing_force import MissingForce
from sim.prediction.scores import scaled_squares
from sim.state import Eta, Floats, Ints
from sim.trial import Trial

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
    scales: Floats,
) -> tuple[Bin, ...]:  # fmt: skip
    """All bins that hold anything, those with the most error beyond their share of time first."""
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
                sentence=bin_sentence(regime, start, end, share, time_share, mean, rmse, scales),
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
