"""Logs of MAVLink frames: telemetry logs (.tlog), and the frames of the gateway's own recording."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gateway.errors import BadInput
from gateway.ingest.decoding import decode_tables
from gateway.ingest.format import looks_like
from gateway.ingest.log import Boat, BoatSamples, Log, Statistics, Table
from gateway.ingest.mavlink.boats import from_heartbeats, from_motion
from gateway.ingest.mavlink.definitions import checksum_seeds
from gateway.ingest.mavlink.frames import Frames
from gateway.ingest.mavlink.mapping import RULES
from gateway.ingest.mavlink.walk import GOOD, checksum_table, examine
from gateway.ingest.parameters import banner

if TYPE_CHECKING:
    from gateway.recording.reader import Recording


@dataclass(frozen=True)
class MavlinkLog(Log):
    """An opened log of MAVLink frames.

    frames     the accepted ones in order of receipt
    recording  the gateway's own recording that they come from, where it is one
    """

    path: str
    frames: Frames
    statistics: Statistics
    kind: str = "tlog"
    recording: "Recording | None" = None

    def counts(self) -> Mapping[str, int]:
        return self.frames.counts()

    def table(self, name: str) -> Table:
        return self.frames.table(name)

    def boats(self) -> tuple[Boat, ...]:
        """The autopilots, by their HEARTBEAT or else by the motion that they report."""
        return from_heartbeats(self.table("HEARTBEAT")) or from_motion(self)

    def decode(self, boat: Boat) -> BoatSamples:
        return decode_tables(self, boat, RULES)

    def parameters(self, boat: Boat) -> dict[str, float]:
        """PARAM_VALUE: name -> last value."""
        return self.table("PARAM_VALUE").parameters("param_id", "param_value", boat)

    def firmware(self, boat: Boat) -> str:
        """Banner of a STATUSTEXT, else the version of AUTOPILOT_VERSION."""
        return banner(self.table("STATUSTEXT").texts("text", boat)) or _version(
            self.table("AUTOPILOT_VERSION"), boat
        )


def tlog_from_bytes(raw: bytes, path: str = "tlog") -> MavlinkLog:
    """A telemetry log, read to its end; `path` names it in messages."""
    if _unstamped(raw):
        raise BadInput(f"{path} is MAVLink without time stamps: a .tlog has one before each frame")
    frames = Frames.from_records(raw)
    if not len(frames):
        raise BadInput(
            f"{path} holds no MAVLink frame with a time stamp: it looks like {looks_like(raw)}"
        )
    return MavlinkLog(path, frames, frames.statistics)


def _unstamped(raw: bytes) -> bool:
    """Do two good frames stand at the start without a time stamp?"""
    data, at = np.frombuffer(raw, np.uint8), 0
    for _ in range(2):
        verdict, length = examine(data, at, len(data), checksum_seeds(), checksum_table())
        if verdict != GOOD:
            return False
        at += int(length)
    return True


def _version(table: Table, boat: Boat) -> str:
    """flight_sw_version: one byte each for major, minor, patch, kind of release."""
    mine = table.sent_by(boat)
    if not mine.any():
        return ""
    packed = int(np.asarray(table.columns["flight_sw_version"])[mine][-1])
    major, minor, patch = packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255
    return f"version {major}.{minor}.{patch}" if packed else ""
