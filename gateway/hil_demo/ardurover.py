"""ArduRover as a program (SITL), unmodified: started for one run, told what to sail, ended.

A plan is played by the very Lua script that `shadow plan` writes for the boat; the log is the
firmware's own.

**The ground station** is a small one, on one link of this machine. It asks for messages,
uploads a mission, changes modes, arms, and moves one channel of the remote. All waiting is counted
in the boat's own time, which runs as fast as the loop allows.
"""

import math
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput, ShadowError
from gateway.files import write_whole
from gateway.hil_demo import MissionTask, PlanTask, Run, Task, looped
from gateway.links import Endpoint, Peer, Waker
from gateway.links.transports import UdpTransport, free_udp_port
from gateway.offline.plan import safety_for, write_script
from gateway.simulated_boat.telemetry import parameters
from sim.hil.day import Day
from sim.vessel import Vessel

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


SPEED_UP = 40  # what it is asked for; what it gives depends on the machine
HOME = "51.5,-0.1,0,0"
SWITCH = 7  # channel of the remote that starts the script
RADIUS_M = 500.0  # nothing is there to run into
GYRO_FILTER_HZ = 4.0
SAID, SAID_BYTES = "firmware.txt", 65536
FIXED = {
    "CRUISE_THROTTLE": 50, "SCR_ENABLE": 1, "SCR_HEAP_SIZE": 200000, f"RC{SWITCH}_OPTION": 300,
    "SIM_RATE_HZ": 200, "FS_GCS_ENABLE": 0, "FS_THR_ENABLE": 0, "BATT_MONITOR": 4,
    "LOG_FILE_DSRMROT": 0, "SIM_SPEEDUP": SPEED_UP,
    "RC_OVERRIDE_TIME": -1,  # never: its 3 s of the boat pass in 0.1 s here, and the switch falls
}  # fmt: skip


@dataclass(frozen=True)
class ArduRover:
    """The firmware at `program`; `vessel`: whose outputs it is told of."""

    program: Path
    vessel: Vessel
    name: str = "ArduRover"

    @classmethod
    def of(cls, program: Path, vessel: Vessel) -> "ArduRover":
        """BadInput where there is no such program, or it cannot steer this vessel."""
        if not (program.is_file() and os.access(program, os.X_OK)):
            raise BadInput(f"{program}: no program: expected ardurover, built for SITL")
        if vessel.rudders:
            raise BadInput(f"{vessel.name}: has rudders: the demo sets the firmware for thrusters")
        return cls(program.resolve(), vessel, f"ArduRover ({program})")

    def sail(self, task: Task, boat: Vessel, day: Day, folder: Path, seed: int) -> Run:
        """Start it, wait until it knows where it is, arm, sail, end it."""
        begun, port = time.monotonic(), free_udp_port()
        with TemporaryDirectory(prefix="shadow-firmware-") as name:
            place = Path(name)  # nothing of an earlier run: no parameters, no mission
            self._write_task(task, place)
            with (
                looped(boat, folder.name, day, None, folder, seed) as loop,
                GroundStation(port) as station,
                self._running(place, loop.port, port),
            ):
                try:
                    station.begin()
                    remarks = self._sail(task, station)
                except ShadowError as error:
                    said = (place / SAID).read_bytes()[-SAID_BYTES:]
                    write_whole(folder / SAID, said, "what the firmware said")
                    raise ShadowError(f"{self.name}: {error} ({folder / SAID})") from None
                seconds = station.now
            logs = sorted((place / "logs").glob("*.BIN"))
            if not logs:
                raise ShadowError(f"{folder.name}: {self.name} has left no log")
            log = folder / f"{folder.name}.BIN"
            write_whole(log, logs[-1].read_bytes(), "the log of the firmware")
        return Run(log, loop.recording, seconds, time.monotonic() - begun, remarks)

    def _sail(self, task: Task, station: GroundStation) -> tuple[str, ...]:
        if isinstance(task, MissionTask):
            station.upload(task.waypoints)
            station.mode("GUIDED")
            station.arm()
            station.mode("AUTO")
            station.wait_for_waypoint(len(task.waypoints), task.longest_s)
            station.rest(3.0)
            return ()
        station.mode("GUIDED")
        station.arm()
        station.wait_for_text(["Plan: starts", "Plan: will"], 120.0, Switching(station))
        end = station.wait_for_text(
            ["Plan: done", "Plan: stopped", "Plan: error"],
            task.longest_s,
            lambda: station.switch(SWITCH, high=True),
        )
        station.rest(3.0)
        return () if end.startswith("Plan: done") else (f"it ended early: {end}",)

    def _write_task(self, task: Task, folder: Path) -> None:
        """Parameters, and the script of a plan, where the firmware will look for them."""
        if isinstance(task, PlanTask):
            safety = safety_for(task.plan, RADIUS_M, None, None)
            script = folder / "scripts" / "plan.lua"
            write_script(task.plan, safety, version("shadow-gateway"), script)
        values = {
            name: value
            for name, value in parameters(self.vessel, 1, GYRO_FILTER_HZ).items()
            if name.startswith(("SERVO", "FRAME_CLASS", "INS_GYRO"))
        }
        values |= {name: float(value) for name, value in FIXED.items()}
        if isinstance(task, MissionTask):
            values |= {
                "WP_SPEED": task.speed_mps, "CRUISE_SPEED": task.speed_mps,
                "CRUISE_THROTTLE": 100.0 * task.throttle, "WP_RADIUS": task.radius_m,
            }  # fmt: skip
        text = "".join(f"{name} {value:g}\n" for name, value in values.items())
        write_whole(folder / "boat.parm", text.encode(), "the parameters")

    @contextmanager
    def _running(self, folder: Path, sensors: int, station: int) -> Iterator[None]:
        """The program in that folder while inside."""
        command = [
            str(self.program), "--model", "json:127.0.0.1", "--sim-port-out", str(sensors),
            "--home", HOME, "--defaults", "boat.parm", "--speedup", str(SPEED_UP),
            "--serial0", f"udpclient:127.0.0.1:{station}", "--serial1", "none",
            "--serial2", "none",
        ]  # fmt: skip
        with (folder / SAID).open("wb") as said:
            try:
                process = subprocess.Popen(
                    command, cwd=folder, stdin=subprocess.DEVNULL, stdout=said, stderr=said
                )
            except OSError as error:
                raise BadInput(f"{self.program}: does not run: {error.strerror}") from None
            try:
                yield
            finally:
                process.terminate()
                try:
                    process.wait(5.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


class Switching:
    """The switch of the remote: low for a while, so that the script sees it, then high."""

    LOW_S = 4.0  # of the boat: the script looks twenty times a second once it is loaded

    def __init__(self, station: GroundStation) -> None:
        self._station, self._begun = station, station.now

    def __call__(self) -> None:
        self._station.switch(SWITCH, high=self._station.now - self._begun > self.LOW_S)
