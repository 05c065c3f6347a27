"""What the error may depend on: speed, turn rate, drift, heading, throttle, voltage, time, place.

A regime gives every row of the trial a value and cuts the values into bins with round edges, in
the unit that people read. Edges are half open, [from, to); the last bin keeps its end.

A bin in one sentence that a boat's owner understands: degrees, m/s, per cent, with units.
"""

from dataclasses import dataclass

import numpy as np

from sim.model import Model
from sim.prediction.inputs import commands_of
from sim.state import Eta, Floats, Nu
from sim.trial import Trial

DEGREES = 180.0 / np.pi
UNDER_WAY = 0.2  # m/s: below this the direction of motion means nothing
THROTTLE = np.array([-1.0, -0.75, -0.5, -0.25, -0.05, 0.05, 0.25, 0.5, 0.75, 1.0])
REVERSE = np.array([0.0, 0.05, 0.25, 0.5, 0.75, 1.0])
ROUND = np.array([1.0, 2.0, 2.5, 5.0, 10.0])


@dataclass(frozen=True)
class Regime:
    """One variable over the trial.

    by      its name            unit   of values and edges (SI)
    value   (T,) NaN where it does not apply
    edges   (n+1,) ascending
    shown   unit that people read, and how many of it make one SI unit
    """

    by: str
    unit: str
    value: Floats
    edges: Floats
    shown: tuple[str, float]


def regimes_of(trial: Trial, model: Model) -> tuple[Regime, ...]:
    """Everything the error is binned by; throttle and reverse as the first vessel reads them."""
    u, v, r = trial.nu[:, Nu.U], trial.nu[:, Nu.V], trial.nu[:, Nu.R]
    speed = np.hypot(u, v)
    drift = np.where(speed > UNDER_WAY, np.arctan2(v, u), np.nan)
    heading = trial.eta[:, Eta.YAW] % (2.0 * np.pi)
    found = [
        _rounded("speed", "m/s", speed, trial, 8),
        _rounded("turn_rate", "rad/s", r, trial, 9, ("°/s", DEGREES)),
        _rounded("drift_angle", "rad", drift, trial, 9, ("°", DEGREES)),
        Regime("heading", "rad", heading, np.linspace(0.0, 2.0 * np.pi, 9), ("°", DEGREES)),
        *_driven(trial, model),
        _rounded("voltage", "V", trial.voltage, trial, 6),
        _rounded("time", "s", trial.time, trial, 15),
        _rounded("north", "m", trial.eta[:, Eta.NORTH], trial, 10),
        _rounded("east", "m", trial.eta[:, Eta.EAST], trial, 10),
    ]
    return tuple(regime for regime in found if regime is not None)


def _driven(trial: Trial, model: Model) -> tuple[Regime, ...]:
    """Mean throttle, and how hard the most reversed thruster runs astern."""
    count = len(model.vessel.thrusters)
    if count == 0:
        return ()
    thrust = commands_of(model, trial)[:, :count]
    return (
        Regime("throttle", "1", thrust.mean(axis=1), THROTTLE, ("", 1.0)),
        Regime("reverse", "1", np.maximum(-thrust, 0.0).max(axis=1), REVERSE, ("", 1.0)),
    )


def _rounded(
    by: str, unit: str, value: Floats, trial: Trial, most: int,
    shown: tuple[str, float] | None = None,
) -> Regime | None:  # fmt: skip
    """A regime whose edges are round numbers of the unit shown; None where nothing is known."""
    name, factor = shown or (unit, 1.0)
    known = value[trial.usable & np.isfinite(value)] * factor
    if len(known) == 0:
        return None
    return Regime(by, unit, value, round_edges(known, most) / factor, (name, factor))


def round_edges(values: Floats, most: int) -> Floats:
    """Values (n,) -> at most about `most` bins with round edges (m+1,) around them all.

    The bins are equal, cut for the middle 98 % of the values; the outermost two reach to the rest.
    """
    low, high = (float(q) for q in np.quantile(values, [0.01, 0.99]))
    wanted = max((high - low) / most, 1e-9 * max(abs(high), abs(low)), 1e-6)
    power = 10.0 ** np.floor(np.log10(wanted))
    step = power * ROUND[np.searchsorted(ROUND, wanted / power - 1e-9)]
    first, last = np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9)
    edges = step * np.arange(first, max(last, first + 1) + 1)
    edges[0] = min(edges[0], step * np.floor(values.min() / step))
    edges[-1] = max(edges[-1], step * np.ceil(values.max() / step))
    return np.asarray(edges)


Triple = tuple[float, float, float]

COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
STEADY = 0.3  # a mean below this part of the rms is no tendency
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
MORE = (
    ("faster ahead", "slower ahead"),
    ("faster to starboard", "faster to port"),
    ("faster clockwise", "faster counter-clockwise"),
)
CHANNEL = ("surge", "sway", "turn rate")


def says(
    regime: Regime, start: float, end: float, share: float, time_share: float, mean: Triple,
    rmse: Triple, scales: Floats,
) -> str:  # fmt: skip
    """The place, its share of the squared error and of the time, and what the boat does there."""
    return (
        f"{place(regime, start, end)}: {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time; {tendency(mean, rmse, scales)}"
    )


def place(regime: Regime, start: float, end: float) -> str:
    """The bin itself, as people say it."""
    unit, factor = regime.shown
    span = f"{_number(start * factor)} to {_number(end * factor)}" + (f" {unit}" if unit else "")
    if regime.by == "heading":
        k = round(start * DEGREES / 45.0)
        ends = f"{COMPASS[k % 8]} and {COMPASS[(k + 1) % 8]}"
        return f"heading between {ends} ({start * DEGREES:.0f}–{end * DEGREES:.0f}°)"
    if regime.by == "reverse" and start == 0.0:
        return "no thruster astern"
    if regime.by in ("throttle", "reverse"):
        return f"{NAMES[regime.by]} {_number(100 * start)} to {_number(100 * end)} %"
    return f"{NAMES[regime.by]} {span}"


def at_place(north: float, east: float, size: float, share: float, time_share: float) -> str:
    """A square of the map, its side and the middle of it in metres from the local origin."""
    return (
        f"around {_from_origin(north, 'north', 'south')}, {_from_origin(east, 'east', 'west')} "
        f"of the origin ({size:.0f} m square): {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time"
    )


def _from_origin(value: float, ahead: str, back: str) -> str:
    return f"{abs(value):.0f} m {ahead if value >= 0.0 else back}"


def tendency(mean: Triple, rmse: Triple, scales: Floats) -> str:
    """Mean and rms error of u, v, r -> which way the boat differs from the model."""
    worst = int(np.argmax(np.array(rmse) / scales))
    size, factor, unit = rmse[worst], *((DEGREES, "°/s") if worst == 2 else (1.0, "m/s"))
    if abs(mean[worst]) < STEADY * size:
        return f"errors of {size * factor:.2g} {unit} in {CHANNEL[worst]}, either way"
    verb = "turns" if worst == 2 else "moves"
    direction = MORE[worst][0 if mean[worst] > 0 else 1]
    return f"the boat {verb} {abs(mean[worst]) * factor:.2g} {unit} {direction} than the model"


def _number(value: float) -> str:
    return f"{round(value, 6) + 0.0:g}".replace("-", "−")
