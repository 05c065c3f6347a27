"""What these data cannot tell, effect by effect, and what they would have to hold.

A guess on data that cannot show the thing is worse than no answer: a lag cannot be seen through
commands at 2 Hz, a compass deviation not on one heading, a loss astern not by who never went
astern.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim.effects.effect import Effect, Shown
from sim.model import Model
from sim.prediction.inputs import vessel_commands
from sim.state import Eta, Floats, Nu
from sim.trial import Trial

FAST_HZ = 5.0  # of commands and velocities, for what acts within a fraction of a second
FEWEST_SECTORS = 5  # of eight: headings all around
SECTORS = 8
OPPOSITE = 3  # sectors that tell a fixed direction in the world from one on board
LEAST_S = 60.0  # of usable time
CHANGING_S = 150.0  # for what changes as time goes by
ASTERN, ASTERN_S = -0.08, 4.0  # command, and seconds of it
SWAYED_V = 0.02  # of the voltage: less says nothing of a sagging battery


@dataclass(frozen=True)
class Refusal:
    """An effect that is not judged, and why."""

    effect: str
    because: str


@dataclass(frozen=True)
class Seen:
    """What the trials hold between them."""

    seconds: float
    longest: float
    sectors: int
    astern: float
    sag: float
    rates: Mapping[str, float]


def refused(effects: Sequence[Effect], model: Model, trials: Sequence[Trial]) -> list[Refusal]:
    """Effects that cannot be told from these trials with this vessel."""
    seen = seen_in(model, trials)
    out = []
    for effect in effects:
        lacking = model.vessel.unmet_needs(effect)
        why = (
            f"it needs {lacking} in the vessel file" if lacking else _because(effect.shown_by, seen)
        )
        if why:
            out.append(Refusal(effect.name, why))
    return out


def seen_in(model: Model, trials: Sequence[Trial]) -> Seen:
    """Seconds, headings, time astern, voltage and rates."""
    usable = [t.usable for t in trials]
    headings = np.concatenate([t.eta[k, Eta.YAW] for t, k in zip(trials, usable, strict=True)])
    speed = np.concatenate([np.abs(t.nu[k, Nu.U]) for t, k in zip(trials, usable, strict=True)])
    moving = headings[speed > 0.2]
    sector = (moving % (2.0 * np.pi) // (2.0 * np.pi / SECTORS)).astype(int)
    share = np.bincount(sector, minlength=SECTORS) / max(len(sector), 1)
    motors = len(model.vessel.thrusters)
    astern = sum(
        float(np.any(vessel_commands(model, t)[k, :motors] < ASTERN, axis=1).sum()) * t.dt
        for t, k in zip(trials, usable, strict=True)
    )
    volts: Floats = np.concatenate([t.voltage[k] for t, k in zip(trials, usable, strict=True)])
    volts = volts[np.isfinite(volts)]
    sag = float(np.std(volts) / np.mean(volts)) if len(volts) > 1 else 0.0
    rates: dict[str, float] = {}
    for t in trials:
        for name, rate in t.rates_hz.items():
            rates[name] = min(rate, rates.get(name, np.inf))
    seconds = [float(t.usable.sum()) * t.dt for t in trials]
    return Seen(
        sum(seconds), max(seconds), int(np.sum(share > 0.01)), astern, sag, rates
    )  # fmt: skip


def _because(shown_by: Sequence[Shown], seen: Seen) -> str:
    """Why not, in words; empty where nothing stands against it."""
    return next(filter(None, (_lacks(shown, seen) for shown in shown_by)), "")


def _lacks(shown: Shown, seen: Seen) -> str:
    """What the trials lack of one thing that has to be shown."""
    match shown:
        case Shown.COMMANDS:
            return _slow("commands", seen)
        case Shown.VELOCITY:
            return _slow("velocity", seen)
        case Shown.CHANGE if seen.longest < CHANGING_S:
            return f"{seen.longest:.0f} s: {CHANGING_S:.0f} s are needed to tell a change in time"
        case Shown.ASTERN if seen.astern < ASTERN_S:
            return f"motors ran astern for {seen.astern:.0f} s: go astern, and brake from speed"
        case Shown.CIRCLES if seen.sectors < FEWEST_SECTORS:
            return f"headings in {seen.sectors} of {SECTORS} sectors: sail full circles"
        case Shown.OPPOSITE if seen.sectors < OPPOSITE:
            return f"headings in {seen.sectors} of {SECTORS} sectors: sail opposite headings"
        case Shown.VOLTAGE if seen.sag < SWAYED_V:
            known = "hardly changed" if seen.sag > 0.0 else "was not measured"
            return f"the voltage {known}: a run on a full and on a tired battery is needed"
    return ""


def _slow(quantity: str, seen: Seen) -> str:
    rate = seen.rates.get(quantity, np.inf)
    return (
        f"{quantity} at {rate:.1f} Hz: {FAST_HZ:g} Hz are needed to tell it"
        if rate < FAST_HZ
        else ""
    )
