"""A serial device: `/dev/ttyUSB0,57600`. POSIX only; what it needs is in the standard library."""

import os
import termios
import time
from contextlib import suppress

from gateway.errors import BadInput
from gateway.links.inbox import LinkEventKind
from gateway.links.transport import (
    CONNECT_TIMEOUT_S,
    READ_BYTES,
    Arrival,
    Endpoint,
    EventSink,
    LineSelector,
    Peer,
    Waker,
    positive_number,
)

DEFAULT_BAUD = 115200  # as pymavlink assumes
SPEEDS = {
    int(name[1:]): getattr(termios, name)
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit() and int(name[1:]) > 0
}
IFLAG, OFLAG, CFLAG, LFLAG, ISPEED, OSPEED, CC = range(7)  # of termios.tcgetattr


class SerialTransport:
    """A device that may be unplugged and come back."""

    listens = False
    speaks_first = False

    def __init__(self, endpoint: Endpoint) -> None:
        """`/dev/NAME[,BAUD]`, and behind `serial:` also `/dev/NAME:BAUD`."""
        separator = ":" if endpoint.text.startswith("serial:") and ":" in endpoint.address else ","
        self.device, _, baud = endpoint.address.partition(separator)
        if not self.device.startswith("/"):
            raise ValueError("the device is missing")
        self.baud = positive_number(baud, "baud") if baud else DEFAULT_BAUD
        if self.baud not in SPEEDS:
            known = ", ".join(str(speed) for speed in sorted(SPEEDS) if speed >= 9600)
            raise BadInput(
                f'endpoint "{endpoint.text}": no baud rate {self.baud}; there is {known}'
            )
        self._name = endpoint.text
        self.fixed_peer: Peer | None = endpoint.text
        self._file: int | None = None
        self._selector: LineSelector | None = None

    def open(self, waker: Waker, report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        self._file = os.open(self.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        _make_raw(self._file, SPEEDS[self.baud])
        self._selector = LineSelector(waker)
        self._selector.add(self._file)
        report(LinkEventKind.CONNECTED, f"{self.device} is open at {self.baud} baud")

    def connected(self) -> tuple[Peer, ...]:
        return () if self._file is None else (self._name,)

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        assert self._selector is not None
        assert self._file is not None
        self._selector.wait(timeout_s)
        with suppress(BlockingIOError):
            data = os.read(self._file, READ_BYTES)
            now = time.time_ns()
            if not data:
                raise ConnectionError("the device is gone")
            return [Arrival(data, self._name, now)]
        return []

    def send(self, raw: bytes, peer: Peer) -> bool:
        file = self._file
        try:
            return file is not None and os.write(file, raw) == len(raw)
        except OSError:
            return False

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        file, self._file, self._selector = self._file, None, None
        if file is not None:
            os.close(file)


def _make_raw(file: int, speed: int) -> None:
    """Eight bits, no parity, no flow control, and above all no echo back to the boat."""
    try:
        mode = termios.tcgetattr(file)
        mode[IFLAG] = mode[OFLAG] = mode[LFLAG] = 0
        mode[CFLAG] = termios.CS8 | termios.CREAD | termios.CLOCAL
        mode[ISPEED] = mode[OSPEED] = speed
        mode[CC][termios.VMIN], mode[CC][termios.VTIME] = 1, 0
        termios.tcsetattr(file, termios.TCSANOW, mode)
        termios.tcflush(file, termios.TCIOFLUSH)
    except termios.error as error:
        raise OSError(error.args[0], f"not a serial device: {error.args[1]}") from None
