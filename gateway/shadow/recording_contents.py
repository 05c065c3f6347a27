"""What a recording of a shadow carries beside its messages: models, configuration, its origin."""

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import orjson

from gateway.ingest.log import Boat
from gateway.recording.file import Attachment
from gateway.vessel_file import dump_vessel
from sim.effects.catalogue import EFFECTS
from sim.plants.table import VESSEL, PlantChoice
from sim.vessel import Vessel

METADATA = "shadow"  # the name of the metadata record
LIVE = "live"  # in the metadata of a recording whose frames and ticks reproduce what ran


def attachments_of(
    vessel: Vessel, plant: PlantChoice, config: Mapping[str, Any]
) -> list[Attachment]:
    """Vessel, plant, the sources of effects that are not the catalogue's, and configuration."""
    named = {"vessel.toml": vessel, "plant.toml": plant.vessel}
    files = {name: file for name, file in named.items() if file is not None}
    own = [a.effect for v in files.values() for a in v.effects if a.effect not in EFFECTS]
    sources = {effect.file: effect.source_code for effect in own}
    text = orjson.dumps(config, option=orjson.OPT_INDENT_2)
    return [
        *(Attachment(n, "application/toml", dump_vessel(v).encode()) for n, v in files.items()),
        *(Attachment(n, "text/x-python", source.encode()) for n, source in sources.items()),
        Attachment("config.json", "application/json", text),
    ]


def metadata_of(
    name: str, boat: Boat, *, plant: PlantChoice, log: str | None = None, live: bool = False
) -> dict[str, dict[str, str]]:
    """Version, names of the vessel and of the boat, the kind of a plant that is no vessel.

    `log`: file name of the log of a replay. `live`: recorded by `shadow live`, or a replay that
    reproduces such a recording.
    """
    entries = {"gateway": version("shadow-gateway"), "vessel": name}
    entries |= {} if plant.kind is VESSEL else {"plant": plant.kind.name}
    entries |= {} if log is None else {"log": log}
    entries |= {"boat": str(boat)}
    return {METADATA: entries | ({LIVE: "yes", "system": str(boat.system)} if live else {})}
