"""The stand-in: pilot → outputs → boat in the loop → readings → what its radio sends.

It is no firmware: one mode, no failsafes, no estimator of its own. It is there so that the loop can
be closed, shown and tested on a machine without one.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.simulated_boat.play import BoatPort
from gateway.simulated_boat.settings import TimedFrame
from gateway.stand_in.json_client import JsonClient, SensorReply
from gateway.stand_in.pilots import Pilot, Sticks
from gateway.stand_in.reports import Reporter, ReportSettings
from sim.excitation.sticks import mix_sticks
from sim.hil.battery import effort
from sim.vessel import Vessel

NEUTRAL: Sticks = (0.0, 0.0)
BEFORE_S, AFTER_S = 3.0, 3.0  # disarmed and at rest before the pilot begins, and after it is done


class StandIn:
    """Drives one boat at HOST:PORT of `shadow hil json:HOST:PORT`."""

    def __init__(self, vessel: Vessel, settings: ReportSettings | None = None) -> None:
        self._vessel, self._settings = vessel, settings or ReportSettings()
        self._servos = [actuator.servo for actuator in vessel.actuators]

    def drive(
        self,
        address: str,
        pilot: Pilot,
        longest_s: float,
        *,
        each: Callable[[list[TimedFrame], Reporter], None] = lambda frames, reporter: None,
        real_time: bool = False,
        stop: Callable[[], bool] = lambda: False,
    ) -> list[TimedFrame]:
        """Drive until the pilot is done, or that long [s of the boat] -> all that was sent.

        `each` gets the frames of each report, `real_time` keeps pace with the clock.
        """
        reporter, sent = Reporter(self._vessel, self._settings), list[TimedFrame]()
        begun, ends, done = time.monotonic(), longest_s, False
        with JsonClient(address, round(self._settings.hz)) as client:
            read, pulses, share = self._frame(client, NEUTRAL)
            while read.time < ends and not stop():
                begins = read.time >= BEFORE_S and not done
                sticks = pilot.sticks(read.time - BEFORE_S, read) if begins else None
                if begins and sticks is None:
                    ends, done = min(read.time + AFTER_S, longest_s), True
                read, pulses, share = self._frame(client, sticks or NEUTRAL)
                frames = reporter.report(read, pulses, share, sticks is not None)
                each(frames, reporter)
                sent += frames
                if real_time:
                    time.sleep(max(begun + read.time - time.monotonic(), 0.0))
        return sent

    def _frame(
        self, client: JsonClient, sticks: Sticks
    ) -> tuple[SensorReply, dict[int, int], float]:
        """One frame under sticks -> readings, pulses by output, share of the full current."""
        commands = mix_sticks(self._vessel, np.array(sticks))
        pulses = {
            servo.channel: round(float(servo.pulse(command)))
            for servo, command in zip(self._servos, commands, strict=True)
        }
        share = effort(commands[: len(self._vessel.thrusters)].tolist())
        return client.frame(pulses), pulses, share


def on_the_air(port: BoatPort) -> Callable[[list[TimedFrame], Reporter], None]:
    """For `drive`: send each report on a link, and answer what is requested there."""
    parser: Any = mavlink.MAVLink(None)
    parser.robust_parsing = True

    def each(frames: list[TimedFrame], reporter: Reporter) -> None:
        for arrival in port.receive():
            for message in parser.parse_buffer(arrival.data) or ():
                if message.get_type() != "BAD_DATA":
                    reporter.receive(message)
        for frame in frames:
            port.send(frame.data)

    return each
