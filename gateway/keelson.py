"""The shadow under Keelson's keys too, for its recorders, players and displays (RISE, Sweden).

    BASE/@v0/<vessel>/pubsub/<subject>/shadow_gateway/estimate         how the real boat moves
    BASE/@v0/<vessel>/pubsub/<subject>/shadow_gateway/command          force of its actuators
    BASE/@v0/<vessel>/pubsub/<subject>/shadow_gateway/missing          force that the model lacks
    BASE/@v0/<vessel>_shadow/pubsub/<subject>/shadow_gateway/shadow    how the shadow moves

Subjects are Keelson's well-known ones, payloads their protobuf messages in its envelope. The shadow
is an entity of its own: who subscribes to a boat's speed or position from any source is never given
a simulation. What Keelson has no subject for (health, current, numbers of the vessel) stays under
`shadow/…`. The package `keelson` is an extra and imported when a publisher is opened.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Any, NamedTuple, Self

import orjson
import zenoh

from gateway.errors import BadInput

DEFAULT_BASE = "keelson"
ESTIMATE, COMMAND, MISSING, SHADOW, EVENTS = "estimate", "command", "missing", "shadow", "events"
SOURCE = "shadow_gateway"
KNOTS = 3600.0 / 1852.0  # of one m/s
FRAME = "body_frd"  # of forces: x to the bow, y to starboard, z down, at the vessel's origin
COURSE_SIGMAS = 2.0  # a course of a speed below this many standard deviations is noise

Message = Mapping[str, Any]


class Output(NamedTuple):
    """One value for Keelson. A tuple is a vector, or latitude and longitude; text is an event's."""

    source: str
    subject: str
    value: float | tuple[float, ...] | str


def _motion(source: str) -> Callable[[Message], Iterator[Output]]:
    def outputs(message: Message) -> Iterator[Output]:
        u, v, yaw = message["surge_mps"], message["sway_mps"], message["yaw_rad"]
        values = {
            "surge_velocity_mps": u,
            "sway_velocity_mps": v,
            "yaw_rate_degps": math.degrees(message["yaw_rate_radps"]),
            "surge_acceleration_mpss": message["surge_mps2"],
            "sway_acceleration_mpss": message["sway_mps2"],
            "heading_true_north_deg": math.degrees(yaw) % 360.0,
            "heading_accuracy_deg": math.degrees(message["yaw_rad_std"]),
            "speed_over_ground_knots": math.hypot(u, v) * KNOTS,
        }
        noise = math.hypot(message["surge_mps_std"], message["sway_mps_std"])
        if math.hypot(u, v) > COURSE_SIGMAS * noise:
            values["course_over_ground_deg"] = math.degrees(yaw + math.atan2(v, u)) % 360.0
        yield from (Output(source, subject, value) for subject, value in values.items())

    return outputs


def _position(message: Message) -> Iterator[Output]:
    for source, body in ((ESTIMATE, "boat"), (SHADOW, "shadow")):
        place = message[f"{body}_latitude_deg"], message[f"{body}_longitude_deg"]
        yield Output(source, "location_fix", place)


def _force(source: str, prefix: str) -> Callable[[Message], Iterator[Output]]:
    def outputs(message: Message) -> Iterator[Output]:
        surge, sway, yaw = (message[f"{prefix}{name}"] for name in ("surge_n", "sway_n", "yaw_nm"))
        yield Output(source, "force_newton", (surge, sway, 0.0))
        yield Output(source, "moment_newton_meter", (0.0, 0.0, yaw))

    return outputs


def _event(message: Message) -> Iterator[Output]:
    yield Output(EVENTS, "log_message", message["says"])


TOPICS: Mapping[str, tuple[Callable[[Message], Iterator[Output]], ...]] = {
    "measured": (_motion(ESTIMATE),),
    "shadow": (_motion(SHADOW),),
    "position": (_position,),
    "control": (_force(SHADOW, ""), _force(COMMAND, "command_")),
    "residual": (_force(MISSING, "missing_"),),
    "event": (_event,),
}


