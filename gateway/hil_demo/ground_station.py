"""A small ground station for the firmware that the demo has started: one link on this machine.

It asks for messages, uploads a mission, changes modes, arms, and moves one channel of the remote.
All waiting is counted in the boat's own time, which runs as fast as the loop allows.
"""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import ShadowError
from gateway.links.transport import Endpoint, Peer, Waker
from gateway.links.udp import UdpTransport

STATION = 255
MODES = {"HOLD": 4, "AUTO": 10, "GUIDED": 15}  # of Rover
ASKED_HZ = {"ATTITUDE": 10, "LOCAL_POSITION_NED": 10, "EKF_STATUS_REPORT": 5, "HEARTBEAT": 5}
SILENT_S = 30.0  # of the clock on the wall: then the firmware is gone
READY = 0x3F  # attitude, both velocities, both positions, height of EKF_STATUS_REPORT
NOT_READY = 128 | 1024  # constant position, uninitialised
WAYPOINT, METRES_PER_DEGREE = mavlink.MAV_CMD_NAV_WAYPOINT, 111319.5


class GroundStation:
    """Waits on 127.0.0.1:PORT for the one vehicle that will call; open while inside."""

    def __init__(self, port: int) -> None:
        address = f"127.0.0.1:{port}"
        self._transport = UdpTransport(Endpoint(f"udpin:{address}", "udpin", address))
        self._waker = Waker()
        self._peer: Peer | None = None
        self._mav: Any = mavlink.MAVLink(None, STATION, 190)
        self._mav.robust_parsing = True
        self._last: dict[str, Any] = {}
        self._heard = time.monotonic()
        self.texts: list[str] = []

    def __enter__(self) -> Self:
        self._transport.open(self._waker, lambda kind, text: None)
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()
        self._waker.__exit__()

    @property
    def now(self) -> float:
        """The boat's time [s]."""
        return float(self._last["ATTITUDE"].time_boot_ms) / 1e3 if "ATTITUDE" in self._last else 0.0

    def begin(self) -> None:
        """Wait for its first words and until it knows where it is."""
        self._until(lambda: "HEARTBEAT" in self._last, 60.0, "the firmware to speak")
        for name, hertz in ASKED_HZ.items():
            number = next(n for n, kind in mavlink.mavlink_map.items() if kind.msgname == name)
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hertz)
        self._until(self._knows_where, 180.0, "its filter to be healthy")

    def mode(self, name: str) -> None:
        """Change the mode."""
        self._repeat(
            lambda: self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, MODES[name]),
            lambda: self._last["HEARTBEAT"].custom_mode == MODES[name],
            f"the mode {name}",
        )

    def arm(self) -> None:
        """Arm, as often as it takes until its checks are passed."""
        self._repeat(
            lambda: self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1),
            lambda: bool(self._last["HEARTBEAT"].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            "it to arm",
        )

    def upload(self, waypoints: Sequence[tuple[float, float]]) -> None:
        """A mission: metres north and east of where the boat is now; item 0 is home."""
        self._until(lambda: "GLOBAL_POSITION_INT" in self._last, 60.0, "its position")
        here = self._last["GLOBAL_POSITION_INT"]
        per_east = METRES_PER_DEGREE * math.cos(math.radians(here.lat / 1e7))
        items = [
            mavlink.MAVLink_mission_item_int_message(
                1, 1, k, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, WAYPOINT, 0, 1, 0, 0, 0, 0,
                here.lat + round(1e7 * north / METRES_PER_DEGREE),
                here.lon + round(1e7 * east / per_east), 0,
            )
            for k, (north, east) in enumerate([(0.0, 0.0), *waypoints])
        ]  # fmt: skip

        def asked(message: Any) -> None:
            if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                self._send(items[min(message.seq, len(items) - 1)])

        self._last.pop("MISSION_ACK", None)
        self._repeat(
            lambda: self._send(mavlink.MAVLink_mission_count_message(1, 1, len(items))),
            lambda: "MISSION_ACK" in self._last,
            "the mission to be taken",
            asked,
        )

    def wait_for_waypoint(self, number: int, seconds: float) -> None:
        """Until that item of the mission is reached."""
        reached: set[int] = set()

        def note(message: Any) -> None:
            if message.get_type() == "MISSION_ITEM_REACHED":
                reached.add(message.seq)

        self._until(lambda: number in reached, seconds, f"waypoint {number}", note)

    def switch(self, channel: int, high: bool) -> None:
        """Hold one channel of the remote; others stay as they are."""
        pulses = [65535] * 8
        pulses[channel - 1] = 1900 if high else 1100
        self._send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pulses))

    def wait_for_text(
        self, begins: Sequence[str], seconds: float, meanwhile: Callable[[], None]
    ) -> str:
        """Until a message to the user begins so -> that message; `meanwhile` twenty times a s."""
        seen = len(self.texts)

        def found() -> str | None:
            return next((t for t in self.texts[seen:] if t.startswith(tuple(begins))), None)

        self._until(lambda: found() is not None, seconds, f'"{begins[0]}…"', each=meanwhile)
        return found() or ""

    def rest(self, seconds: float) -> None:
        """Let that much of the boat's time pass."""
        begun = self.now
        self._until(lambda: self.now >= begun + seconds, 10.0 * seconds + 60.0, "time to pass")

    def _knows_where(self) -> bool:
        report = self._last.get("EKF_STATUS_REPORT")
        return report is not None and report.flags & READY == READY and not report.flags & NOT_READY

    def _repeat(
        self,
        act: Callable[[], None],
        done: Callable[[], bool],
        what: str,
        note: Callable[[Any], None] = lambda message: None,
    ) -> None:
        """Do it again every two seconds of the boat until it is done."""
        for _ in range(60):
            act()
            self._until(DoneOrLater(done, self), 60.0, what, note)
            if done():
                return
        said = f"; it said: {self.texts[-1]}" if self.texts else ""
        raise ShadowError(f"waited for {what} in vain{said}")

    def _until(
        self,
        done: Callable[[], bool],
        seconds: float,
        what: str,
        note: Callable[[Any], None] = lambda message: None,
        each: Callable[[], None] = lambda: None,
    ) -> None:
        """Listen until something is so, or that much of the boat's time has passed."""
        begun, next_s = self.now, 0.0
        while not done():
            for message in self._listen():
                note(message)
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + 0.05
                each()
            if self.now - (begun or self.now) > seconds or self._silent():
                said = f"; it said last: {self.texts[-1]}" if self.texts else ""
                raise ShadowError(f"waited for {what} in vain{said}")

    def _silent(self) -> bool:
        return time.monotonic() - self._heard > SILENT_S

    def _listen(self) -> list[Any]:
        """What arrives within 50 ms."""
        out = []
        for arrival in self._transport.receive(0.05):
            self._heard, self._peer = time.monotonic(), arrival.peer
            for message in self._mav.parse_buffer(arrival.data) or ():
                kind = message.get_type()
                if kind == "BAD_DATA" or message.get_srcSystem() != 1:
                    continue
                self._last[kind] = message
                if kind == "STATUSTEXT":
                    self.texts.append(message.text)
                out.append(message)
        return out

    def _command(self, command: int, *values: float) -> None:
        padded = [*values, *[0.0] * (7 - len(values))]
        self._send(mavlink.MAVLink_command_long_message(1, 0, command, 0, *padded))

    def _send(self, message: Any) -> None:
        if self._peer is not None:
            self._transport.send(bytes(message.pack(self._mav)), self._peer)
            self._mav.seq = (self._mav.seq + 1) % 256


class DoneOrLater:
    """True when something is so, or two seconds of the boat after it was asked for."""

    def __init__(self, done: Callable[[], bool], station: GroundStation) -> None:
        self._done, self._station, self._end = done, station, station.now + 2.0

    def __call__(self) -> bool:
        return self._done() or self._station.now > self._end
