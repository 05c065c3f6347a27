"""A plan as files: a Lua script for ArduPilot Rover (boats too), tables of pulses and commands.

The script ends a run at the safety limits, and sends no pulse outside the bounds of the plan.
"""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from io import StringIO
from pathlib import Path
from string import Template

import numpy as np

from gateway.files import write_whole
from sim.excitation.sticks import Plan

TEMPLATE = Path(__file__).with_name("script.lua")
MILLI = 1000.0
CORNERS_PER_LINE = 5
# All chosen, not measured.
SPEED_MARGIN = 1.3  # of the speed limit over the fastest predicted
LEAST_SPEED_LIMIT_MPS = 1.0
PULSE_MARGIN_US = 25  # beyond the pulses of the plan
TIME_MARGIN_S = 5.0  # how much longer than planned a run may take


@dataclass(frozen=True)
class SafetyLimits:
    """What ends a run; `lowest_voltage_v` None: the autopilot's own BATT_LOW_VOLT."""

    radius_m: float
    highest_speed_mps: float
    time_out_s: float
    lowest_voltage_v: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{field.name} = {value}: expected a number above 0")


def safety_for(
    plan: Plan, radius_m: float, speed_mps: float | None, voltage_v: float | None
) -> SafetyLimits:
    """The bounds for a plan: what was asked for, else a margin over what is predicted."""
    expected = max(SPEED_MARGIN * float(plan.speed.max()), LEAST_SPEED_LIMIT_MPS)
    speed = round(expected, 2) if speed_mps is None else speed_mps
    return SafetyLimits(radius_m, speed, plan.seconds + TIME_MARGIN_S, voltage_v)


def pulse_bounds(plan: Plan) -> dict[int, tuple[int, int]]:
    """Channel -> lowest and highest pulse [µs] of the plan, neutral included, with some margin."""
    channels, pulses = plan.vessel.pulses(plan.commands)
    servos = [actuator.servo for actuator in plan.vessel.actuators]
    travel = {s.channel: (round(s.pwm[0]), round(s.pwm[2])) for s in servos}
    return {
        channel: (
            max(round(float(pulses[:, k].min())) - PULSE_MARGIN_US, travel[channel][0]),
            min(round(float(pulses[:, k].max())) + PULSE_MARGIN_US, travel[channel][1]),
        )
        for k, channel in enumerate(channels)
    }


def script_text(plan: Plan, safety: SafetyLimits, version: str) -> str:
    """The whole script."""
    bounds = pulse_bounds(plan)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        name=plan.manoeuvre.name,
        vessel=" ".join(plan.vessel.name.split()),
        version=version,
        seconds=f"{plan.seconds:.1f}",
        reach=f"{plan.reach:.0f}",
        radius=f"{safety.radius_m:.1f}",
        speed=f"{safety.highest_speed_mps:.2f}",
        time_out=f"{safety.time_out_s:.1f}",
        voltage=f"{safety.lowest_voltage_v or 0.0:.2f}",
        throttle=f"{plan.limits.throttle:.3f}",
        steer=f"{plan.limits.steer:.3f}",
        throttle_rate=f"{plan.limits.throttle_rate:.3f}",
        steer_rate=f"{plan.limits.steer_rate:.3f}",
        pulses=", ".join(f"{{{c}, {low}, {high}}}" for c, (low, high) in bounds.items()),
        rows=_rows(plan),
    )


def write_script(plan: Plan, safety: SafetyLimits, version: str, file: Path) -> Path:
    """The script as a file."""
    text = script_text(plan, safety, version)
    write_whole(file, text.encode(), "the script")
    return file


def _rows(plan: Plan) -> str:
    """Corners as whole numbers: ms, throttle and steer in thousandths, a few to a line."""
    table = np.column_stack([MILLI * plan.corner_time, MILLI * plan.corner_sticks])
    triples = [f"{t}, {a}, {b}" for t, a, b in np.rint(table).astype(int).tolist()]
    lines = [triples[k : k + CORNERS_PER_LINE] for k in range(0, len(triples), CORNERS_PER_LINE)]
    return "\n".join("  " + ", ".join(line) + "," for line in lines)


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
    table = StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(file, table.getvalue().encode(), "the table")
    return file
