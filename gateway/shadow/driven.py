"""Outputs of the vessel file that never get a pulse while others do: its motors are not there.

A motor on the wrong channel is none that failed: the model would run without its thrust, and every
error that follows would be called a current, a drag or another motor.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.shadow import FilterInputs
from gateway.shadow.sensor_checks import SETTLE_S, SETTLING, UNDRIVEN
from sim.state import Floats, Ints
from sim.vessel import Vessel

GRACE_S = 5.0  # since the first pulse: outputs may be reported in several messages; chosen


class DrivenOutputs(NamedTuple):
    """Which outputs of a vessel had a pulse so far.

    channels, names  of its actuators
    since   when any output had a pulse first [s]
    whole   when the last of its own had one first [s]
    """

    channels: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    driven: tuple[bool, ...] = ()
    since: float = np.inf
    whole: float = -np.inf

    @classmethod
    def start(cls, vessel: Vessel) -> "DrivenOutputs":
        """Before the first pulse."""
        each = vessel.actuators
        channels, names = tuple(a.servo.channel for a in each), tuple(a.name for a in each)
        return cls(channels, names, (False,) * len(each), whole=np.inf if each else -np.inf)

    def check(
        self, inputs: FilterInputs
    ) -> tuple["DrivenOutputs", tuple[Ints, NDArray[np.bool_]] | None]:
        """K inputs in order of receipt -> the outputs after them; bits of `SensorFault` (K,) and
        which outputs had a pulse by then (K, na), None where all is well.

        Once one is missed that lasts until it has a pulse, whether the boat is armed or not; and a
        while longer, for predictions that began without its thrust.
        """
        times = inputs.events.time_s
        if not len(times) or (all(self.driven) and self._has_settled(float(times[0]))):
            return self, None
        columns = np.array(self.channels, np.int64) - 1
        own = np.isfinite(inputs.pulse_table.pulses[np.ix_(inputs.pulse_row, columns)])
        seen = np.logical_or.accumulate(own, axis=0) | np.array(self.driven)
        some, every = inputs.active > 0.0, seen.all(axis=1)
        since = min(self.since, float(times[some.argmax()])) if some.any() else self.since
        whole = min(self.whole, float(times[every.argmax()])) if every.any() else self.whole
        missed = ~every & (times - since >= GRACE_S)
        young = ~every & (times >= since) & ~missed
        settling = every & (whole - since >= GRACE_S) & (times - whole < SETTLE_S)
        bits = np.where(missed, UNDRIVEN, np.where(young | settling, SETTLING, 0))
        after = self._replace(driven=tuple(seen[-1].tolist()), since=since, whole=whole)
        return after, (bits, seen)

    def _has_settled(self, time: float) -> bool:
        """Whether its outputs had pulses early enough, or for long enough at that time [s]."""
        return self.whole - self.since < GRACE_S or time - self.whole >= SETTLE_S

    def text(self, seen: NDArray[np.bool_], pulses: Floats) -> str:
        """Which outputs had a pulse so far (na,), pulses (32,) [µs] now, NaN where there is none
        -> which never had one, and which outputs have some.
        """
        idle = [
            f"output {channel} ({name})"
            for channel, name, had in zip(self.channels, self.names, seen.tolist(), strict=True)
            if not had
        ]
        some = (np.flatnonzero(np.isfinite(pulses)) + 1).tolist()
        verb, others = "gets" if len(idle) == 1 else "get", ", ".join(map(str, some))
        what = f"{' and '.join(idle)} of the vessel file {verb} no pulse"
        if some:
            what += f", while {others} {'does' if len(some) == 1 else 'do'}"
        return f"{what} (is `channel` right?)"
