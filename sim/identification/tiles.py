"""Usable time cut into free runs that share no row, each no longer than its start allows.

An error of the start grows on a hull that is unstable on course. Where it would grow beyond a
limit the run is halved, and halved again: no time is lost, and no run leaves the track.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis.blocks import stretches
from sim.diagnosis.inputs import inputs_of, motion_of, runs_from
from sim.model import Model
from sim.state import Floats, Ints
from sim.trial import Trial

SHORTEST = 3  # means in a run: fewer say little beside its start
STEP = np.array([1e-3, 1e-3, 1e-3])  # m/s, m/s, rad/s


class Tiles(NamedTuple):
    """Free runs over rows first … first + size − 1 of a trial, each (S,)."""

    first: Ints
    size: Ints


def tiles_of(
    trial: Trial,
    usable: NDArray[np.bool_],
    model: Model,
    length: float,
    growth: float,
    every: int,
) -> Tiles:
    """Tiles of `length` [s], shorter where a start's error would grow by more than `growth`.

    All hold a multiple of `every` rows.
    """
    tiles = cut(usable, max(round(length / trial.dt / every), SHORTEST), every)
    while True:
        long = (grown(trial, model, tiles) > growth) & (tiles.size >= 2 * SHORTEST * every)
        if not long.any():
            return tiles
        tiles = halved(tiles, long, every)


def cut(usable: NDArray[np.bool_], means: int, every: int) -> Tiles:
    """Stretches into tiles of about `means` times `every` rows; a rest too short is left out."""
    first: list[int] = []
    count: list[int] = []
    for stretch in stretches(usable):
        room = len(stretch) // every
        if room < SHORTEST:
            continue
        edges = np.linspace(0, room, max(round(room / means), 1) + 1)
        whole = stretch.start + every * np.round(edges).astype(int)
        first += whole[:-1].tolist()
        count += np.diff(whole).tolist()
    return Tiles(np.array(first, np.int64), np.array(count, np.int64))


def halved(tiles: Tiles, which: NDArray[np.bool_], every: int) -> Tiles:
    """The same time with some tiles in two."""
    half = tiles.size // (2 * every) * every
    first = np.concatenate([tiles.first, (tiles.first + half)[which]])
    count = np.concatenate([np.where(which, half, tiles.size), (tiles.size - half)[which]])
    order = np.argsort(first)
    return Tiles(first[order], count[order])


def grown(trial: Trial, model: Model, tiles: Tiles) -> Floats:
    """How much an error of the start has grown at most, channel by channel's own size: (S,)."""
    motion = np.repeat(motion_of(trial)[tiles.first], 4, axis=0)
    for i in range(3):
        motion[i + 1 :: 4, 3 + i] += STEP[i]
    runs = runs_from(np.repeat(tiles.first, 4), np.repeat(tiles.size - 1, 4))
    _, reports = model.run(model.true_states(motion), runs, inputs_of(model, trial))
    nu = reports[..., 3:6].reshape(len(tiles.first), 4, -1, 3)
    gain = np.abs(nu[:, 1:] - nu[:, :1]) / STEP[None, :, None, None]
    within = np.arange(nu.shape[2]) < tiles.size[:, None]
    lost = within & ~np.isfinite(nu).all(axis=(1, 3))
    gain = np.where(within[:, None, :, None], gain, 0.0)
    return np.where(lost.any(axis=1), np.inf, np.nan_to_num(gain, nan=0.0).max(axis=(1, 2, 3)))


def thinned(tiles: Tiles, rows: int) -> Tiles:
    """Every so many of the tiles, so that about `rows` rows are left."""
    step = max(round(int(tiles.size.sum()) / rows), 1)
    return Tiles(tiles.first[::step], tiles.size[::step])
