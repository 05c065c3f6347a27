"""What is true of a case, in the catalogue's words: kept where no diagnosis looks."""

from collections.abc import Sequence
from typing import Any

from benchmarks.hidden.boats import EVERY, Boat
from benchmarks.hidden.cases import Case, Voyage
from benchmarks.hidden.causes import Hidden, is_strange


def answer(case: Case) -> dict[str, Any]:
    """All that a scorer needs, as JSON."""
    boat = EVERY[case.boat]
    return {
        "name": case.name, "family": case.family, "boat": case.boat, "share": case.share,
        "misjudged": case.misjudged, "pilot": case.voyage.pilot, "rates": case.voyage.rates,
        "seconds": case.voyage.seconds, "seed": case.voyage.seed,
        "unknown": is_strange(case.voyage.hidden),
        "effects": [h.name for h in case.voyage.hidden],
        "values": _of(case.voyage, boat), "twin_values": _of(case.twin, boat),
        "twin_pilot": case.twin.pilot,
    }  # fmt: skip


def _of(voyage: Voyage, boat: Boat) -> list[dict[str, Any]]:
    return [catalogued(hidden, boat) for hidden in voyage.hidden]


def catalogued(hidden: Hidden, boat: Boat) -> dict[str, Any]:
    """A cause -> type and parameters as a vessel file would name them.

    Times are seconds after arming. What has no name there (how tired a battery is) is left out.
    """
    values = dict(hidden.values)
    if hidden.name == "thruster_fault":
        channels = [motor.channel for motor in boat.motors]
        values["thruster"] = 1.0 + channels.index(int(values.pop("channel")))
    if hidden.name == "actuator_wiring":
        values = {"order": _crossed(range(1, len(boat.motors) + 1)), "reversed": 0.0}
    if hidden.name == "battery_sag":
        values.pop("tired", None)
    return {"type": hidden.name, **values}


def _crossed(numbers: Sequence[int]) -> float:
    """Each does what its opposite should: 1, 2 -> 21."""
    return float("".join(str(n) for n in reversed(numbers)))
