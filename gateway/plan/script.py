"""A plan as a Lua script for ArduPilot Rover (boats too): `script.lua` with the numbers put in."""

from pathlib import Path
from string import Template

import numpy as np

from gateway.plan.plan import Plan
from gateway.plan.safety import Safety, pulse_bounds
from gateway.whole import write_whole

TEMPLATE = Path(__file__).with_name("script.lua")
MILLI = 1000.0
PER_LINE = 5


def script_text(plan: Plan, safety: Safety, version: str) -> str:
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


def write_script(plan: Plan, safety: Safety, version: str, file: Path) -> Path:
    """The script as a file."""
    text = script_text(plan, safety, version)
    write_whole(file, text.encode(), "the script", folders=True)
    return file


def _rows(plan: Plan) -> str:
    """Corners as whole numbers: ms, throttle and steer in thousandths, a few to a line."""
    table = np.column_stack([MILLI * plan.corner_time, MILLI * plan.corner_sticks])
    triples = [f"{t}, {a}, {b}" for t, a, b in np.rint(table).astype(int).tolist()]
    lines = [triples[k : k + PER_LINE] for k in range(0, len(triples), PER_LINE)]
    return "\n".join("  " + ", ".join(line) + "," for line in lines)
