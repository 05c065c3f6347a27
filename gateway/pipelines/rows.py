"""Rows of the shadow path → messages of every topic."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.earth import Origin, to_degrees
from gateway.messages import Rows, encode_rows
from gateway.pipelines.path import Shadowing
from sim.state import Floats

# columns of a motion (eta, nu, nu_dot) in the order of the motion topics' fields
MOTION_FIELDS = (3, 4, 5, 6, 7, 8, 0, 1, 2)


@dataclass(frozen=True)
class Happening:
    """One row of the event topic."""

    vehicle_time_ns: int
    receive_time_ns: int
    kind: str
    severity: str
    says: str


def topic_rows(out: Shadowing, origin: Origin | None) -> list[Rows]:
    """All topics that follow from the path's rows; what is not complete is withheld."""
    times = out.vehicle_time_ns, out.receive_time_ns
    measured = out.fresh
    source = np.where(out.from_model, "model", "measured").tolist()
    followed = np.hstack([out.reference, out.std])
    shadowed = np.hstack([out.shadow, out.std])
    watched = out.watched
    rows = [
        _motion("measured", out, np.hstack([out.estimate, out.std])[measured], measured),
        encode_rows("reference", *times, _fields(followed), {"source": source}),
        encode_rows("shadow", *times, _fields(shadowed), {"source": source}),
        encode_rows("control", *times, np.hstack([out.control, watched.commanded])),
        encode_rows(
            "residual", *times, np.hstack([watched.missing, watched.missing_std, watched.errors])
        ),
    ]
    if origin is not None:
        rows.append(encode_rows("position", *times, _positions(out, origin)))
    return rows


def _fields(motion_and_std: Floats) -> Floats:
    """(K, 18) motion, std -> (K, 18) in the order of the topic's fields."""
    order = [*MOTION_FIELDS, *(9 + i for i in MOTION_FIELDS)]
    return motion_and_std[:, order]


def _motion(topic: str, out: Shadowing, values: Floats, chosen: NDArray[np.bool_]) -> Rows:
    return encode_rows(
        topic,
        out.vehicle_time_ns[chosen],
        out.receive_time_ns[chosen],
        _fields(values),
        {"source": "measured"},
    )


def _positions(out: Shadowing, origin: Origin) -> Floats:
    boat, shadow = to_degrees(out.estimate[:, :2], origin), to_degrees(out.shadow[:, :2], origin)
    return np.hstack([boat, out.estimate[:, 2:3], shadow, out.shadow[:, 2:3]])


def event_rows(happenings: Sequence[Happening]) -> Rows:
    """Events as messages."""
    return encode_rows(
        "event",
        np.array([h.vehicle_time_ns for h in happenings], np.int64),
        np.array([h.receive_time_ns for h in happenings], np.int64),
        np.zeros((len(happenings), 0)),
        {
            "kind": [h.kind for h in happenings],
            "severity": [h.severity for h in happenings],
            "says": [h.says for h in happenings],
        },
    )
