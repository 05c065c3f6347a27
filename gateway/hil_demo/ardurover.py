"""ArduRover as a program (SITL), unmodified: started for one run, told what to sail, ended.

A plan is played by the very Lua script that `shadow plan` writes for the boat; the log is the
firmware's own.
"""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from gateway.errors import BadInput, ShadowError
from gateway.files import write_whole
from gateway.hil_demo.ground_station import GroundStation
from gateway.hil_demo.tasks import MissionTask, PlanTask, Run, Task, looped
from gateway.links.udp import free_udp_port
from gateway.offline.plan_export import safety_for, write_script
from gateway.simulated_boat.telemetry import parameters
from sim.hil.day import Day
from sim.vessel import Vessel

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
