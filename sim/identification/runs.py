"""Usable time cut into free runs that share no row, each no longer than its start allows.

An error of the start grows on a hull that is unstable on course. Where it would grow beyond a
limit the run is halved, and halved again: no time is lost, and no run leaves the track.

What nobody said: when, between two messages, a command changed.

    x_{j+1} = F_j x_j + Σ_k M⁻¹ Δτ_k δ_k,     δ_k ~ N(0, σ²) [s]

Commands hold from message to message, so a change of force Δτ that was in fact δ earlier gives the
boat a jolt M⁻¹ Δτ δ that the model does not have, and the boat carries it on: by F over a step.
At 25 messages a second that is ten times what a gyro errs by. It is no error of the model: the
covariance of x is part of what the motion may be off by. (Process noise from the input: Åström,
Introduction to Stochastic Control Theory, 1970, ch. 3.)

Commands that can be shifted by part of a row without becoming rounder.

    c'_k = c_k − κ (c_{k+1} − 2 c_k + c_{k−1}),     κ = ½ f (1 − f)

A shift by the share f of a row takes f of one mean and 1 − f of its neighbour: it spreads each
change by √(f (1 − f)) rows. Taken for the boat's own sluggishness that makes a hull turn in a
third of a per cent too quickly. κ takes the second moment of that spread out again.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.model import InputTable, Model
from sim.prediction.inputs import (
    delayed_commands,
    input_table,
    measured_motion,
    runs_from,
    vessel_commands,
)
from sim.prediction.segments import usable_stretches
from sim.state import Floats, Ints
from sim.trial import Trial

SHORTEST = 3  # means in a run: fewer say little beside its start
START_STEP = np.array([1e-3, 1e-3, 1e-3])  # m/s, m/s, rad/s


class RunRows(NamedTuple):
    """Free runs over rows first … first + size − 1 of a trial, each (S,)."""

    first: Ints
    size: Ints


def run_rows_of(
    trial: Trial,
    usable: NDArray[np.bool_],
    model: Model,
    length: float,
    growth: float,
    every: int,
) -> RunRows:
    """Tiles of `length` [s], shorter where a start's error would grow by more than `growth`.

    All hold a multiple of `every` rows.
    """
    tiles = divided(usable, max(round(length / trial.dt / every), SHORTEST), every)
    while True:
        long = (start_error_growth(trial, model, tiles) > growth) & (
            tiles.size >= 2 * SHORTEST * every
        )
        if not long.any():
            return tiles
        tiles = halved(tiles, long, every)


def divided(usable: NDArray[np.bool_], means: int, every: int) -> RunRows:
    """Stretches into tiles of about `means` times `every` rows; a rest too short is left out."""
    first: list[int] = []
    count: list[int] = []
    for stretch in usable_stretches(usable):
        room = len(stretch) // every
        if room < SHORTEST:
            continue
        edges = np.linspace(0, room, max(round(room / means), 1) + 1)
        whole = stretch.start + every * np.round(edges).astype(int)
        first += whole[:-1].tolist()
        count += np.diff(whole).tolist()
    return RunRows(np.array(first, np.int64), np.array(count, np.int64))


def halved(tiles: RunRows, which: NDArray[np.bool_], every: int) -> RunRows:
    """The same time with some tiles in two."""
    half = tiles.size // (2 * every) * every
    first = np.concatenate([tiles.first, (tiles.first + half)[which]])
    count = np.concatenate([np.where(which, half, tiles.size), (tiles.size - half)[which]])
    order = np.argsort(first)
    return RunRows(first[order], count[order])


def start_error_growth(trial: Trial, model: Model, tiles: RunRows) -> Floats:
    """How much an error of the start has grown at most, channel by channel's own size: (S,)."""
    motion = np.repeat(measured_motion(trial)[tiles.first], 4, axis=0)
    for i in range(3):
        motion[i + 1 :: 4, 3 + i] += START_STEP[i]
    runs = runs_from(np.repeat(tiles.first, 4), np.repeat(tiles.size - 1, 4))
    _, reports = model.run(model.true_states(motion), runs, input_table(model, trial))
    nu = reports[..., 3:6].reshape(len(tiles.first), 4, -1, 3)
    gain = np.abs(nu[:, 1:] - nu[:, :1]) / START_STEP[None, :, None, None]
    within = np.arange(nu.shape[2]) < tiles.size[:, None]
    lost = within & ~np.isfinite(nu).all(axis=(1, 3))
    gain = np.where(within[:, None, :, None], gain, 0.0)
    return np.where(lost.any(axis=1), np.inf, np.nan_to_num(gain, nan=0.0).max(axis=(1, 2, 3)))


