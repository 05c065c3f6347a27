"""Which manoeuvre a recording asks for: by what it leaves open of the vessel."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.effect_files import known_effects
from gateway.pipelines.diagnose import answered
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.diagnosis.next_experiment import Suggested
from sim.vessel import Vessel


@dataclass(frozen=True)
class Asked:
    """Manoeuvres by the information expected per second, and what it is expected of."""

    of: str
    ranked: tuple[Suggested, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        rows = [
            {"excitation": s.manoeuvre.name, "seconds": s.seconds, "nats": s.nats}
            for s in self.ranked
        ]
        return {"of": self.of, "ranked": rows}


def asked_by(log: str | Path, vessel: Vessel) -> Asked:
    """Diagnose the recording, then ask which manoeuvre would tell most of what stays open."""
    _, found = answered([log], vessel, DiagnoseSettings(plan=True, effects=known_effects()))
    tied = next((c for c in found.ranking if c.confounded_with), None)
    if tied is None:
        of = "the numbers of the vessel" + (
            f" with {', '.join(found.effects)}" if found.effects else ""
        )
    else:
        of = f"{tied.effect} against {' and '.join(tied.confounded_with)}"
    return Asked(of, found.suggested)
