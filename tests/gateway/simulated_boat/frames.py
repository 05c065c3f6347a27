"""The frames of a simulated boat: decoded, or as a telemetry log."""

import struct
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.ingest.mavlink.log import MavlinkLog, tlog_from_bytes
from gateway.simulated_boat import SimulatedBoatSettings, TimedFrame
from gateway.simulated_boat.boat import SimulatedBoat
from tests.sim.vessels import WAMV

UNIX_S = 1_700_000_000.0
DELAY_S = 0.004  # on the way


def simulated_boat(seed: int = 0, **settings: Any) -> SimulatedBoat:
    return SimulatedBoat(WAMV, SimulatedBoatSettings(**settings), seed)


def frames_of(boat: SimulatedBoat, seconds: float) -> list[TimedFrame]:
    return boat.advance(boat.start(), seconds)[1]


def decoded(frames: Sequence[TimedFrame]) -> list[Any]:
    """Each frame through pymavlink's own strict parser."""
    parser = mavlink.MAVLink(None)
    messages = []
    for frame in frames:
        (message,) = parser.parse_buffer(frame.data)
        messages.append(message)
    return messages


def messages_named(frames: Sequence[TimedFrame], name: str) -> list[Any]:
    return [message for message in decoded(frames) if message.get_type() == name]


def records(frames: Sequence[TimedFrame]) -> bytes:
    """The frames as a .tlog."""
    stamps = [round((UNIX_S + frame.time_s + DELAY_S) * 1e6) for frame in frames]
    return b"".join(
        struct.pack(">Q", stamp) + frame.data for stamp, frame in zip(stamps, frames, strict=True)
    )


def log_of(frames: Sequence[TimedFrame]) -> MavlinkLog:
    return tlog_from_bytes(records(frames), "simulated.tlog")