def thinned(tiles: RunRows, rows: int) -> RunRows:
    """Every so many of the tiles, so that about `rows` rows are left."""
    step = max(round(int(tiles.size.sum()) / rows), 1)
    return RunRows(tiles.first[::step], tiles.size[::step])


NU = slice(3, 6)
SLOWEST = 0.5  # Hz


def command_timing_covariance(
    trial: Trial, model: Model, tiles: RunRows, every: int, means: int, track: Floats
) -> Floats | None:
    """Covariance (S, 3n, 3n) of n means of u, v, r in each run: a message interval's, uniform.

    None where nobody knows how often commands were told.
    """
    if "commands" not in trial.rates_hz:
        return None
    rows = tiles.first[:, None] + every * np.arange(means)
    last = len(trial) - every - 1
    step = _carried(trial, model, np.minimum(rows, last), every, track)
    each = _kicks(trial, model) / np.sqrt(12.0)
    within = np.minimum(rows[..., None] + np.arange(every), len(trial) - 1)
    kick = np.einsum("sjki,sjkl->sjil", each[within], each[within])
    return _summed(step, kick).reshape(len(rows), 3 * means, 3 * means)


def _summed(step: Floats, kick: Floats) -> Floats:
    """F (S, n, 3, 3), Σ q qᵀ (S, n, 3, 3) of each mean -> covariance (S, n, 3, n, 3)."""
    S, n = kick.shape[:2]
    out = np.zeros((S, n, 3, n, 3))
    now = 0.5 * kick[:, 0]
    out[:, 0, :, 0] = now
    for j in range(1, n):
        F, new = step[:, j - 1], 0.5 * (kick[:, j - 1] + kick[:, j])
        before = np.einsum("sab,sbic->saic", F, out[:, j - 1, :, :j])
        out[:, j, :, :j] = before
        out[:, :j, :, j] = np.moveaxis(before, (1, 2, 3), (3, 1, 2))
        now = F @ now @ np.swapaxes(F, 1, 2) + new
        out[:, j, :, j] = now
    return out


def _carried(trial: Trial, model: Model, rows: Floats, every: int, track: Floats) -> Floats:
    """∂ velocity after `every` rows / ∂ velocity at rows (S, n): (S, n, 3, 3)."""
    flat = rows.reshape(-1)
    motion = np.repeat(track[flat], 4, axis=0)
    for i in range(3):
        motion[i + 1 :: 4, 3 + i] += START_STEP[i]
    runs = runs_from(np.repeat(flat, 4), np.full(len(motion), every, np.int64))
    _, reports = model.run(model.true_states(motion), runs, input_table(model, trial))
    nu = reports[:, every, NU].reshape(len(flat), 4, 3)
    F = np.swapaxes((nu[:, 1:] - nu[:, :1]) / START_STEP[:, None], 1, 2)
    return np.clip(np.nan_to_num(F), -2.0, 2.0).reshape(*rows.shape, 3, 3)


def _kicks(trial: Trial, model: Model) -> Floats:
    """M⁻¹ Δτ T: change of velocity (T, 3) if a row's commands had come a message earlier."""
    commands = delayed_commands(vessel_commands(model, trial), trial.dt, model.delay)
    before = np.vstack([commands[:1], commands[:-1]])
    _, tau = model.missing_force(
        measured_motion(trial), trial.time, before, commands, voltage=trial.voltage, wind=trial.wind
    )
    mass = model.theta[[model.names.index(name) for name in ("m11", "m22", "m33")]]
    interval = 1.0 / max(trial.rates_hz["commands"], SLOWEST)
    change = np.diff(tau, axis=0, prepend=tau[:1])
    return np.nan_to_num(change) / mass * interval


def sharpening_factor(shift: float, dt: float) -> float:
    """κ of a shift [s]."""
    share = shift / dt % 1.0
    return 0.5 * share * (1.0 - share)


def sharpened_commands(inputs: InputTable, kappa: float) -> InputTable:
    """The same inputs with commands that make up for the spread."""
    commands = np.diff(inputs.total, axis=1)
    bend = np.zeros_like(commands)
    bend[:, 1:-1] = commands[:, 2:] - 2.0 * commands[:, 1:-1] + commands[:, :-2]
    total = np.zeros_like(inputs.total)
    np.cumsum(commands - kappa * bend, axis=1, out=total[:, 1:])
    return replace(inputs, total=total)
