"""A gateway without sockets: played boats speak into it, and its clock is theirs."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.config import FollowingSettings, Settings, ZenohSettings
from gateway.json_rows import TopicRows
from gateway.links import Datagram, Frame
from gateway.live.boats import BoatPlan, LiveBoat
from gateway.live.gateway import Gateway, LiveOptions
from gateway.recording.recorder import RecordingSettings, TopicsKept
from gateway.simulated_boat import FAST, SimulatedBoatSettings
from gateway.simulated_boat import TimedFrame as OnWire
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.simulated_boat.hull import program_of
from sim.following.follower import ReferenceMode
from sim.state import Floats
from sim.vessel import Vessel
from tests.sim.vessels import WAMV

UNIX_S = 1_700_000_000.0
DELAY_S = 0.004  # on the way
TURN_NS = 25_000_000  # the loop's longest sleep
SETTINGS = Settings(
    following=FollowingSettings(reference=ReferenceMode.AUTO),
    zenoh=ZenohSettings(publish=False),
    recording=RecordingSettings(minimum_free_bytes=1, topics=TopicsKept.ALL),
)
LINK = "udpin:played"


def played(
    seconds: float, vessel: Vessel = WAMV, program: str = "mixed", seed: int = 0, **settings: Any
) -> list[OnWire]:
    """What arrives from a boat that is played for so long."""
    given = SimulatedBoatSettings(**{"rates": FAST, **settings})
    boat = SimulatedBoat(vessel, given, seed, program_of(vessel, program, seed))
    return boat.advance(boat.start(), seconds)[1]


def truth(seconds: float, **settings: Any) -> Floats:
    """(K, 3): where that boat really is, time [s since play began], north, east [m]."""
    boat = SimulatedBoat(WAMV, SimulatedBoatSettings(**{"rates": FAST, **settings}), 0)
    state, rows = boat.start(), list[tuple[float, float, float]]()
    for time in np.arange(0.0, seconds, 0.1).tolist():
        state = boat.advance(state, time)[0]
        rows.append((time, float(state.hull[0]), float(state.hull[1])))
    return np.array(rows)


def datagrams(*boats: Iterable[OnWire], link: str = LINK) -> list[Datagram]:
    """What boats say over one link, a datagram for each frame, in order of receipt."""
    decoder = dialect.MAVLink(None)
    wires = sorted((frame for boat in boats for frame in boat), key=lambda frame: frame.time_s)
    return [
        Datagram(
            link, at_ns(wire.time_s), (Frame(wire.data, decoder.decode(bytearray(wire.data))),)
        )
        for wire in wires
    ]


def at_ns(time_s: float) -> int:
    """Receipt of what was sent then."""
    return round((UNIX_S + time_s + DELAY_S) * 1e9)


@dataclass
class Heard:
    """Messages of one boat by topic, as JSON text and as objects."""

    payloads: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))

    def add(self, rows: Iterable[TopicRows]) -> None:
        for part in rows:
            self.payloads[part.topic] += part.payloads

    def messages(self, topic: str) -> list[dict[str, Any]]:
        return [orjson.loads(payload) for payload in self.payloads[topic]]

    def column(self, topic: str, name: str) -> list[float]:
        return [message[name] for message in self.messages(topic)]

    def events(self) -> list[str]:
        return [message["kind"] for message in self.messages("event")]


class Listener:
    """Stands in for the bus of a boat."""

    def __init__(self) -> None:
        self.heard = Heard()

    def publish_rows(self, rows: Iterable[TopicRows]) -> None:
        self.heard.add(rows)


class Deck:
    """A gateway that is turned by hand."""

    def __init__(
        self,
        plans: Sequence[BoatPlan] = (BoatPlan(WAMV),),
        out: Path | None = None,
        settings: Settings = SETTINGS,
    ) -> None:
        self.now_ns = at_ns(0.0)
        self.told: list[str] = []
        self.gateway = Gateway(
            plans, LiveOptions((), out, silent=True, settings=settings), self.told.append,
            clock=lambda: self.now_ns, steady=lambda: self.now_ns, strict=True,
        )  # fmt: skip
        self._listeners: dict[int, Listener] = {}
        self._found, self.gateway.fleet._found = self.gateway.fleet._found, self._listen

    def __enter__(self) -> "Deck":
        self.gateway.__enter__()
        return self

    def __exit__(self, *exception: Any) -> None:
        self.gateway.__exit__(*exception)

    def hear(self, items: Iterable[Datagram], until_s: float | None = None) -> "Deck":
        """Datagrams at the time of their receipt, turns of the loop in between and after."""
        for item in items:
            self._idle(item.receive_time_ns)
            self.now_ns = max(self.now_ns, item.receive_time_ns)
            self.gateway.turn(item)
        if until_s is not None:
            self._idle(at_ns(until_s))
        return self

    def heard(self, system: int = 1) -> Heard:
        return self._listeners[system].heard

    def _idle(self, until_ns: int) -> None:
        while self.now_ns + TURN_NS < until_ns:
            self.now_ns += TURN_NS
            self.gateway.turn(None)

    def _listen(self, boat: LiveBoat, plan: BoatPlan) -> None:
        self._found(boat, plan)
        self._listeners[boat.boat.system] = Listener()
        self.gateway.outputs[boat.boat.system].bus = self._listeners[boat.boat.system]  # type: ignore[assignment]
