"""The stand-in as an autopilot of the demo: it sails a task and leaves a .tlog."""

import time
from dataclasses import dataclass
from pathlib import Path

from gateway.errors import ShadowError
from gateway.files import write_whole
from gateway.hil_demo.tasks import PlanTask, Run, Task, looped
from gateway.simulated_boat.log_file import tlog_bytes
from gateway.stand_in.autopilot import StandIn
from gateway.stand_in.pilots import MissionPilot, Pilot, PlanPilot
from gateway.stand_in.reports import ReportSettings
from sim.excitation.sticks import helm_gain
from sim.hil.day import Day
from sim.vessel import Vessel


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
