"""Parameters of the autopilot that change inside a log, and what that does to its outputs.

A parameter that is listed again with the value it had is no change, nor is its first listing. Of
what changes, the outputs (SERVOn_FUNCTION, MIN, TRIM, MAX, REVERSED; of PX4 those of `px4_outputs`)
and the gyro's filter decide how the log is read. A ULog tells of a change as such, also of a
parameter whose value before it does not hold.

What a pulse does to a motor is the wiring's and not the parameter's: where a direction changes,
either the motor was turned with it or it had run the wrong way before. The log cannot say which, so
that no pulse is rewritten: the change is told, and a vessel file is held to be of one side of it.
"""

import math
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from gateway.ingest.log import Boat, ListedParameter, Log, log_start_ns
from gateway.ingest.mapping import Actuator, actuators
from gateway.ingest.px4_outputs import DIRECTIONS, LIMITS

DECIDES = re.compile(r"SERVO\d+_(FUNCTION|MIN|TRIM|MAX|REVERSED)|INS_GYRO_FILTER|IMU_GYRO_CUTOFF")
DECIDE = (DECIDES, DIRECTIONS, LIMITS)
ALIKE_US = 20.0  # pulse limits that differ by less are the same; chosen, not measured
MOST_TOLD = 3  # changes in one sentence


class ParameterChange(NamedTuple):
    """One change; order and receipt are those of the message that tells the new value.

    before  NaN where the log does not hold it
    """

    order: int
    receive_time_ns: int
    name: str
    before: float
    after: float

    def __str__(self) -> str:
        if math.isnan(self.before):
            return f"{self.name} becomes {self.after:g}"
        return f"{self.name} changes from {self.before:g} to {self.after:g}"


class OutputsChange(NamedTuple):
    """A change after which an output moves the boat otherwise, and the parameters after it."""

    change: ParameterChange
    parameters: dict[str, float]


def parameter_changes(log: Log, boat: Boat) -> list[ParameterChange]:
    """Changes of the parameters that decide how the log is read, in its order."""
    return list(_changes(log.listed_parameters(boat)))


def _changes(listed: Iterable[ListedParameter]) -> Iterable[ParameterChange]:
    known: dict[str, float] = {}
    for one in listed:
        before = known.get(one.name, math.nan if one.changed else one.value)
        known[one.name] = one.value
        if before != one.value and any(p.fullmatch(one.name) for p in DECIDE):
            yield ParameterChange(one.order, one.receive_time_ns, one.name, before, one.value)


def first_parameters(log: Log, boat: Boat) -> dict[str, float]:
    """Name -> the first value of each parameter: those that a log begins with."""
    first: dict[str, float] = dict(log.parameters(boat))
    first.update((one.name, one.value) for one in reversed(log.listed_parameters(boat)))
    return first


def outputs_changes(log: Log, boat: Boat) -> list[OutputsChange]:
    """Changes of the outputs that move the boat, without those too small to matter."""
    found, parameters = list[OutputsChange](), first_parameters(log, boat)
    for change in parameter_changes(log, boat):
        before = actuators(parameters)
        parameters = {**parameters, change.name: change.after}
        if _differ(before, actuators(parameters)) or _matters_to_px4(change):
            found.append(OutputsChange(change, parameters))
    return found


def _differ(before: list[Actuator], after: list[Actuator]) -> bool:
    """Whether outputs differ in more than a few microseconds."""
    kinds = [[(a.channel, a.function, a.reversed) for a in some] for some in (before, after)]
    limits = [[pulse for a in some for pulse in a.pwm] for some in (before, after)]
    return kinds[0] != kinds[1] or any(abs(a - b) > ALIKE_US for a, b in zip(*limits, strict=True))


def _matters_to_px4(change: ParameterChange) -> bool:
    """Whether a change of one of PX4's outputs is more than a few microseconds."""
    by_little = abs(change.after - change.before) <= ALIKE_US  # not where it was not known
    limits = LIMITS.fullmatch(change.name) is not None and not by_little
    return limits or DIRECTIONS.fullmatch(change.name) is not None


def outputs_notice(log: Log, boat: Boat) -> tuple[str, ...]:
    """That outputs are set otherwise inside a log, with the seconds of `info --events`."""
    found = [one.change for one in outputs_changes(log, boat)]
    if not found:
        return ()
    start = log_start_ns(log)
    return (changes_text([((c.receive_time_ns - start) * 1e-9, str(c)) for c in found]),)


def changes_text(changes: Sequence[tuple[float, str]]) -> str:
    """Times [s] and changes -> the sentence that every result repeats; empty without any."""
    if not changes:
        return ""
    told = ", ".join(f"{text} at {time:.0f} s" for time, text in changes[:MOST_TOLD])
    more = len(changes) - MOST_TOLD
    rest = f" and {more} more" if more > 0 else ""
    return (
        f"{told}{rest}: what a pulse does is as before unless motors were plugged or set otherwise "
        "too; then a vessel file holds on one side alone (shadow identify takes one with --from or "
        "--to)"
    )
