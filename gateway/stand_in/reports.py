"""What the stand-in's radio sends: readings and outputs in, MAVLink frames out. Pure.

Its estimate errs as that of a GNSS-aided filter (`simulated_boat.hull`), its messages are those of
the simulated boat, and it answers requests for rates and parameters as that one does.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.random import PCG64, Generator

from gateway.ingest.earth import Origin
from gateway.simulated_boat.command_responder import (
    CommandResponder,
    FramePacker,
    Streams,
    after_sending,
    due_messages,
    start_streams,
)
from gateway.simulated_boat.hull import SensedValues, SensorModel, SensorState, TrueState
from gateway.simulated_boat.settings import FAST, Rates, TimedFrame
from gateway.simulated_boat.telemetry import (
    CHANNELS,
    BoatSnapshot,
    Message,
    messages_named,
    parameter_messages,
    parameters,
)
from gateway.stand_in.json_client import SensorReply
from sim.body import Report
from sim.hil.battery import Battery
from sim.state import to_body
from sim.vessel import Vessel

ANSWERS_PER_TICK = 4  # a link is not flooded with parameters
NOMINAL_V = 14.8


@dataclass(frozen=True)
class ReportSettings:
    """How often it looks at its estimate [Hz], what it sends how often, errors, clock and place."""

    hz: float = 50.0
    rates: Rates = field(default_factory=lambda: FAST)
    noise: float = 1.0  # factor on every error; 0: none
    gyro_filter_hz: float = 4.0
    system_id: int = 1
    unix_s: float = 1_700_000_000.0  # at the start
    origin_deg: tuple[float, float] = (63.44, 10.40)
    seed: int = 0


class Reporter:
    """One boat's radio."""

    def __init__(self, vessel: Vessel, settings: ReportSettings) -> None:
        self.settings = s = settings
        self._sensors = SensorModel(1.0 / s.hz, s.noise, s.gyro_filter_hz)
        self._rng = Generator(PCG64(s.seed))
        self._errors: SensorState = self._sensors.start(self._rng)
        self._battery = Battery.of(vessel, NOMINAL_V)
        self._packer = FramePacker(s.system_id, 1, None, s.unix_s)
        values = parameter_messages(parameters(vessel, s.system_id, s.gyro_filter_hz))
        self._responder = CommandResponder(s.system_id, s.rates, tuple(values))
        self._streams: Streams = start_streams(s.rates, 0.0)
        self._queue: tuple[Message, ...] = tuple(values)
        self._origin = Origin(*s.origin_deg)
        self._used_as, self._frames, self._now = 0.0, 0, 0.0

    def receive(self, message: Any) -> None:
        """A request that reached it; it is answered with the next reports."""
        response = self._responder.answer(self._streams, message, self._now)
        self._streams, self._queue = response.streams, (*self._queue, *response.messages)

    def report(
        self, read: SensorReply, pulses: Mapping[int, int], effort: float, armed: bool
    ) -> list[TimedFrame]:
        """The frames that are due with these readings; effort 0 … 1: share of the full current."""
        sensed, self._now = self._estimate(read), read.time
        amperes = self._battery.full_current * effort
        self._used_as += amperes / self.settings.hz
        us = round(read.time * 1e6)
        snapshot = BoatSnapshot(
            us, round(self.settings.unix_s * 1e6) + us, armed, sensed,
            tuple(pulses.get(n, 0) for n in range(1, CHANNELS + 1)), effort, amperes,
            self._used_as, 1.0 - self._battery.drained(self._used_as), (0.0, 0.0), self._origin,
        )  # fmt: skip
        names = due_messages(self._streams, read.time)
        self._streams = after_sending(self._streams, names, read.time)
        messages = [message for name in names for message in messages_named(name, snapshot)]
        messages += self._queue[:ANSWERS_PER_TICK]
        self._queue = self._queue[ANSWERS_PER_TICK:]
        return [self._frame(message, read.time) for message in messages]

    def _frame(self, message: Message, now: float) -> TimedFrame:
        raw = self._packer.frame(message, self._frames)
        self._frames += 1
        return TimedFrame(now, now, self.settings.system_id, raw)

    def _estimate(self, read: SensorReply) -> SensedValues:
        """Readings with the errors of an estimate."""
        u, v = map(float, to_body(read.velocity[0], read.velocity[1], read.attitude[2]))
        r, ahead, side = read.gyro[2], read.accel[0], read.accel[1]
        north, east, yaw = *read.position[:2], read.attitude[2]
        motion = Report(north, east, yaw, u, v, r, ahead + r * v, side - r * u, math.nan)
        truth = TrueState(motion, ahead, side, read.voltage, 0.0)
        self._errors, sensed = self._sensors.read(self._errors, truth, self._rng)
        roll, pitch = sensed.roll + read.attitude[0], sensed.pitch + read.attitude[1]
        return sensed._replace(roll=roll, pitch=pitch)
