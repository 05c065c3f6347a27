"""The vessel that is worked on, at one moment, and the next one with numbers set by hand."""

import tomllib
from dataclasses import dataclass

import tomli_w

from gateway.figures.diagnosis import LadderBar

GIVEN = "as given"


@dataclass(frozen=True)
class Version:
    """The vessel at one moment: its file's text, the effects added, the ladder climbed so far."""

    text: str
    effects: tuple[str, ...] = ()
    ladder: tuple[LadderBar, ...] = ()
    change: str = GIVEN


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
