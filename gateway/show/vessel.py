"""What `shadow init` made, and what its user still has to say."""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from gateway.vessel_file import RudderTable, ThrusterTable, VesselFile


def show_first_vessel(made: VesselFile, out: Path) -> None:
    """Actuators found, numbers assumed, what to do next."""
    console = Console()
    table = Table("actuator", "channel", "pwm [µs]", title=f"{made.name}: outputs that move it")
    parts: list[ThrusterTable | RudderTable] = [*made.thrusters, *made.rudders]
    for part in parts:
        pulses = " – ".join(f"{p:.0f}" for p in part.pwm)
        table.add_row(part.name, str(part.channel), pulses + (" reversed" * part.reversed))
    console.print(table)
    said: dict[str, list[str]] = {}
    for key, origin in made.provenance.items():
        said.setdefault(origin.says, []).append(key)
    for says, keys in said.items():
        console.print(f"{says}: {', '.join(keys)}", highlight=False)
    console.print(f"written: {out}")
    console.print(f"next: correct {out} by hand, then shadow compare LOG --vessel {out}")
