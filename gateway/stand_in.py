"""The project's own small autopilot: it drives a boat in the loop where no firmware is at hand.

    pilot → outputs → boat in the loop → readings → what its radio sends

It is no firmware: one mode, no failsafes, no estimator of its own. It is there so that the loop can
be closed, shown and tested on a machine without one: `python -m gateway.stand_in --help`.

**The firmware's end of ArduPilot's JSON interface**, in lock-step. A packet is little-endian:
uint16 magic 18458, uint16 frame rate [Hz], uint32 frame count, 16 pulses uint16 [µs]. The reply is
a line of JSON between newlines. As the firmware does, it waits, and asks with the same count again
when no reply came. docs/hil.md names the source.

**Pilots**: readings and time in, throttle and steer out; None when it is done.

    PlanPilot      the corners of a plan, straight lines in between, whatever the boat does
    MissionPilot   from waypoint to waypoint: a heading by its error and the turn rate, full cruise
                   throttle where the boat points at the waypoint

Gains of the mission are chosen for boats of a few metres that steer by thrust; a rudder gets more
helm (`helm_gain`).

**Its radio**: the estimate errs as that of a GNSS-aided filter (`simulated_boat.hull`), the
messages are those of the simulated boat, and it answers requests for rates and parameters as that
one does.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from struct import pack
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import orjson
from numpy.random import PCG64, Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import ShadowError
from gateway.ingest.mapping import Origin
from gateway.links import Endpoint, Waker
from gateway.links.transports import UdpTransport
from gateway.long_running import stop_on_signals
from gateway.simulated_boat import FAST, Rates, TimedFrame
from gateway.simulated_boat.command_responder import (
    CommandResponder,
    FramePacker,
    Streams,
    after_sending,
    due_messages,
    start_streams,
)
from gateway.simulated_boat.hull import SensedValues, SensorModel, SensorState, TrueState
from gateway.simulated_boat.play import BoatPort
from gateway.simulated_boat.telemetry import (
    CHANNELS,
    BoatSnapshot,
    Message,
    messages_named,
    parameter_messages,
    parameters,
)
from gateway.vessel_file import load_vessel
from sim.body import Report
from sim.excitation import Plan, StickLimits, mix_sticks, plan_of
from sim.excitation.catalogue import BY_NAME
from sim.hil import Battery, effort
from sim.model import Model
from sim.state import to_body
from sim.vessel import Vessel

MAGIC, OUTPUTS = 18458, 16
REPLY_S = 1.0  # then the packet is sent again
ATTEMPTS = 10


Vector = tuple[float, float, float]


class SensorReply(NamedTuple):
    """What the sensors of the boat read. Body FRD, world NED."""

    time: float  # s
    gyro: Vector  # rad/s
    accel: Vector  # m/s², specific force
    position: Vector  # m
    velocity: Vector  # m/s
    attitude: Vector  # rad
    voltage: float  # V


def parse_reply(data: bytes) -> SensorReply:
    """A line of JSON -> readings; ValueError where it is none."""
    try:
        found = orjson.loads(data)
        gyro, accel = (_vector(found["imu"][key]) for key in ("gyro", "accel_body"))
        position, velocity, attitude = (
            _vector(found[key]) for key in ("position", "velocity", "attitude")
        )
        voltage = float(found["battery"]["voltage"])
        return SensorReply(
            float(found["timestamp"]), gyro, accel, position, velocity, attitude, voltage
        )
    except (orjson.JSONDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"no line of readings: {error}") from None


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


class JsonClient:
    """One boat at HOST:PORT, asked frame by frame; open while inside."""

    def __init__(self, address: str, rate_hz: int) -> None:
        self._address, self._rate_hz = address, rate_hz
        self._transport = UdpTransport(Endpoint(f"udpout:{address}", "udpout", address))
        self._waker = Waker()
        self._count = 0

    def __enter__(self) -> Self:
        self._transport.open(self._waker, lambda kind, text: None)
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()
        self._waker.__exit__()

    def frame(self, pulses: Mapping[int, int]) -> SensorReply:
        """Pulses [µs] by output -> readings a frame later; ShadowError where nobody answers."""
        row = [pulses.get(n, 0) for n in range(1, OUTPUTS + 1)]
        packet = pack(f"<HHI{OUTPUTS}H", MAGIC, self._rate_hz, self._count, *row)
        for _ in range(ATTEMPTS):
            self._transport.send(packet, self._address)
            end = time.monotonic() + REPLY_S
            while (left := end - time.monotonic()) > 0.0:
                for arrival in self._transport.receive(left):
                    self._count += 1
                    return parse_reply(arrival.data)
        if not self._count:
            raise ShadowError(f"{self._address}: nobody answers there: run shadow hil first")
        raise ShadowError(
            f"{self._address}: the boat answers no more, for {ATTEMPTS * REPLY_S:.0f} s: start "
            "shadow hil again, then this"
        )


Sticks = tuple[float, float]  # throttle, steer: −1 … 1
STEER_PER_RAD, STEER_PER_RATE, MOST_STEER = 0.8, 0.6, 0.4


class Pilot(Protocol):
    """Drives a boat from rest."""

    def sticks(self, seconds: float, read: SensorReply) -> Sticks | None:
        """Throttle and steer at a moment [s since the start]; None: it is over."""
        ...


@dataclass(frozen=True)
class PlanPilot:
    """A plan, open loop: what its Lua script plays in the firmware."""

    plan: Plan

    def sticks(self, seconds: float, read: SensorReply) -> Sticks | None:
        times, rows = self.plan.corner_time, self.plan.corner_sticks
        if seconds > times[-1]:
            return None
        return float(np.interp(seconds, times, rows[:, 0])), float(
            np.interp(seconds, times, rows[:, 1])
        )


class MissionPilot:
    """Waypoints (north, east) [m], each reached within `radius` [m]."""

    def __init__(
        self,
        waypoints: Sequence[tuple[float, float]],
        throttle: float,
        radius: float = 2.0,
        helm_gain: float = 1.0,
    ) -> None:
        self._ahead, self._throttle, self._radius = list(waypoints), throttle, radius
        self._helm = helm_gain

    def sticks(self, seconds: float, read: SensorReply) -> Sticks | None:
        while self._ahead:
            north, east = (a - b for a, b in zip(self._ahead[0], read.position[:2], strict=True))
            if math.hypot(north, east) > self._radius:
                break
            del self._ahead[0]
        if not self._ahead:
            return None
        error = math.remainder(math.atan2(east, north) - read.attitude[2], math.tau)
        steer = self._helm * (STEER_PER_RAD * error - STEER_PER_RATE * read.gyro[2])
        steer = max(-MOST_STEER, min(MOST_STEER, steer))
        return self._throttle * max(math.cos(error), 0.0), steer


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


USAGE = """`python -m gateway.stand_in`: drive a boat in the loop in real time, and send what a \
radio would.

