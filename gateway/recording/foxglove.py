"""Foxglove's well-known messages in JSON, made from ours: boat and shadow on map, 3-D and log.

Their world is east-north-up with yaw counter-clockwise from east, so NED is turned here, once.
Messages carry the time of receipt: players look transforms up by the time they play.

How much of our topics players are shown: the first row in each tenth of a second, all events.

One thinning for recordings and for the live server.

Raw MAVLink frames are declared so that players have nothing to say against them: Foxglove and
Lichtblick show an error for every channel in an encoding that they do not know, with a schema or
without. What frames of MAVLink 1 and 2 have in common fits a message of ROS 1, which leaves out
what follows it: a player shows the first eight bytes, the message is the frame byte for byte.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.json_rows import TopicRows

WORLD = "world"
NANOSECONDS = 1_000_000_000
FRAME_ENCODING, FRAME_SCHEMA_ENCODING = "ros1", "ros1msg"
FRAME_METADATA = {"encoding": "mavlink"}  # what the messages really are
FRAME_SCHEMA = (
    "mavlink/Frame",
    b"# A MAVLink frame, whole: these are the first bytes of it, for MAVLink 1 and 2 alike.\n"
    b"uint8 magic\nuint8 payload_length\nuint8[6] header\n",
)
TICK_SCHEMA = "mavlink/Tick", b"# A moment without telemetry: nothing.\n"

Row = Mapping[str, Any]
Message = dict[str, Any]


class Channel(NamedTuple):
    """A channel of a recording that players understand without being told."""

    topic: str
    schema: str
    source: str  # our topic that it is made from
    convert: Callable[[Row], Message]


def _object(**properties: Any) -> Message:
    return {"type": "object", "properties": properties, "required": list(properties)}


NUMBER, INTEGER, STRING = {"type": "number"}, {"type": "integer"}, {"type": "string"}
TIME = _object(sec={"type": "integer", "minimum": 0}, nsec={"type": "integer", "minimum": 0})
VECTOR = _object(x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = _object(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)

SCHEMAS: Mapping[str, Message] = {
    "foxglove.PoseInFrame": _object(
        timestamp=TIME, frame_id=STRING, pose=_object(position=VECTOR, orientation=QUATERNION)
    ),
    "foxglove.FrameTransform": _object(
        timestamp=TIME,
        parent_frame_id=STRING,
        child_frame_id=STRING,
        translation=VECTOR,
        rotation=QUATERNION,
    ),
    "foxglove.LocationFix": _object(
        timestamp=TIME,
        frame_id=STRING,
        latitude=NUMBER,
        longitude=NUMBER,
        altitude=NUMBER,
        position_covariance={"type": "array", "items": NUMBER, "minItems": 9, "maxItems": 9},
        position_covariance_type=INTEGER,
    ),
    "foxglove.Log": _object(
        timestamp=TIME, level=INTEGER, message=STRING, name=STRING, file=STRING, line=INTEGER
    ),
}
LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4}
COVARIANCE_UNKNOWN = 0
UNIT_DECIMALS = 7  # of a unit quaternion: digits beyond them are most of a recorded pose's size
FRAMES = ("frame_id", "parent_frame_id", "child_frame_id")


def schema_text(name: str) -> bytes:
    """A well-known schema as JSON Schema text."""
    return orjson.dumps({"title": name, **SCHEMAS[name]})


def _time(row: Row) -> dict[str, int]:
    sec, nsec = divmod(row["receive_time_ns"], NANOSECONDS)
    return {"sec": sec, "nsec": nsec}


def _position(row: Row) -> dict[str, float]:
    return {"x": row["east_m"], "y": row["north_m"], "z": 0.0}


def _orientation(row: Row) -> dict[str, float]:
    """Yaw clockwise from north -> rotation about the upward axis, counter-clockwise from east."""
    half = (math.pi / 2.0 - row["yaw_rad"]) / 2.0
    z, w = round(math.sin(half), UNIT_DECIMALS), round(math.cos(half), UNIT_DECIMALS)
    return {"x": 0.0, "y": 0.0, "z": z, "w": w}


def pose(row: Row) -> Message:
    """A row of `measured` or `shadow` -> foxglove.PoseInFrame."""
    where = {"position": _position(row), "orientation": _orientation(row)}
    return {"timestamp": _time(row), "frame_id": WORLD, "pose": where}


def transform(child: str) -> Callable[[Row], Message]:
    """For rows of `measured` or `shadow` -> foxglove.FrameTransform from the world to `child`."""

    def convert(row: Row) -> Message:
        return {
            "timestamp": _time(row),
            "parent_frame_id": WORLD,
            "child_frame_id": child,
            "translation": _position(row),
            "rotation": _orientation(row),
        }

    return convert


def fix(who: str) -> Callable[[Row], Message]:
    """For rows of `position` -> foxglove.LocationFix of the boat or the shadow."""

    def convert(row: Row) -> Message:
        return {
            "timestamp": _time(row),
            "frame_id": who,
            "latitude": row[f"{who}_latitude_deg"],
            "longitude": row[f"{who}_longitude_deg"],
            "altitude": 0.0,
            "position_covariance": [0.0] * 9,
            "position_covariance_type": COVARIANCE_UNKNOWN,
        }

    return convert


def log(row: Row) -> Message:
    """A row of `event` -> foxglove.Log."""
    return {
        "timestamp": _time(row),
        "level": LEVELS[row["severity"]],
        "message": row["says"],
        "name": row["kind"],
        "file": "",
        "line": 0,
    }


CHANNELS = (
    Channel("foxglove/boat_pose", "foxglove.PoseInFrame", "measured", pose),
    Channel("foxglove/shadow_pose", "foxglove.PoseInFrame", "shadow", pose),
    Channel("foxglove/boat_frame", "foxglove.FrameTransform", "measured", transform("boat")),
    Channel("foxglove/shadow_frame", "foxglove.FrameTransform", "shadow", transform("shadow")),
    Channel("foxglove/boat_fix", "foxglove.LocationFix", "position", fix("boat")),
    Channel("foxglove/shadow_fix", "foxglove.LocationFix", "position", fix("shadow")),
    Channel("foxglove/log", "foxglove.Log", "event", log),
)


def named(channel: Channel, name: str) -> Channel:
    """The same for one boat of several: topic and frames are its own, each has an origin too."""

    def convert(row: Row) -> Message:
        message = channel.convert(row)
        return message | {key: f"{name}/{message[key]}" for key in FRAMES if key in message}

    return channel._replace(topic=f"{name}/{channel.topic}", convert=convert)


UNTHINNED = "event"  # each says something of its own


class Shown(NamedTuple):
    """Messages of one channel, and which rows they were made from."""

    channel: Channel
    rows: list[int]
    payloads: list[bytes]


class RowThinning:
    """The first row of each topic in each step of time; all events."""

    def __init__(self, rate_hz: float) -> None:
        self._step_ns = round(1e9 / rate_hz)
        self._step: dict[str, int] = {}  # in which the last row was kept

    def of(self, topic: str, log_times: NDArray[np.int64]) -> list[int]:
        """Times (K,) [ns], K > 0 -> which rows are kept."""
        if topic == UNTHINNED:
            return list(range(len(log_times)))
        before, kept = self._step.get(topic, -1), list[int]()
        for k, time_ns in enumerate(log_times.tolist()):
            step = time_ns // self._step_ns
            if step > before:
                kept.append(k)
            before = step
        self._step[topic] = before
        return kept


class PlayerRows:
    """Rows of our topics -> what players know, for one boat and one file or server."""

    def __init__(self, rate_hz: float, channels: Sequence[Channel] = CHANNELS) -> None:
        self.channels = tuple(channels)
        self._thinning = RowThinning(rate_hz)
        self._of: dict[str, list[Channel]] = {}
        for channel in channels:
            self._of.setdefault(channel.source, []).append(channel)

    def of(
        self, given: TopicRows, wanted: Callable[[Channel], bool] = lambda channel: True
    ) -> Iterator[Shown]:
        """Messages of a topic -> the messages of each channel wanted."""
        channels = [channel for channel in self._of.get(given.topic, ()) if wanted(channel)]
        if not channels or not len(given):
            return
        chosen = self._thinning.of(given.topic, given.receive_time_ns)
        rows = given.chosen(chosen).messages()
        for channel in channels if rows else ():
            yield Shown(channel, chosen, [orjson.dumps(channel.convert(row)) for row in rows])
