"""Rows of the shadow path -> messages of every topic."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gateway.ingest.earth import Origin, to_degrees
from gateway.json_rows import TopicRows, encode_rows
from gateway.shadow.path import ShadowRows
from sim.state import Floats

# columns of a motion (eta, nu, nu_dot) in the order of the motion topics' fields
MOTION_FIELDS = (3, 4, 5, 6, 7, 8, 0, 1, 2)


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

    One by one, the shadow first: each can go out while the next is being made.
    """
    times, residuals = (out.vehicle_time_ns, out.receive_time_ns), out.residuals
    source = {"source": _source(out)}
    yield encode_rows("shadow", *times, _fields(out.shadow, out.std), source)
    yield _measured(out)
    yield encode_rows("reference", *times, _fields(out.reference, out.std), source)
    if origin is not None:
        yield encode_rows("position", *times, _positions(out, origin))
    forces = np.hstack([out.control, residuals.commanded])
    yield encode_rows("control", *times, forces)
    values = np.hstack([residuals.missing, residuals.missing_std, residuals.errors])
    yield encode_rows("residual", *times, values)


def _fields(motion: Floats, std: Floats) -> Floats:
    """(K, 9) motion and std -> (K, 18) in the order of the topic's fields."""
    fields = np.empty((len(motion), 18))
    fields[:, :9], fields[:, 9:] = motion[:, MOTION_FIELDS], std[:, MOTION_FIELDS]
    return fields


def _source(out: ShadowRows) -> str | list[str]:
    """Where the reference came from, row by row where that changes."""
    if not out.from_model.any():
        return "measured"
    return np.where(out.from_model, "model", "measured").tolist()


def _measured(out: ShadowRows) -> TopicRows:
    """The estimate where it rests on measurements."""
    vehicle, receive, fields = out.vehicle_time_ns, out.receive_time_ns, (out.estimate, out.std)
    if not out.fresh.all():
        vehicle, receive = vehicle[out.fresh], receive[out.fresh]
        fields = out.estimate[out.fresh], out.std[out.fresh]
    return encode_rows("measured", vehicle, receive, _fields(*fields), {"source": "measured"})


def _positions(out: ShadowRows, origin: Origin) -> Floats:
    boat, shadow = to_degrees(out.estimate[:, :2], origin), to_degrees(out.shadow[:, :2], origin)
    return np.hstack([boat, out.estimate[:, 2:3], shadow, out.shadow[:, 2:3]])


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
