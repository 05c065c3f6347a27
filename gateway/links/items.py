"""What a link puts into the inbox: datagrams with their frames, and what happened to the link."""

from enum import StrEnum
from typing import Any, NamedTuple


class Frame(NamedTuple):
    """One MAVLink frame, byte for byte.

    message  pymavlink's object; None where the id is unknown: such a frame has no checksum that
             could be verified, so it is kept for the recording and never used
    """

    raw: bytes
    message: Any


class Datagram(NamedTuple):
    """What one read from a link brought: one or more frames with one receipt."""

    link: str
    receive_time_ns: int
    frames: tuple[Frame, ...]


class Kind(StrEnum):
    """What can happen to a link."""

    LISTENING = "listening"  # we wait for others
    CONNECTED = "connected"
    HEARD = "heard"  # the first frame of a system
    LOST = "lost"
    REFUSED = "refused"  # frames were not taken: signature missing, wrong or old
    SHARED_ID = "shared_id"  # one system id comes from two addresses
    FAULT = "fault"  # a defect of ours: the datagram is lost, the link goes on


class LinkEvent(NamedTuple):
    """One change of a link, in words."""

    link: str
    receive_time_ns: int
    kind: Kind
    says: str
