"""All that the gateway can send to a boat: its own heartbeat, and requests for message rates.

A shadow never commands a boat: every frame passes `permitted` before it reaches a transport.
"""

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput

GROUND_STATION = 255  # by convention the ground station's, whose commands a boat obeys
ONBOARD_COMPUTER: int = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
SET_RATE: int = dialect.MAV_CMD_SET_MESSAGE_INTERVAL


@dataclass(frozen=True)
class Identity:
    """The gateway's own address on a link."""

    system: int = 245
    component: int = ONBOARD_COMPUTER

    def __post_init__(self) -> None:
        if not 1 <= self.system < GROUND_STATION:
            raise BadInput(
                f"own system id {self.system}: expected 1 … 254 (255 is the ground station's)"
            )
        if not 1 <= self.component <= 255:
            raise BadInput(f"own component id {self.component}: expected 1 … 255")


class Transmitter:
    """Packs messages for one link: address, sequence number and, with a key, signature."""

    def __init__(self, identity: Identity, key: bytes | None, link_id: int) -> None:
        self._mavlink = dialect.MAVLink(None, identity.system, identity.component)
        if key is not None:
            self._mavlink.signing.secret_key = key
            self._mavlink.signing.sign_outgoing = True
            self._mavlink.signing.link_id = link_id

    def pack(self, message: Any, timestamp: int = 0) -> bytes:
        """One frame; `timestamp` is what it is signed with."""
        self._mavlink.signing.timestamp = timestamp
        raw: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return raw


def permitted(raw: bytes) -> Any:
    """The message in a frame that may be sent; ValueError for anything else."""
    try:
        message = dialect.MAVLink(None).decode(bytearray(raw))
    except dialect.MAVError as error:
        raise ValueError(f"never sent: {error}") from None
    if not (_own_heartbeat(message) or _rate_request(message)):
        raise ValueError(f"never sent: {message.get_type()}")
    return message


def _own_heartbeat(message: Any) -> bool:
    return (
        message.get_type() == "HEARTBEAT"
        and message.type == dialect.MAV_TYPE_ONBOARD_CONTROLLER
        and message.autopilot == dialect.MAV_AUTOPILOT_INVALID
    )


def _rate_request(message: Any) -> bool:
    return message.get_type() == "COMMAND_LONG" and message.command == SET_RATE
