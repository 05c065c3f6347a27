"""The boats of all links: each is found by its autopilot's HEARTBEAT and gets a vessel's shadow.

A ground station is no boat. Pure in its inputs, like `LiveBoat`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.config import Settings
from gateway.ingest.log import Boat
from gateway.ingest.mavlink.boats import from_heartbeat
from gateway.links.inbox import Datagram, Frame
from gateway.live.boat import BoatOutput, LiveBoat
from gateway.shadow.path import ShadowPath
from gateway.vessel_file import zenoh_key
from sim.plants.table import OWN_VESSEL, PlantChoice
from sim.vessel import Vessel

MAX_BOATS = 32  # invented system ids may not use up files and memory


@dataclass(frozen=True)
class BoatPlan:
    """A vessel for one boat (by system id), or for any other (None)."""

    vessel: Vessel
    plant: PlantChoice = OWN_VESSEL
    system: int | None = None
    name: str | None = None  # on zenoh; default: the vessel's own

    @property
    def key(self) -> str:
        """Name on zenoh and of the recording."""
        return self.name or zenoh_key(self.vessel)


class FleetOutput(NamedTuple):
    """What came of a datagram or tick for one boat."""

    boat: LiveBoat
    output: BoatOutput


class Fleet:
    """The shadows of all boats; `found` and `ignored` are called with each new boat."""

    def __init__(
        self,
        plans: Sequence[BoatPlan],
        settings: Settings,
        found: Callable[[LiveBoat, BoatPlan], None] = lambda boat, plan: None,
        ignored: Callable[[Boat], None] = lambda boat: None,
    ) -> None:
        self.boats: dict[int, LiveBoat] = {}
        self._ignored_systems: set[int] = set()  # that no plan is for
        self._plans = tuple(plans)
        self._found, self._ignored = found, ignored
        following = settings.following
        self._paths = [
            ShadowPath.of(
                plan.vessel,
                plan.plant,
                settings.filter,
                reference=following.reference,
                follower=following.follower,
                rate_hz=following.rate_hz,
            )
            for plan in plans
        ]

    def warm_up(self) -> None:
        """Compile everything before a link is open, by a few messages of a throw-away boat."""
        for path, plan in zip(self._paths, self._plans, strict=True):
            boat = LiveBoat(Boat(1, 1), plan.key, path)
            for k in range(4):
                list(boat.datagram(_warm_up_messages(1000 + 20 * k), (k + 1) * 20_000_000))
            list(boat.tick(400_000_000))

    def datagram(self, datagram: Datagram) -> Iterator[FleetOutput]:
        """The frames of a datagram, each to its boat -> what comes of them, as it is made."""
        by_system: dict[int, list[Any]] = {}
        for frame in datagram.frames:
            message = frame.message
            if message is None:
                continue
            if message.get_type() == "HEARTBEAT":
                self._find_boat(message)
            boat = self.boats.get(message.get_srcSystem())
            if boat is not None and message.get_srcComponent() == boat.boat.component:
                by_system.setdefault(boat.boat.system, []).append(message)
        for system, messages in by_system.items():
            boat = self.boats[system]
            for output in boat.datagram(messages, datagram.receive_time_ns):
                yield FleetOutput(boat, output)

    def due(self, now_ns: int) -> list[LiveBoat]:
        """The boats that have been silent for so long that they want a tick."""
        return [boat for boat in self.boats.values() if boat.wants_tick(now_ns)]

    def tick(self, now_ns: int) -> Iterator[FleetOutput]:
        """A moment without telemetry: the shadows of silent boats run on."""
        for boat in self.due(now_ns):
            for output in boat.tick(now_ns):
                yield FleetOutput(boat, output)

    def frames_of(self, frames: Sequence[Frame], boat: LiveBoat) -> list[bytes]:
        """The frames for a boat's recording: its own, and those of no boat."""
        others = self.boats.keys() - {boat.boat.system}
        return [
            f.raw for f in frames if f.message is None or f.message.get_srcSystem() not in others
        ]

    def _find_boat(self, heartbeat: Any) -> None:
        system = heartbeat.get_srcSystem()
        if system in self.boats or system in self._ignored_systems:
            return
        boat = from_heartbeat(heartbeat)
        if boat is None:
            return
        index = self._plan_for(system)
        if index is None or len(self.boats) >= MAX_BOATS:
            self._ignored_systems.add(system)
            self._ignored(boat)
            return
        plan = self._plans[index]
        self.boats[system] = LiveBoat(boat, self._name(plan, system), self._paths[index])
        self._found(self.boats[system], plan)

    def _name(self, plan: BoatPlan, system: int) -> str:
        """The plan's name, with the system id where another boat or plan has it too."""
        taken = {boat.name for boat in self.boats.values()}
        taken |= {other.key for other in self._plans if other is not plan}
        name = plan.key
        while name in taken:
            name = f"{name}-{system}"
        return name

    def _plan_for(self, system: int) -> int | None:
        """The plan for this very boat, else the one for any."""
        for wanted in (system, None):
            for index, plan in enumerate(self._plans):
                if plan.system == wanted:
                    return index
        return None


def _warm_up_messages(boot_ms: int) -> list[Any]:
    """Messages that take every compiled step once."""
    messages: list[Any] = [
        dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0),
        dialect.MAVLink_local_position_ned_message(boot_ms, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0),
        dialect.MAVLink_global_position_int_message(
            boot_ms, 600000000, 100000000, 0, 0, 10, 0, 0, 500
        ),
        dialect.MAVLink_servo_output_raw_message(boot_ms * 1000, 0, *([1500] * 8)),
        dialect.MAVLink_sys_status_message(0, 0, 0, 0, 14800, 0, 0, 0, 0, 0, 0, 0, 0),
    ]
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    return [mav.decode(bytearray(message.pack(mav))) for message in messages]