def check_base(base: str) -> str:
    """The base path of keys, or BadInput where zenoh cannot have it."""
    if not base or any(not part or set(part) & set("*$?#@") for part in base.split("/")):
        raise BadInput(f"[zenoh] keelson = {base!r}: expected a path such as fleet/north")
    return base


class KeelsonPublisher:
    """What `Bus` publishes of one vessel, on the same session, under Keelson's keys.

    Publishers are declared as their subjects come; what nobody listens to is not encoded. A
    subscriber that is too slow loses samples.
    """

    def __init__(self, session: zenoh.Session, base: str, vessel: str) -> None:
        try:
            import keelson
            from keelson.payloads.foxglove.Log_pb2 import Log
        except ImportError:
            raise BadInput(
                "--publish keelson needs keelson: pip install 'shadow-gateway[keelson]'"
            ) from None
        self._keelson, self._levels = keelson, Log.Level
        self._session, self._base, self._vessel = session, base, vessel
        self._scope = ExitStack()
        self._publishers: dict[str, dict[tuple[str, str], zenoh.Publisher]] = {}  # by topic

    def __enter__(self) -> Self:
        for source in (ESTIMATE, COMMAND, MISSING, SHADOW, EVENTS):
            key = self._keelson.construct_liveliness_key(
                self._base, self._entity(source), f"{SOURCE}/{source}"
            )
            self._scope.callback(self._session.liveliness().declare_token(key).undeclare)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._publishers.clear()
        self._scope.close()

    def wants(self, topic: str) -> bool:
        """Does anyone listen to what this topic becomes? True until it was published once."""
        if topic not in self._publishers:
            return topic in TOPICS
        return any(_heard(publisher) for publisher in self._publishers[topic].values())

    def publish(self, topic: str, payload: bytes) -> None:
        """Publish a message of one of our topics (JSON) as what Keelson calls its members."""
        if not self.wants(topic):
            return
        message = orjson.loads(payload)
        for outputs in TOPICS[topic]:
            for output in outputs(message):
                publisher = self._publisher(topic, output)
                if _heard(publisher):
                    publisher.put(self.envelope(output, message))

    def envelope(self, output: Output, message: Message) -> bytes:
        """The value in its subject's protobuf message, stamped with its receipt, enclosed now."""
        schema = self._keelson.get_subject_schema(output.subject)
        payload: Any = self._keelson.get_protobuf_message_class_from_type_name(schema)()
        payload.timestamp.FromNanoseconds(message["receive_time_ns"])
        match output.value:
            case str(text):
                payload.message, payload.name = text, message["kind"]
                payload.level = self._levels.Value(message["severity"].upper())
            case (latitude, longitude):
                payload.latitude, payload.longitude, payload.frame_id = latitude, longitude, "wgs84"
            case (x, y, z):
                payload.vector.x, payload.vector.y, payload.vector.z = x, y, z
                payload.frame_id = FRAME
            case value:
                payload.value = value
        enclosed: bytes = self._keelson.enclose(payload.SerializeToString())
        return enclosed

    def _publisher(self, topic: str, output: Output) -> zenoh.Publisher:
        known, place = self._publishers.setdefault(topic, {}), (output.source, output.subject)
        if place not in known:
            key = self._keelson.construct_pubsub_key(
                self._base, self._entity(output.source), output.subject, f"{SOURCE}/{output.source}"
            )
            publisher = self._session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP
            )
            self._scope.callback(publisher.undeclare)
            known[place] = publisher
        return known[place]

    def _entity(self, source: str) -> str:
        return f"{self._vessel}_shadow" if source == SHADOW else self._vessel


def _heard(publisher: zenoh.Publisher) -> bool:
    # Documented as a bool, but an object with one in the versions seen so far.
    status: Any = publisher.matching_status
    return bool(getattr(status, "matching", status))
