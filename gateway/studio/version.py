"""The vessel that is worked on, at one moment, and the next one: by hand, or by a diagnosis."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

import tomli_w

from gateway.figures.diagnosis import LadderBar
from gateway.studio import DiagnosisView, LadderView

GIVEN = "as given"


@dataclass(frozen=True)
class Version:
    """The vessel at one moment: its file's text, the effects added, the ladder climbed so far."""

    text: str
    effects: tuple[str, ...] = ()
    ladder: tuple[LadderBar, ...] = ()
    change: str = GIVEN


def with_step(versions: Sequence[Version], diagnosis: DiagnosisView, step: LadderView) -> Version:
    """The vessel of a step of a diagnosis; its ladder goes on from that of the vessel diagnosed."""
    before = diagnosis.before
    bars = [one.bar for one in diagnosis.up_to(step)]
    earlier = [one.ladder for one in versions if one.effects == before]
    ladder = (*earlier[0], *bars[1:]) if before and earlier else tuple(bars)
    name = step.effects[-1].replace("_", " ") if step.effects else "re-fitted base"
    return Version(step.text, (*before, *step.effects), ladder, f"+ {name}")


def with_values(version: Version, values: dict[str, float]) -> str:
    """A version's file with other numbers, by key: `m11`, or `EFFECT.PARAMETER`."""
    tables = tomllib.loads(version.text)
    for key, value in values.items():
        effect, _, name = key.rpartition(".")
        if not effect:
            tables["dynamics"][name] = value
        for entry in tables.get("effects", []):
            if entry["type"] == effect:
                entry[name] = value
        tables.get("provenance", {}).pop(f"dynamics.{name}" if not effect else key, None)
    return tomli_w.dumps(tables)
