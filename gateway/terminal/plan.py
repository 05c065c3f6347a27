"""A plan: its prediction, its bounds and its files; and the list of manoeuvres."""

from collections.abc import Sequence

from rich.table import Table

from gateway.offline.plan import PlanResult
from gateway.offline.plan_export import pulse_bounds
from gateway.terminal.console import ResultConsole
from gateway.terminal.identification import step_response_table
from sim.excitation.manoeuvre import Manoeuvre

MOST = 5  # manoeuvres that are named
UNKNOWN = "wind and current that the vessel file does not hold come on top"


def show_manoeuvres(known: Sequence[Manoeuvre]) -> None:
    """One line each."""
    table = Table("excitation", "seconds", "what it tells of")
    for manoeuvre in known:
        table.add_row(manoeuvre.name, f"{manoeuvre.seconds:.0f}", manoeuvre.reveals)
    out = ResultConsole()
    out.print(table)
    out.print(
        "circles (also in mixed) take as long as the vessel needs. "
        "shadow plan --vessel V --excitation NAME writes one for a boat",
        highlight=False,
    )


def show_plan(done: PlanResult) -> None:
    """What will happen, whether it stays in the circle, what stops it, where the files are."""
    out, plan = ResultConsole(highlight=False), done.plan
    out.print(
        f"[bold]{plan.manoeuvre.name}[/bold] for {plan.vessel.name}: {plan.seconds:.0f} s, "
        f"throttle up to {100 * plan.limits.throttle:.0f} %"
    )
    if done.ranking is not None:
        out.print(f"chosen to tell {done.ranking.of}; per second, of most use:", markup=False)
        for one in done.ranking.ranked[:MOST]:
            out.print(f"  {one.manoeuvre.name}, {one.seconds:.0f} s: {one.nats:.0f} nats")
    out.print(f"tells of {plan.manoeuvre.reveals}", markup=False)
    out.print(_circle(done), markup=False)
    out.print(step_response_table(plan.vessel, done.step_responses))
    pulses = (
        f"{low}–{high} µs on {channel}" for channel, (low, high) in pulse_bounds(plan).items()
    )
    volts = done.safety.lowest_voltage_v
    battery = "BATT_LOW_VOLT" if volts is None else f"{volts:g} V"
    out.print(
        f"the script stops, in Hold, beyond {done.safety.radius_m:g} m or "
        f"{done.safety.highest_speed_mps:g} m/s, below {battery}, outside {', '.join(pulses)}, "
        "and when you move a stick, the switch or the mode",
        markup=False,
    )
    for file in done.files:
        out.path("wrote", file)
    out.print("how to run it aboard, safely: docs/plan.md")


def _circle(done: PlanResult) -> str:
    plan, radius = done.plan, done.safety.radius_m
    fast = f"predicted: at most {plan.speed.max():.1f} m/s, {plan.reach:.0f} m from the start"
    if not done.within_radius:
        return (
            f"WARNING: {fast}: it leaves the circle of {radius:g} m after {done.leaves_at:.0f} s, "
            f"where the script will stop. --seconds {done.clear_until:.0f} keeps it in; or give "
            "more --radius, or another --excitation"
        )
    if done.close_to_edge:
        return (
            f"{fast}, within the circle of {radius:g} m but close to it: wind or current may carry "
            f"it out, where the script will stop. --seconds {done.clear_until:.0f} keeps it clear"
        )
    if plan.limits.throttle < done.requested_throttle:
        return (
            f"{fast}, in the circle of {radius:g} m: for that the throttle limit "
            f"was lowered from {done.requested_throttle:g} to {plan.limits.throttle:.2f}; {UNKNOWN}"
        )
    return f"{fast}, in the circle of {radius:g} m; {UNKNOWN}"
