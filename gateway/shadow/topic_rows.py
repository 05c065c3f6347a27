"""What a recording of a shadow carries beside its messages: models, configuration, its origin.

Rows of the shadow path -> messages of every topic.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import orjson

from gateway.ingest.log import Boat
from gateway.ingest.mapping import Origin, to_degrees
from gateway.json_rows import TopicRows, encode_rows
from gateway.recording.recorder import Attachment
from gateway.shadow.path import ShadowRows
from gateway.vessel_file import ENCLOSED_VESSEL, dump_vessel
from sim.effects.catalogue import EFFECTS
from sim.plants import VESSEL, PlantChoice
from sim.state import Floats
from sim.vessel import Vessel

METADATA = "shadow"  # the name of the metadata record
LIVE = "live"  # in the metadata of a recording whose frames and ticks reproduce what ran


def attachments_of(
    vessel: Vessel, plant: PlantChoice, config: Mapping[str, Any]
) -> list[Attachment]:
    """Vessel, plant, the sources of effects that are not the catalogue's, and configuration."""
    named = {ENCLOSED_VESSEL: vessel, "plant.toml": plant.vessel}
    files = {name: file for name, file in named.items() if file is not None}
    own = [a.effect for v in files.values() for a in v.effects if a.effect not in EFFECTS]
    sources = {effect.file: effect.source_code for effect in own}
    text = orjson.dumps(config, option=orjson.OPT_INDENT_2)
    table = [Attachment("plant.toml", "application/toml", plant.table.encode())]
    return [
        *(Attachment(n, "application/toml", dump_vessel(v).encode()) for n, v in files.items()),
        *(table if plant.table else ()),
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


# columns of a motion (eta, nu, nu_dot) in the order of the motion topics' fields
MOTION_FIELDS = np.array([3, 4, 5, 6, 7, 8, 0, 1, 2])


@dataclass(frozen=True)
class EventRow:
    """One row of the event topic; `text` is its field `says`."""

    vehicle_time_ns: int
    receive_time_ns: int
    kind: str
    severity: str
    text: str

    @classmethod
    def at(cls, out: ShadowRows, k: int, kind: str, severity: str, text: str) -> "EventRow":
        """An event at row k of the path."""
        times = int(out.vehicle_time_ns[k]), int(out.receive_time_ns[k])
        return cls(*times, kind, severity, text)


def topic_rows(out: ShadowRows, origin: Origin | None) -> Iterator[TopicRows]:
    """All topics that follow from the path's rows; what is not complete is withheld.

    One by one, the shadow first: it can go out while the others are being made.
    """
    times, residuals = (out.vehicle_time_ns, out.receive_time_ns), out.residuals
    source, std = {"source": _source(out)}, out.std.take(MOTION_FIELDS, axis=1)
    yield encode_rows("shadow", *times, _fields(out.shadow, std), source)
    yield _measured(out, std)
    yield encode_rows("reference", *times, _fields(out.reference, std), source)
    if origin is not None:
        yield encode_rows("position", *times, _positions(out, origin))
    forces = np.concatenate([out.control, residuals.commanded], axis=1)
    yield encode_rows("control", *times, forces)
    values = residuals.missing, residuals.missing_std, residuals.errors
    yield encode_rows("residual", *times, np.concatenate(values, axis=1))


def _fields(motion: Floats, std: Floats) -> Floats:
    """Motion (K, 9) and its std (K, 9), that in the order of the topic's fields -> (K, 18)."""
    return np.concatenate([motion.take(MOTION_FIELDS, axis=1), std], axis=1)


def _source(out: ShadowRows) -> str | list[str]:
    """Source of the reference, a row wherever it changes."""
    if True not in out.from_model.tolist():
        return "measured"
    return np.where(out.from_model, "model", "measured").tolist()


def _measured(out: ShadowRows, std: Floats) -> TopicRows:
    """The estimate where it rests on measurements; `std` in the order of the topic's fields."""
    vehicle, receive, fields = out.vehicle_time_ns, out.receive_time_ns, _fields(out.estimate, std)
    if False in out.fresh.tolist():
        fresh = out.fresh
        vehicle, receive, fields = vehicle[fresh], receive[fresh], fields[fresh]
    return encode_rows("measured", vehicle, receive, fields, {"source": "measured"})


def _positions(out: ShadowRows, origin: Origin) -> Floats:
    boat, shadow = to_degrees(out.estimate[:, :2], origin), to_degrees(out.shadow[:, :2], origin)
    columns = boat, out.estimate[:, 2:3], shadow, out.shadow[:, 2:3]
    return np.concatenate(columns, axis=1)


def event_rows(events: Sequence[EventRow]) -> TopicRows:
    """Events as messages."""
    return encode_rows(
        "event",
        np.array([e.vehicle_time_ns for e in events], np.int64),
        np.array([e.receive_time_ns for e in events], np.int64),
        np.zeros((len(events), 0)),
        {
            "kind": [e.kind for e in events],
            "severity": [e.severity for e in events],
            "says": [e.text for e in events],
        },
    )
