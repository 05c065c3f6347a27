"""The firmware's end of ArduPilot's JSON interface: servo packets out, readings in, in lock-step.

A packet is little-endian: uint16 magic 18458, uint16 frame rate [Hz], uint32 frame count, 16 pulses
uint16 [µs]. The reply is a line of JSON between newlines. As the firmware does, it waits, and asks
with the same count again when no reply came. docs/hil.md names the source.
"""

import time
from collections.abc import Mapping, Sequence
from struct import pack
from typing import NamedTuple, Self

import orjson

from gateway.errors import ShadowError
from gateway.links.transport import Endpoint, Waker
from gateway.links.udp import UdpTransport

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
        raise ShadowError(f"{self._address}: nobody answers there: run shadow hil first")
