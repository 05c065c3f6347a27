"""What an autopilot is asked to sail, and what comes of it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Protocol

from gateway.errors import ShadowError
from gateway.hil.run import BoatLoop, LoopOptions, LoopPlan, run_loops
from gateway.links.udp import free_udp_port
from sim.excitation.sticks import Plan
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
