"""Events of the path in words: changes of telemetry, reference and limits, jumps, unusual forces.

A missing force is unusual when its mean over a block of a few seconds lies far outside the blocks
of the last minutes (median and spread). Blocks, since the rows of a filter are correlated over
seconds. It is usual again when several blocks in a row are, and a force that is small beside the
boat's own thrust is never unusual. Unusual blocks are not remembered, so that they do not become
usual; after minutes of nothing else they do, and that is an event too. A block is judged one
block later: a sensor that fails is noticed within seconds, and what it spoilt is never judged.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import reduce
from math import isfinite, isinf
from operator import or_
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation import Flag, MeasurementKind
from gateway.estimation.filter import FilterRows
from gateway.shadow import FilterInputs
from gateway.shadow.driven import DrivenOutputs
from gateway.shadow.health import STEADY_S
from gateway.shadow.path import BROKEN, ShadowRows, discontinuous
from gateway.shadow.sensor_checks import (
    ALWAYS_WELL,
    REPORTED,
    UNDRIVEN,
    UNHEARD,
    WORDS,
    SensorFault,
    reasons_in,
    reported_well,
)
from gateway.shadow.topic_rows import EventRow
from sim.state import Floats
from sim.vessel import Vessel

# Chosen: ten minutes of a simulated boat that the model explains give no event (a slow test), an
# effect that sets in gives one within 20 s. Not measured on real boats.
FORCE_BLOCK_S = 5.0
REMEMBERED_BLOCKS = 60  # five minutes
NEEDED_BLOCKS = 12  # before anything is called unusual
UNUSUAL_STDS = 6.0  # robust; blocks are not Gaussian, and there are thousands a day
USUAL_STDS = 3.0  # … within which it is usual again
USUAL_BLOCKS = 2  # in a row, before a force is usual again: what comes and goes is one event
PRACTICAL_SHARE = 0.02  # of full thrust: what an owner would not notice is no event
USUAL_QUANTILES = (0.05, 0.95)  # of earlier blocks, between which a force "usually" lies
MIN_SPREAD = 0.1  # of the missing force's own std: a calm hour does not narrow the range further
NOTHING = (0.0, 0.0, 0.0)
AXES = (("ahead", "N"), ("to starboard", "N"), ("clockwise", "N m"))


class MissingForceRange(NamedTuple):
    """The usual range of the missing force: means of earlier blocks, and the block under way."""

    blocks: Floats  # (B, 3) [N, N, N m]
    total: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the block under way
    rows: int = 0  # of it
    began: float = -np.inf  # s
    unusual: tuple[bool, ...] = (False, False, False)
    against: tuple[int, ...] = (0, 0, 0)  # blocks in a row that say otherwise
    smallest: tuple[float, ...] = (0.0, 0.0, 0.0)  # that counts [N, N, N m]
    persisted: int = 0  # unusual blocks in a row
    waiting: Floats | None = None  # mean (3,) of the block before, not judged yet

    @classmethod
    def start(cls, vessel: Vessel | None = None) -> "MissingForceRange":
        """Before the first row; with a vessel, forces count that are large beside its thrust."""
        if vessel is None or not vessel.thrusters:
            return cls(np.empty((0, 3)))
        thrust = PRACTICAL_SHARE * sum(t.thrust[1] for t in vessel.thrusters)
        lever = 0.5 * max(vessel.hull.beam, 0.1)
        return cls(np.empty((0, 3)), smallest=(thrust, thrust, thrust * lever))

    def observe(self, out: ShadowRows) -> tuple["MissingForceRange", list[EventRow]]:
        """A chunk of the path -> the range after it, and what left or entered it."""
        now, events = self, list[EventRow]()
        if not len(out):
            return now, events
        rows = zip(out.time_s.tolist(), out.residuals.missing.tolist(), strict=True)
        for k, (time, (X, Y, N)) in enumerate(rows):
            if not isfinite(X + Y + N):
                if now.rows or now.waiting is not None:
                    now = now._replace(total=NOTHING, rows=0, began=-np.inf, waiting=None)
                continue
            if time - now.began >= FORCE_BLOCK_S:
                now, changes = now._closed(out, k)
                events += changes
            x, y, n = now.total
            total = (x + X, y + Y, n + N)
            now = now._replace(total=total, rows=now.rows + 1)
        return now, events

    def _closed(self, out: ShadowRows, k: int) -> tuple["MissingForceRange", list[EventRow]]:
        """The block ends before row k."""
        ended = np.array(self.total) / self.rows if self.rows else None
        began = float(out.time_s[k])
        fresh = self._replace(total=NOTHING, rows=0, began=began, waiting=ended)
        mean = self.waiting
        if mean is None:
            return fresh, []
        if len(self.blocks) < NEEDED_BLOCKS:
            return fresh._replace(blocks=np.vstack([self.blocks, mean])), []
        middle = np.median(self.blocks, axis=0)
        spread = 1.4826 * np.median(np.abs(self.blocks - middle), axis=0)
        width = np.maximum(spread, MIN_SPREAD * out.residuals.missing_std[k])
        width = np.maximum(width, np.array(self.smallest) / UNUSUAL_STDS)
        limit = np.where(self.unusual, USUAL_STDS, UNUSUAL_STDS) * width
        usual = np.quantile(self.blocks, USUAL_QUANTILES, axis=0)
        outside = (mean < usual[0]) | (mean > usual[1]) | self.unusual  # two kinds of blocks, say
        beyond = tuple(((np.abs(mean - middle) > limit) & outside).tolist())
        against = tuple(
            n + 1 if far != was else 0
            for n, far, was in zip(self.against, beyond, self.unusual, strict=True)
        )
        changed = tuple(
            n >= (USUAL_BLOCKS if was else 1) for n, was in zip(against, self.unusual, strict=True)
        )
        unusual = tuple(was != turn for was, turn in zip(self.unusual, changed, strict=True))
        against = tuple(0 if turn else n for n, turn in zip(against, changed, strict=True))
        fresh = fresh._replace(unusual=unusual, against=against)
        if any(unusual) and self.persisted + 1 >= REMEMBERED_BLOCKS:
            minutes = REMEMBERED_BLOCKS * FORCE_BLOCK_S / 60.0
            text = f"unusual forces for {minutes:.0f} minutes: usual from here on"
            again = MissingForceRange(np.empty((0, 3)), smallest=self.smallest, began=began)
            return again, [_range_event(out, k, False, text)]
        events = [
            _range_event(out, k, unusual[i], _range_text(i, unusual[i], mean[i], usual[:, i]))
            for i in range(3)
            if unusual[i] != self.unusual[i]
        ]
        if any(beyond):
            return fresh._replace(persisted=self.persisted + any(unusual)), events
        blocks = np.vstack([self.blocks, mean])[-REMEMBERED_BLOCKS:]
        return fresh._replace(blocks=blocks, persisted=0), events


def _range_event(out: ShadowRows, k: int, unusual: bool, text: str) -> EventRow:
    kind, severity = ("residual_unusual", "warning") if unusual else ("residual_usual", "info")
    return EventRow.at(out, k, kind, severity, text)


def _range_text(axis: int, unusual: bool, value: float, usual_range: Floats) -> str:
    """What is told of an axis; `usual_range` (2,): what the blocks before lay between."""
    (towards, unit), (low, high) = AXES[axis], usual_range.tolist()
    digits = _digits(value, low, high) if unusual else 1
    usual = f"usually {low:.{digits}f} to {high:.{digits}f} {unit}"
    if unusual:
        return f"the model lacks {value:.{digits}f} {unit} {towards}, {usual}"
    return f"what the model lacks {towards} is back to its usual range ({usual})"


def _digits(value: float, low: float, high: float) -> int:
    """Digits with which a value beyond a range is also written beyond it, one to three."""
    for digits in (1, 2):
        if not round(low, digits) <= round(value, digits) <= round(high, digits):
            return digits
    return 3


_Words = dict[bool, tuple[str, str, str]]  # kind, severity and text of becoming so or not

_TELEMETRY: _Words = {
    True: ("telemetry_back", "info", "telemetry is fresh again"),
    False: ("telemetry_silent", "warning", "the boat no longer tells its heading and velocity"),
}
_REFERENCE: _Words = {
    True: ("reference_model", "info", "the shadow follows the vessel's own prediction now"),
    False: ("reference_measured", "info", "the shadow follows the measurement now"),
}
_LIMITS: _Words = {
    True: ("limits_bind", "warning", "the plant's thrust limits bind: it cannot follow"),
    False: ("limits_free", "info", "the plant's thrust limits no longer bind"),
}
_JUMPED = {
    MeasurementKind.YAW: "heading",
    MeasurementKind.POSITION: "position",
    MeasurementKind.VELOCITY: "velocity",
    MeasurementKind.BODY_VELOCITY: "velocity",
}
_DIVERGED = (
    "shadow_diverged",
    "error",
    "the shadow left what a boat can do and began anew at the estimate: mass, damping or thrust of "
    "the vessel's model cannot be right",
)
_RESET = (
    "shadow_reset",
    "warning",
    "where the vessel's own prediction led is too far off to come back from as a boat moves: the "
    "shadow was set to the measurement",
)
_STEADY = ("shadow_steady", "info", f"the shadow has not diverged for {STEADY_S:.0f} s")
_RESTART = ("restart", "warning", "the filter started afresh: long silence or a new clock")


@dataclass(frozen=True)
class EventDetector:
    """The state after the last row, so that each change is reported once."""

    started: bool = False
    fresh: bool = True
    from_model: bool = False
    limited: bool = False
    diverged_s: float = -np.inf  # when the shadow last diverged; −inf: it is well
    faults: int = 0  # of the boat's data, as told so far; 0: they are fit
    unfit_s: float = -np.inf  # since when
    well: int = ALWAYS_WELL  # faults whose absence the boat has reported
    lost: int = 0  # of `faults` those that were in `well` before: what comes back does so again
    outputs: DrivenOutputs = field(default_factory=DrivenOutputs)
    undriven: bool = False  # whether it was told that one of these never gets a pulse

    @classmethod
    def of(cls, vessel: Vessel) -> "EventDetector":
        """Before the first row, for a vessel."""
        return cls(outputs=DrivenOutputs.start(vessel))

    def observe(
        self, inputs: FilterInputs, rows: FilterRows, out: ShadowRows
    ) -> tuple["EventDetector", list[EventRow]]:
        """A chunk of the path -> the state after it, and what happened, in order."""
        events: list[EventRow] = []
        first = 0 if self.started else int(out.row[0]) + 1 if len(out) else len(rows)
        if not self.started and len(out):
            events.append(EventRow.at(out, 0, "started", "info", "the first estimate is there"))
        if np.count_nonzero(rows.flags & BROKEN):
            events += _breaks(inputs, rows, first)
        diverged_s = self.diverged_s
        if len(out):
            events += _changes(out, out.fresh, self.fresh, _TELEMETRY)
            events += _changes(out, out.from_model, self.from_model, _REFERENCE)
            events += _changes(out, out.limited, self.limited, _LIMITS)
            diverged_s, divergences = _divergences(out, diverged_s)
            events += divergences
            events += [EventRow.at(out, int(k), *_RESET) for k in np.flatnonzero(out.reset)]
        now, sensor_events = self._sensors(inputs, rows)
        now, output_events = now._outputs(inputs)
        events += [*sensor_events, *output_events]
        events.sort(key=lambda event: event.receive_time_ns)
        if not len(out):
            return now, events
        fresh, from_model, limited = (
            bool(flags[-1]) for flags in (out.fresh, out.from_model, out.limited)
        )
        last = True, fresh, from_model, limited, diverged_s
        if last == (now.started, now.fresh, now.from_model, now.limited, now.diverged_s):
            return now, events  # as mostly
        return replace(
            now, started=True, fresh=fresh, from_model=from_model, limited=limited,
            diverged_s=diverged_s,
        ), events  # fmt: skip

    def _sensors(
        self, inputs: FilterInputs, rows: FilterRows
    ) -> tuple["EventDetector", list[EventRow]]:
        """Events of faults that make the boat's data unfit: each once, until all are over."""
        told, since, events = self.faults, self.unfit_s, list[EventRow]()
        well, lost, faults = self.well, self.lost, rows.faults & ~UNDRIVEN  # told by itself
        if not told and not np.count_nonzero(faults):
            if well & (REPORTED | UNHEARD) == REPORTED | UNHEARD:
                return self, events
            reported = reduce(or_, _reported(inputs), well)
            return self if reported == well else replace(self, well=reported), events
        for k, (time, bits, reported) in enumerate(
            zip(
                inputs.events.time_s.tolist(),
                faults.tolist(),
                _reported(inputs),
                strict=True,
            )
        ):
            words, new = None, bits & ~told
            if found := reasons_in(new):
                lost |= new & well
                since, told = time if not told else since, told | bits
                what = _joined([WORDS[fault][0] for fault in found])
                text = f"{what}: until that is over the model is not judged"
                words = "sensor_failed", "warning", text
            elif told and not bits:
                what = _joined([_restored(fault, lost) for fault in reasons_in(told)])
                text = f"{what}, after {time - since:.0f} s: the model is judged"
                text += " again" if lost else " from now on"
                told, lost, words = 0, 0, ("sensor_restored", "info", text)
            well |= reported
            if words is not None:
                at = int(inputs.vehicle_time_ns[k]), int(inputs.receive_time_ns[k])
                events.append(EventRow(*at, *words))
        return replace(self, faults=told, unfit_s=since, well=well, lost=lost), events

    def _outputs(self, inputs: FilterInputs) -> tuple["EventDetector", list[EventRow]]:
        """That outputs of the vessel never get a pulse, once, and that they do at last."""
        outputs, missed = self.outputs.check(inputs)
        told, events = self.undriven, list[EventRow]()
        if missed is not None:
            bits, seen = missed
            for k in np.flatnonzero(np.diff((bits == UNDRIVEN).astype(int), prepend=int(told))):
                told = not told
                pulses = inputs.pulse_table.pulses[inputs.pulse_row[k]]
                failed = f"{outputs.text(seen[k], pulses)}: until that is over the model is not"
                words = (
                    ("sensor_failed", "warning", f"{failed} judged")
                    if told
                    else ("sensor_restored", "info", f"{WORDS[SensorFault.UNDRIVEN][1]}: the model "
                          "is judged from now on")
                )  # fmt: skip
                at = int(inputs.vehicle_time_ns[k]), int(inputs.receive_time_ns[k])
                events.append(EventRow(*at, *words))
        if outputs is self.outputs and told == self.undriven:
            return self, events
        return replace(self, outputs=outputs, undriven=told), events


