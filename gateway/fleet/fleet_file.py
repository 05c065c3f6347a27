"""fleet.toml: which vessel file a recording is held against.

[[vessels]]
name = "heron"                        # of this boat, in the table
file = "heron.toml"                   # its vessel file, or the name of one that ships
recordings = ["heron/*", "*_h3.BIN"]  # ends of paths, `*` crosses folders; left out: all
system = 3                            # optional: its MAVLink id, where a log holds several boats
mapping = "columns.toml"              # optional: what the columns of its .csv tables mean

The first entry that matches takes a recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError

from gateway.errors import BadInput
from gateway.files import vessel_path
from gateway.toml_file import explain, read_toml, validated
from gateway.vessel_file import load_vessel
from gateway.vessel_tables import StrictTable
from sim.effects.effect import Effect


class BoatTable(StrictTable):
    """[[vessels]]"""

    name: Annotated[str, Field(min_length=1)]
    file: str
    recordings: tuple[str, ...] = ("*",)
    system: int | None = None
    mapping: str | None = None


class FleetTable(StrictTable):
    """A fleet file as written."""

    vessels: Annotated[tuple[BoatTable, ...], Field(min_length=1)]


@dataclass(frozen=True)
class Boat:
    """One boat: its name in the table, its vessel file, and which recordings are its own."""

    name: str
    vessel_file: str
    recordings: tuple[str, ...] = ("*",)
    system: int | None = None
    mapping: str | None = None

    def sailed(self, recording: str) -> bool:
        """Whether a recording, by its path or URL, is this boat's."""
        return any(
            fnmatch(recording, form)
            for pattern in self.recordings
            for form in (pattern, f"*/{pattern}")
        )


_FLEET = TypeAdapter(FleetTable)


def read_fleet(path: str | Path) -> tuple[Boat, ...]:
    """The boats of a fleet file, whose paths are relative to it; BadInput where it is wrong."""
    file = Path(path)
    try:
        read = validated(_FLEET, read_toml(file, "the fleet file"))
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None
    names = [one.name for one in read.vessels]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{file}: the name {name!r} is given to {names.count(name)} vessels")
    return tuple(
        Boat(
            one.name, _beside(file, one.file), one.recordings, one.system,
            None if one.mapping is None else str(file.parent / one.mapping),
        )
        for one in read.vessels
    )  # fmt: skip


def _beside(file: Path, given: str) -> str:
    """The path of a vessel file, from the folder of the fleet file; else one that ships."""
    own = file.parent / given
    return str((own if own.exists() else vessel_path(given)).resolve())


def fleet_of_one(vessel_file: str | Path, effects: Sequence[Effect] = ()) -> tuple[Boat, ...]:
    """All recordings are of the one boat of this vessel file."""
    return (Boat(load_vessel(vessel_file, effects).name, str(vessel_path(vessel_file).resolve())),)


def boat_of(recording: str, boats: Sequence[Boat]) -> Boat | None:
    """The boat that sailed a recording; None where no entry matches."""
    return next((boat for boat in boats if boat.sailed(recording)), None)
