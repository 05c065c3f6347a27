"""The servo outputs of an autopilot, read from its MAVLink: what its motors would get.

A thread of its own listens on a link, asks once in a while for SERVO_OUTPUT_RAW 25 times a
second (the only thing that it sends, `permitted` by the gateway's own rule), and keeps the newest
pulses. Pulses that are older than a second are none.
"""

import time
from collections.abc import Callable, Mapping
from threading import Thread
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.links.link import transport_of
from gateway.links.transmitter import SET_RATE, Identity, Transmitter, permitted
from gateway.links.transport import Closing, Peer, Waker

HZ = 25  # Rover's loop of 50 Hz allows no more than 40
FRESH_S = 1.0  # older pulses are none
ASK_S = 2.0  # between two requests while they do not come often enough
RETRY_S = 1.0  # between attempts to open the link
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1


class ServoOutputs:
    """Pulses by output on one link; open while inside."""

    def __init__(self, link: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._link, self._clock = link, clock
        self._transport = transport_of(link)
        self._waker = Waker()
        self._parser: Any = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._transmitter = Transmitter(Identity(), None, 0)
        self._pulses: Mapping[int, float] = {}
        self._heard = self._asked = self._since = float("-inf")
        self._count = 0
        self._thread = Thread(target=self._listen, name=f"outputs on {link}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._waker.wake()
        self._thread.join()
        self._waker.__exit__()

    def pulses(self) -> Mapping[int, float] | None:
        """The newest pulses [µs] by output; None where none came within a second."""
        return self._pulses if self._clock() - self._heard < FRESH_S else None

    def _listen(self) -> None:
        while True:
            try:
                self._transport.open(self._waker, lambda kind, text: None)
                while True:
                    self._receive()
            except Closing:
                break
            except OSError:
                self._transport.close()
            try:
                self._waker.sleep(RETRY_S)
            except Closing:
                break
        self._transport.close()

    def _receive(self) -> None:
        for arrival in self._transport.receive(RETRY_S):
            for message in self._parser.parse_buffer(arrival.data) or ():
                self._note(message, arrival.peer)

    def _note(self, message: Any, peer: Peer) -> None:
        kind, now = message.get_type(), self._clock()
        if kind == "SERVO_OUTPUT_RAW":
            first = 16 * message.port + 1
            new = {first + n: float(getattr(message, f"servo{n + 1}_raw")) for n in range(16)}
            self._pulses = {**self._pulses, **new}
            self._heard, self._count = now, self._count + 1
        if kind == "HEARTBEAT" and message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            self._ask(message.get_srcSystem(), peer, now)

    def _ask(self, system: int, peer: Peer, now: float) -> None:
        """Ask for the rate where they come less than half as often."""
        if now - self._asked < ASK_S:
            return
        often = self._count >= 0.5 * HZ * (now - self._asked)
        self._asked, self._count = now, 0
        if often:
            return
        request = mavlink.MAVLink_command_long_message(
            system, AUTOPILOT, SET_RATE, 0, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 1e6 / HZ,
            0, 0, 0, 0, 0,
        )  # fmt: skip
        raw = self._transmitter.pack(request)
        permitted(raw)
        self._transport.send(raw, peer)


def check_link(link: str | None) -> str:
    """The link, or BadInput that says that one is needed."""
    if link is None:
        raise BadInput(
            "ahrs: the servo outputs come back by MAVLink: give --outputs LINK, as in "
            "--outputs /dev/ttyACM0,115200 or --outputs tcp:127.0.0.1:5760"
        )
    transport_of(link)
    return link
