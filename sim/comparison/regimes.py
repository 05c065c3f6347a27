"""Regimes that the error is binned by (speed, turn rate, heading, throttle, time, …), in words too.

A regime gives every row of the trial a value and cuts the values into bins with round edges, in
the unit that people read. Edges are half open, [from, to); the last bin keeps its end. Each bin
has one sentence for a boat's owner: degrees, m/s, per cent, with units.
"""

from dataclasses import dataclass

import numpy as np

from sim.model import Model
from sim.prediction.inputs import vessel_commands
from sim.state import Eta, Floats, Nu
from sim.trial import Trial

DEGREES = 180.0 / np.pi
UNDER_WAY_MPS = 0.2  # below this speed a drift angle means nothing; chosen, not measured
MIN_BIAS = 0.3  # mean error over rms error: less is no tendency; chosen, not measured
THROTTLE_EDGES = np.array([-1.0, -0.75, -0.5, -0.25, -0.05, 0.05, 0.25, 0.5, 0.75, 1.0])
REVERSE_EDGES = np.array([0.0, 0.05, 0.25, 0.5, 0.75, 1.0])
ROUND_STEPS = np.array([1.0, 2.0, 2.5, 5.0, 10.0])
COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
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
    rmse: Triple, scales: Floats,
) -> str:  # fmt: skip
    """The bin, its share of the squared error and of the time, and what the boat does there."""
    return (
        f"{_bin_name(regime, start, end)}: {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time; {_tendency(mean, rmse, scales)}"
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


def _tendency(mean: Triple, rmse: Triple, scales: Floats) -> str:
    """Mean and rms error of u, v, r -> which way the boat differs from the model."""
    worst = int(np.argmax(np.array(rmse) / scales))
    size, factor, unit = rmse[worst], *((DEGREES, "°/s") if worst == 2 else (1.0, "m/s"))
    if abs(mean[worst]) < MIN_BIAS * size:
        return f"errors of {size * factor:.2g} {unit} in {CHANNELS[worst]}, either way"
    verb = "turns" if worst == 2 else "moves"
    direction = DIRECTIONS[worst][0 if mean[worst] > 0 else 1]
    return f"the boat {verb} {abs(mean[worst]) * factor:.2g} {unit} {direction} than the model"


def _number(value: float) -> str:
    return f"{round(value, 6) + 0.0:g}".replace("-", "−")
