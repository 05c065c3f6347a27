"""A plan as tables: one with pulses for people and other autopilots, one for `shadow simulate`."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

from gateway.errors import ShadowError
from gateway.plan.plan import Plan


def write_pulses(plan: Plan, file: Path) -> Path:
    """time [s], throttle, steer (−1 … 1), pwm_N [µs] of each channel: each row holds."""
    channels, pulses = plan.vessel.pulses(plan.commands)
    header = ["time", "throttle", "steer", *(f"pwm_{channel}" for channel in channels)]
    rows = (
        [f"{t:.1f}", *(f"{s:.3f}" for s in sticks), *(f"{p:.0f}" for p in row)]
        for t, sticks, row in zip(plan.time, plan.sticks, pulses, strict=True)
    )
    return _write(file, header, rows)


def write_commands(plan: Plan, file: Path) -> Path:
    """time [s] and one column per actuator by its name (−1 … 1): what `shadow simulate` reads."""
    header = ["time", *(actuator.name for actuator in plan.vessel.actuators)]
    rows = (
        [f"{t:.1f}", *(f"{command:.4f}" for command in row)]
        for t, row in zip(plan.time, plan.commands, strict=True)
    )
    return _write(file, header, rows)


def _write(file: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> Path:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(rows)
    except OSError as error:
        raise ShadowError(f"{file}: cannot write the table: {error.strerror}") from None
    return file