def _reported(inputs: FilterInputs) -> Iterator[int]:
    """What the boat says is well, input by input."""
    reported = inputs.gps_fix, inputs.estimator, inputs.heard
    return map(reported_well, *(column.tolist() for column in reported))


def _restored(fault: SensorFault, lost: int) -> str:
    """What is said when a fault is over; nothing comes again that was never there."""
    over = WORDS[fault][1]
    return over if fault & lost else over.removesuffix(" again")


EKF_HAS = "the autopilot's EKF has "


def _joined(texts: list[str]) -> str:
    """Several sentences as one; what the EKF has is told of it once, and of nobody else."""
    own = [text for text in texts if text.startswith(EKF_HAS)]
    others = [text for text in texts if text not in own]
    ekf = EKF_HAS + " and ".join(text.removeprefix(EKF_HAS) for text in own)
    return " and ".join([*others, *([ekf] if own else [])])


def _divergences(out: ShadowRows, since: float) -> tuple[float, list[EventRow]]:
    """When the shadow last diverged, and events: once for all that follow within `STEADY_S`."""
    if isinf(since) and True not in out.diverged.tolist():
        return since, []
    events = []
    for k, (time, diverged) in enumerate(zip(out.time_s, out.diverged, strict=True)):
        if diverged:
            events += [] if np.isfinite(since) else [EventRow.at(out, k, *_DIVERGED)]
            since = float(time)
        elif np.isfinite(since) and abs(time - since) >= STEADY_S:
            events.append(EventRow.at(out, k, *_STEADY))
            since = -np.inf
    return since, events


def _changes(
    out: ShadowRows, now: NDArray[np.bool_], before: bool, words: _Words
) -> list[EventRow]:
    if (not before) not in now.tolist():
        return []
    changed = np.flatnonzero(np.diff(np.append(before, now).astype(np.int8)) != 0)
    return [EventRow.at(out, int(k), *words[bool(now[k])]) for k in changed]


def _breaks(inputs: FilterInputs, rows: FilterRows, first: int) -> list[EventRow]:
    """Jumps and restarts; before the first estimate there is nothing to interrupt."""
    words = [(k, _jump(inputs.events.kind[k])) for k in np.flatnonzero(discontinuous(inputs, rows))]
    words += [(k, _RESTART) for k in np.flatnonzero(rows.has(Flag.RESTART))]
    return [
        EventRow(int(inputs.vehicle_time_ns[k]), int(inputs.receive_time_ns[k]), *what)
        for k, what in words
        if k >= first
    ]


def _jump(kind: int) -> tuple[str, str, str]:
    """What jumped: a step of it, or a turn too quick for the rate at which it is told."""
    what = _JUMPED[MeasurementKind(kind)]
    text = f"the reported {what} jumped, or moved more quickly than it is told: it is taken over"
    return "jump", "warning", text
