"""Outputs of the vessel file that never get a pulse while others do: its motors are not there.

A motor on the wrong channel is none that failed: the model would run without its thrust, and every
error that follows would be called a current, a drag or another motor.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gateway.shadow import FilterInputs
from gateway.shadow.sensor_checks import SensorFault
from sim.state import Floats, Ints
from sim.vessel import Vessel

UNDRIVEN = int(SensorFault.UNDRIVEN)
GRACE_S = 5.0  # since the first pulse: outputs may be reported in several messages; chosen


class DrivenOutputs(NamedTuple):
    """Which outputs of a vessel had a pulse so far, and since when any output has one [s]."""

    channels: tuple[int, ...] = ()
    driven: tuple[bool, ...] = ()
    since: float = np.inf

    @classmethod
    def start(cls, vessel: Vessel) -> "DrivenOutputs":
        """Before the first pulse."""
        channels = tuple(actuator.servo.channel for actuator in vessel.actuators)
        return cls(channels, (False,) * len(channels))

    def check(self, inputs: FilterInputs) -> tuple["DrivenOutputs", Ints | None]:
        """K inputs in order of receipt -> the outputs after them, bits of `SensorFault` (K,); None
        where all are driven.
        """
        if all(self.driven) or not len(inputs):
            return self, None
        pulses = inputs.pulse_table.pulses[:, [channel - 1 for channel in self.channels]]
        own = np.isfinite(pulses)[inputs.pulse_row]
        seen = np.logical_or.accumulate(own, axis=0) | np.array(self.driven)
        active, times = inputs.active > 0.0, inputs.events.time_s
        since = min(self.since, float(times[active.argmax()])) if active.any() else self.since
        idle = active & ~seen.all(axis=1) & (times - since >= GRACE_S)
        after = self._replace(driven=tuple(seen[-1].tolist()), since=since)
        return after, np.where(idle, UNDRIVEN, 0)


def undriven_text(outputs: Iterable[tuple[int, str]], pulses: Floats) -> str:
    """Channels and names of actuators, pulses (32,) [µs], NaN where there is none -> which get
    none, and which outputs do.
    """
    some = (np.flatnonzero(np.isfinite(pulses)) + 1).tolist()
    idle = [f"output {channel} ({name})" for channel, name in outputs if channel not in some]
    verb = "gets" if len(idle) == 1 else "get"
    others = ", ".join(map(str, some))
    return (
        f"{' and '.join(idle)} of the vessel file {verb} no pulse, while {others} "
        f"{'does' if len(some) == 1 else 'do'} (is `channel` right?)"
    )
