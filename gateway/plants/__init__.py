"""Which plant plays a shadow: `KIND[:FILE]` or `FILE` in words, kinds from the table or a plug-in.

A plug-in registers its `PlantKind` objects under the entry point group `shadow.plants`. Plants that
come as files have a file each in this folder.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path

from gateway.errors import BadInput
from gateway.files import vessel_names
from gateway.plants.fmu import FMU
from gateway.vessel_file import load_vessel
from sim.effects.effect import Effect
from sim.near_names import did_you_mean
from sim.plants import OWN_VESSEL, PLANTS, VESSEL, PlantChoice, PlantKind


@lru_cache(maxsize=1)
def known_plants() -> Mapping[str, PlantKind]:
    """The table of plants, then what installed plug-ins add, by name."""
    plugged = (point.load() for point in entry_points(group="shadow.plants"))
    return {
        **PLANTS,
        FMU.name: FMU,
        **{kind.name: kind for kind in plugged if isinstance(kind, PlantKind)},
    }


def load_plant(text: str | None, effects: Sequence[Effect] = ()) -> PlantChoice:
    """The plant of `KIND`, `KIND:FILE` or `FILE` (a vessel file); None: the vessel itself."""
    if text is None:
        return OWN_VESSEL
    kind, file = _parts(text, Path())
    if kind.reads is None:
        return PlantChoice(kind, None if file is None else load_vessel(file, effects))
    if file is None:
        raise BadInput(f"plant {text}: expected {text}:FILE, the table that describes it")
    build, table = kind.reads(file)
    return PlantChoice(kind._replace(build=build), None, table)


def plant_relative_to(folder: Path, text: str) -> str:
    """The same plant with its file as seen from a folder."""
    kind, file = _parts(text, folder)
    if file is None:
        return text
    return f"{'' if file == text else f'{kind.name}:'}{folder / file}"


def _parts(text: str, folder: Path) -> tuple[PlantKind, str | None]:
    """Kind and file; a name that is no kind is the file of a vessel."""
    name, colon, file = text.partition(":")
    known = known_plants()
    if name in known:
        if colon and not file:
            raise BadInput(f"plant {text}: expected KIND or KIND:FILE")
        return known[name], file or None
    meant = did_you_mean(name, known)
    is_kind = colon and name.isidentifier() and len(name) > 1
    if (is_kind or meant) and not (folder / text).exists() and text not in vessel_names():
        kinds = ", ".join(sorted(known))
        raise BadInput(f"plant {text}: no kind {name!r}: {meant}there are {kinds}")
    return VESSEL, text
