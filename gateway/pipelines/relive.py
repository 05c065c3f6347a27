"""A recording made live, run again as it ran: the same datagrams and ticks in the same order.

A log of somebody else's is decoded in bulk; here the loop's own inputs are at hand, so what it
said can be reproduced to the last bit.
"""

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.links.items import Datagram, Frame
from gateway.messages import Rows
from gateway.pipelines.fleet import Fleet, Said
from gateway.pipelines.path import Shadowing
from gateway.recording import TICK_LINK, RawFrames, Recording

LIVE = "live"  # metadata of a recording whose frames and ticks reproduce what ran


class Moment(NamedTuple):
    """One input of the loop: frames [start, end) of the recording, heard or ticked then."""

    link: str
    receive_time_ns: int
    start: int
    end: int


def ran_live(recording: Recording) -> bool:
    """Was it made by `shadow live`?"""
    return LIVE in recording.metadata.get("shadow", {})


def moments(raw: RawFrames) -> Iterator[Moment]:
    """The loop's inputs in the order in which it took them: one datagram has one receipt."""
    keys = zip(raw.link.tolist(), raw.receive_time_ns.tolist(), strict=True)
    at = 0
    for (link, receipt), group in groupby(keys):
        count = sum(1 for _ in group)
        yield Moment(raw.links[link], receipt, at, at + count)
        at += count


def relived(fleet: Fleet, path: Path) -> Iterator[tuple[Shadowing, list[Rows], slice]]:
    """Moment by moment: what went out, and which frames of the recording it followed from."""
    raw = Recording.open(path).raw()
    frames, decoder = raw.frames(), dialect.MAVLink(None)
    for moment in moments(raw):
        for said in _said(fleet, moment, frames[moment.start : moment.end], decoder):
            health = said.boat.status(moment.receive_time_ns, 0, 0)
            if said.spoken.out is not None:
                rows = [*said.spoken.rows, *health]
                yield said.spoken.out, rows, slice(moment.start, moment.end)


def _said(fleet: Fleet, moment: Moment, frames: list[bytes], decoder: Any) -> list[Said]:
    if moment.link == TICK_LINK:
        return fleet.tick(moment.receive_time_ns)
    heard = tuple(Frame(frame, _message(frame, decoder)) for frame in frames)
    return fleet.datagram(Datagram(moment.link, moment.receive_time_ns, heard))


def _message(frame: bytes, decoder: Any) -> Any:
    """pymavlink's object; None where the id is unknown, as on a live link."""
    try:
        return decoder.decode(bytearray(frame))
    except dialect.MAVError:
        return None
