"""A serial device: `/dev/ttyUSB0,57600`. POSIX only; what it needs is in the standard library."""

import contextlib
import os
import selectors
import termios
import time

from gateway.errors import BadInput
from gateway.links.endpoint import Endpoint
from gateway.links.inbox import Kind
from gateway.links.transport import READ, Arrival, Closing, Peer, Report, Waker

SPEEDS = {
    int(name[1:]): getattr(termios, name)
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit() and int(name[1:]) > 0
}
IFLAG, OFLAG, CFLAG, LFLAG, ISPEED, OSPEED, CC = range(7)  # of termios.tcgetattr


class SerialWire:
    """A device that may be unplugged and come back."""

    def __init__(self, endpoint: Endpoint) -> None:
        if endpoint.baud not in SPEEDS:
            known = ", ".join(str(speed) for speed in sorted(SPEEDS) if speed >= 9600)
            raise BadInput(f'endpoint "{endpoint}": no baud rate {endpoint.baud}; there is {known}')
        self.endpoint = endpoint
        self.fixed_peer: Peer | None = str(endpoint)
        self._device: int | None = None
        self._selector: selectors.BaseSelector | None = None
        self._waker: Waker | None = None

    def open(self, waker: Waker, report: Report) -> None:
        flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
        self._device = os.open(self.endpoint.host, flags)
        make_raw(self._device, SPEEDS[self.endpoint.baud])
        self._waker, self._selector = waker, selectors.DefaultSelector()
        self._selector.register(self._device, selectors.EVENT_READ)
        self._selector.register(waker, selectors.EVENT_READ)
        report(Kind.CONNECTED, f"{self.endpoint.host} is open at {self.endpoint.baud} baud")

    def receive(self) -> list[Arrival]:
        assert self._selector is not None
        assert self._device is not None
        for key, _ in self._selector.select():
            if key.fileobj is self._waker:
                raise Closing
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._device, READ)
            now = time.time_ns()
            if not data:
                raise ConnectionError("the device is gone")
            return [Arrival(data, str(self.endpoint), now)]
        return []

    def send(self, raw: bytes, peer: Peer) -> bool:
        device = self._device
        try:
            return device is not None and os.write(device, raw) == len(raw)
        except OSError:
            return False

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        device, self._device, self._selector = self._device, None, None
        if device is not None:
            os.close(device)


def make_raw(device: int, speed: int) -> None:
    """Eight bits, no parity, no flow control, and above all no echo back to the boat."""
    try:
        mode = termios.tcgetattr(device)
        mode[IFLAG] = mode[OFLAG] = mode[LFLAG] = 0
        mode[CFLAG] = termios.CS8 | termios.CREAD | termios.CLOCAL
        mode[ISPEED] = mode[OSPEED] = speed
        mode[CC][termios.VMIN], mode[CC][termios.VTIME] = 1, 0
        termios.tcsetattr(device, termios.TCSANOW, mode)
        termios.tcflush(device, termios.TCIOFLUSH)
    except termios.error as error:
        raise OSError(error.args[0], f"not a serial device: {error.args[1]}") from None
