"""The closed story of the loop in one command, `shadow hil-demo`: here, what is sailed in it.

What an autopilot is asked to sail, and what comes of it. One such autopilot is the stand-in: it
sails a task and leaves a .tlog.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Protocol

from gateway.errors import ShadowError
from gateway.files import write_whole
from gateway.hil.run import BoatLoop, LoopOptions, LoopPlan, run_loops
from gateway.links.transports import free_udp_port
from gateway.simulated_boat.play import tlog_bytes
from gateway.stand_in import MissionPilot, Pilot, PlanPilot, ReportSettings, StandIn
from sim.excitation import Plan, helm_gain
from sim.hil.day import Day
from sim.state import Progress
from sim.vessel import Vessel

LISTENS_S = 120.0  # a vessel that is compiled for the first time takes seconds


@dataclass(frozen=True)
class PlanTask:
    """A manoeuvre, open loop."""

    plan: Plan

    @property
    def longest_s(self) -> float:
        """More of the boat's time than it takes [s]."""
        return self.plan.seconds + 60.0


@dataclass(frozen=True)
class MissionTask:
    """Waypoints (north, east) [m] from the start, sailed at a throttle and the speed it makes."""

    waypoints: tuple[tuple[float, float], ...]
    throttle: float
    speed_mps: float
    radius_m: float = 2.0
    longest_s: float = 900.0


Task = PlanTask | MissionTask


@dataclass(frozen=True)
class Run:
    """What was sailed: the log of the autopilot, the recording of the loop, times [s]."""

    log: Path
    recording: Path
    seconds: float  # of the boat's time
    wall_s: float
    remarks: tuple[str, ...] = ()  # what the autopilot said that a reader should know


class Autopilot(Protocol):
    """Firmware, or what stands in for it."""

    @property
    def name(self) -> str:
        """What steers, in the words of the demo."""
        ...

    def sail(self, task: Task, boat: Vessel, day: Day, folder: Path, seed: int) -> Run:
        """Drive the boat in the loop; ShadowError where it cannot."""
        ...


@dataclass(frozen=True)
class OpenLoop:
    """A boat that waits for its autopilot: where, and what came of it when it has ended."""

    port: int
    loops: list[BoatLoop]

    @property
    def recording(self) -> Path:
        """The first file; there is another only after gigabytes."""
        (loop,) = self.loops
        assert loop.recording is not None
        return loop.recording.paths[0]


@contextmanager
def looped(
    boat: Vessel, name: str, day: Day, day_text: str | None, folder: Path, seed: int,
    progress: Progress = lambda text: None,
) -> Iterator[OpenLoop]:  # fmt: skip
    """`shadow hil` in a thread, on a port that nobody has, while inside."""
    opened = OpenLoop(free_udp_port(), [])
    plan = LoopPlan(f"json:127.0.0.1:{opened.port}", name, boat)
    options = LoopOptions(day=day, day_text=day_text, seed=seed, out=folder)
    stop, ready, errors = Event(), Event(), list[Exception]()

    def work() -> None:
        try:
            opened.loops[:] = run_loops([plan], options, progress, stop.is_set, ready.set)
        except Exception as error:
            errors.append(error)
        finally:
            ready.set()

    thread = Thread(target=work, name="boat in the loop", daemon=True)
    thread.start()
    try:
        if not ready.wait(LISTENS_S):
            raise ShadowError(f"{name}: the loop did not begin within {LISTENS_S:.0f} s")
        if errors:
            raise errors[0]
        yield opened
    finally:
        stop.set()
        thread.join()
    if errors:
        raise errors[0]


@dataclass(frozen=True)
class StandInAutopilot:
    """`vessel`: what it knows of its outputs."""

    vessel: Vessel
    name: str = "the stand-in (no firmware was given: --autopilot PATH)"

    def sail(self, task: Task, boat: Vessel, day: Day, folder: Path, seed: int) -> Run:
        """Drive the boat in the loop at the pace of this machine."""
        settings, begun = ReportSettings(seed=seed), time.monotonic()
        with looped(boat, folder.name, day, None, folder, seed) as loop:
            sent = StandIn(self.vessel, settings).drive(
                f"127.0.0.1:{loop.port}", self._pilot(task), task.longest_s
            )
        if sent[-1].time_s >= task.longest_s - 1.0:
            raise ShadowError(f"{folder.name}: not done after {task.longest_s:.0f} s of the boat")
        log = folder / f"{folder.name}.tlog"
        write_whole(log, tlog_bytes(sent, settings.unix_s), "the telemetry log")
        return Run(log, loop.recording, sent[-1].time_s, time.monotonic() - begun)

    def _pilot(self, task: Task) -> Pilot:
        if isinstance(task, PlanTask):
            return PlanPilot(task.plan)
        gain = helm_gain(self.vessel)
        return MissionPilot(task.waypoints, task.throttle, task.radius_m, gain)
