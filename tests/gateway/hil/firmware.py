"""A stand-in for ArduPilot's end of the JSON interface: it asks, waits, and reads as it does."""

import math
import re
import socket
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Thread

from gateway.hil.run import BoatLoop, LoopOptions, LoopPlan, run_loops

VECTORS = ("gyro", "accel_body", "position", "attitude", "velocity", "velocity_wind")
NUMBERS = ("timestamp", "rng_1", "direction", "speed", "voltage", "current")
VECTOR = re.compile(r"\[([^],]+),\s*([^],]+),\s*([^],]+)\]")
NUMBER = re.compile(r"[-+0-9.eE]+")
Values = dict[str, tuple[float, ...]]


def packet(count: int, pulses: Sequence[int], rate: int = 400, magic: int | None = None) -> bytes:
    """A servo packet of 16 or 32 pulses [µs]."""
    magic = magic if magic is not None else {16: 18458, 32: 29569}[len(pulses)]
    return struct.pack(f"<HHI{len(pulses)}H", magic, rate, count, *pulses)


def parsed(reply: bytes) -> Values:
    """A reply as the firmware reads it.

    It wants text between newlines, finds the first place where a key stands, and expects the value
    two characters behind it: quote and colon, nothing else.
    """
    assert reply.startswith(b"\n")
    assert reply.endswith(b"\n")
    text = reply.strip().decode()
    out: Values = {}
    for key in (*VECTORS, *NUMBERS):
        at = text.find(key)
        if at < 0:
            continue
        found = (VECTOR if key in VECTORS else NUMBER).match(text, at + len(key) + 2)
        if found:
            out[key] = tuple(map(float, found.groups() or (found.group(),)))
    return out


class StandIn:
    """Firmware with 16 (or 32) outputs on a UDP port of its own."""

    def __init__(self, port: int, rate: int = 400, outputs: int = 16) -> None:
        self._port, self.rate, self.outputs = port, rate, outputs
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(5.0)
        self._socket.connect(("127.0.0.1", port))
        self.count = 0
        self.last = b""

    def close(self) -> None:
        self._socket.close()

    def send(self, data: bytes) -> None:
        """Bytes as they are."""
        self._socket.send(data)

    def receive(self, timeout: float = 5.0) -> bytes:
        """One reply; TimeoutError where none comes."""
        self._socket.settimeout(timeout)
        self.last = self._socket.recv(65536)
        return self.last

    def frame(self, pulses: dict[int, int], count: int | None = None) -> Values:
        """One frame in lock-step: pulses by output -> what the sensors read."""
        row = [pulses.get(n, 0) for n in range(1, self.outputs + 1)]
        asked = packet(self.count if count is None else count, row, self.rate)
        values = parsed(self._answer(asked))
        self.count = (self.count if count is None else count) + 1
        return values

    def _answer(self, asked: bytes) -> bytes:
        """The reply; it asks again each second, as the firmware does."""
        for _ in range(4):
            self.send(asked)
            try:
                return self.receive(1.0)
            except TimeoutError:
                continue
        self.send(asked)
        return self.receive(1.0)

    def sail(self, pulses: dict[int, int], seconds: float) -> Values:
        """The same pulses for a while."""
        values: Values = {}
        for _ in range(round(seconds * self.rate)):
            values = self.frame(pulses)
        return values

    def go_to(self, north: float, east: float, seconds: float, within: float = 2.0) -> bool:
        """Steer outputs 1 and 3 (left, right) to a place -> whether it came there in that time."""
        values = self.frame({1: 1500, 3: 1500})
        for _ in range(round(seconds * self.rate)):
            to_n, to_e = north - values["position"][0], east - values["position"][1]
            if math.hypot(to_n, to_e) < within:
                return True
            error = math.remainder(math.atan2(to_e, to_n) - values["attitude"][2], math.tau)
            turn = max(-0.4, min(0.4, 0.8 * error - 0.6 * values["gyro"][2]))
            ahead = 0.5 * max(math.cos(error), 0.0)
            left, right = (round(1500 + 500 * (ahead + side * turn)) for side in (1, -1))
            values = self.frame({1: left, 3: right})
        return False


@dataclass
class Running:
    """Loops that run in a thread, and what they said."""

    loops: list[BoatLoop]
    lines: list[str]
    errors: list[Exception]

    def said(self, text: str) -> list[str]:
        """The lines that hold a text."""
        return [line for line in self.lines if text in line]


@contextmanager
def looping(plans: Sequence[LoopPlan], options: LoopOptions | None = None) -> Iterator[Running]:
    """`run_loops` in a thread, its ports open, until the block ends; then errors are raised."""
    stop, ready = Event(), Event()
    running = Running([], [], [])

    def work() -> None:
        try:
            running.loops += run_loops(
                plans, options or LoopOptions(), running.lines.append, stop.is_set, ready.set
            )
        except Exception as error:
            running.errors.append(error)
        finally:
            ready.set()

    thread = Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(120.0)
    try:
        yield running
    finally:
        stop.set()
        thread.join(20.0)
    if running.errors:
        raise running.errors[0]


def wait_for(condition: Callable[[], object], seconds: float = 5.0) -> bool:
    """Whether something came true within that time."""
    import time

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def free_port() -> int:
    """A UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
