"""Effects that these data cannot show, and what a recording would have to hold.

A guess on data that cannot show the thing is worse than no answer: a lag cannot be seen through
commands at 2 Hz, a compass deviation not on one heading, a loss astern not on a voyage ahead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim.diagnosis import thresholds
from sim.effects.effect import Effect, Shown
from sim.model import Model
from sim.prediction.inputs import vessel_commands
from sim.state import Eta, Floats, Nu
from sim.trial import Trial
from sim.vessel import Vessel


@dataclass(frozen=True)
class Refusal:
    """An effect that is not judged, and why."""

    effect: str
    reason: str


@dataclass(frozen=True)
class RecordingContent:
    """What the trials hold between them.

    seconds, longest   of usable time in all, and in one trial
    sectors            of eight, that headings under way lie in
    astern             s with a motor astern
    voltage_variation  standard deviation over mean; 0 where it was not measured
    rates_hz           the lowest of each stream
    """

    seconds: float
    longest: float
    sectors: int
    astern: float
    voltage_variation: float
    rates_hz: Mapping[str, float]

    @classmethod
    def of(cls, model: Model, trials: Sequence[Trial]) -> "RecordingContent":
        """Of the usable rows."""
        eta, nu = (np.concatenate([getattr(t, k)[t.usable] for t in trials]) for k in ("eta", "nu"))
        heading = eta[np.abs(nu[:, Nu.U]) > thresholds.MIN_UNDER_WAY_MPS, Eta.YAW] % (2.0 * np.pi)
        sector = (heading // (2.0 * np.pi / thresholds.HEADING_SECTORS)).astype(int)
        share = np.bincount(sector, minlength=thresholds.HEADING_SECTORS) / max(len(sector), 1)
        motors = len(model.vessel.thrusters)
        commands = [vessel_commands(model, t)[t.usable, :motors] for t in trials]
        astern = [np.any(c < thresholds.ASTERN_COMMAND, axis=1).sum() for c in commands]
        volts: Floats = np.concatenate([t.voltage[t.usable] for t in trials])
        volts = volts[np.isfinite(volts)]
        measured = len(volts) > 1 and np.mean(volts) > 0.0
        rates: dict[str, float] = {}
        for t in trials:
            for name, rate in t.rates_hz.items():
                rates[name] = min(rate, rates.get(name, np.inf))
        seconds = [float(t.usable.sum()) * t.dt for t in trials]
        return cls(
            sum(seconds), max(seconds), int(np.sum(share > thresholds.MIN_SECTOR_SHARE)),
            sum(float(rows) * t.dt for rows, t in zip(astern, trials, strict=True)),
            float(np.std(volts) / np.mean(volts)) if measured else 0.0, rates,
        )  # fmt: skip


def refusals(effects: Sequence[Effect], content: RecordingContent, vessel: Vessel) -> list[Refusal]:
    """Effects that cannot be told from recordings of this content with this vessel, and why."""
    out = []
    for effect in effects:
        lacking = vessel.unmet_needs(effect)
        reasons = [f"it needs {lacking} in the vessel file" if lacking else ""]
        reasons += [_missing_from(content, shown) for shown in effect.shown_by]
        if reason := next(filter(None, reasons), ""):
            out.append(Refusal(effect.name, reason))
    return out


def _missing_from(content: RecordingContent, shown: Shown) -> str:
    """What the trials lack of one thing that has to be shown, in words; empty where nothing."""
    sectors = f"headings in {content.sectors} of {thresholds.HEADING_SECTORS} sectors"
    match shown:
        case Shown.COMMANDS | Shown.VELOCITY:
            name = "commands" if shown is Shown.COMMANDS else "velocity"
            rate, needed = content.rates_hz.get(name, np.inf), thresholds.MIN_RATE_HZ
            if rate < needed:
                return f"{name} at {rate:.1f} Hz: {needed:g} Hz are needed to tell it"
        case Shown.CHANGE if content.longest < thresholds.MIN_CHANGE_S:
            needed = thresholds.MIN_CHANGE_S
            return f"{content.longest:.0f} s: {needed:.0f} s are needed to tell a change in time"
        case Shown.ASTERN if content.astern < thresholds.MIN_ASTERN_S:
            astern = f"{content.astern:.0f} s"
            return f"motors ran astern for {astern}: go astern, and brake from speed"
        case Shown.CIRCLES if content.sectors < thresholds.MIN_SECTORS_FOR_CIRCLES:
            return f"{sectors}: sail full circles"
        case Shown.OPPOSITE if content.sectors < thresholds.MIN_SECTORS_FOR_OPPOSITE:
            return f"{sectors}: sail opposite headings"
        case Shown.VOLTAGE if content.voltage_variation < thresholds.MIN_VOLTAGE_VARIATION:
            known = "hardly changed" if content.voltage_variation > 0.0 else "was not measured"
            return f"the voltage {known}: a run on a full and on a tired battery is needed"
    return ""