shadow hil --vessel otter                                   # the boat
python -m gateway.stand_in --vessel otter --mavlink udpout:127.0.0.1:14550
shadow live udpin:127.0.0.1:14550 --vessel otter            # its digital shadow
"""


def main() -> int:
    """Until the manoeuvre is over, or Ctrl-C."""
    shape = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m gateway.stand_in", description=USAGE, formatter_class=shape
    )
    parser.add_argument("--vessel", required=True, help="whose outputs it drives")
    parser.add_argument("--sensors", default="127.0.0.1:9002", help="where shadow hil json:… is")
    parser.add_argument("--mavlink", required=True, help="udpout:…, udpin:…, tcp:… or tcpin:…")
    parser.add_argument(
        "--excitation", default="mixed", choices=BY_NAME, metavar="NAME", help="shadow plan --list"
    )
    words = parser.parse_args()
    stop = stop_on_signals()
    try:
        vessel = load_vessel(words.vessel)
        limits = StickLimits(throttle=0.7)
        pilot = PlanPilot(plan_of(BY_NAME[words.excitation], Model.of(vessel), limits))
        with BoatPort(words.mavlink) as port:
            StandIn(vessel).drive(
                words.sensors, pilot, float("inf"), each=on_the_air(port), real_time=True,
                stop=stop.is_set,
            )  # fmt: skip
    except ShadowError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
