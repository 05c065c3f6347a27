"""A recording made live, run again as it ran: the same datagrams and ticks in the same order.

A log of somebody else's is decoded in bulk; here the loop's own inputs are at hand, so what it
said can be reproduced to the last bit.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.config import Settings
from gateway.errors import BadInput
from gateway.json_rows import TopicRows
from gateway.links.inbox import Datagram, Frame
from gateway.live.boats import BoatPlan, Fleet, Said
from gateway.recording.reader import TICK_LINK, RawFrames, Recording
from gateway.shadow.path import Shadowing
from gateway.shadow.recording_contents import LIVE, METADATA


class Moment(NamedTuple):
    """One input of the loop: frames [start, end) of the recording, heard or ticked then."""

    link: str
    receive_time_ns: int
    start: int
    end: int


class Relived(NamedTuple):
    """What one input led to: messages, rows of the path, and the frames that it was made of."""

    rows: list[TopicRows]
    outs: list[Shadowing]
    frames: slice


def ran_live(recording: Recording) -> bool:
    """Was it made by `shadow live`?"""
    return LIVE in recording.metadata.get(METADATA, {})


def fleet_of(recording: Recording, plan: BoatPlan, settings: Settings) -> Fleet:
    """A fleet that shadows the boat of that recording, whoever else is heard in it."""
    if not ran_live(recording):
        raise BadInput(f"{recording.path}: not a recording of `shadow live`: replay it as a log")
    system = int(recording.metadata[METADATA]["system"])
    return Fleet([replace(plan, system=system)], settings)


def moments(raw: RawFrames) -> Iterator[Moment]:
    """The loop's inputs in the order in which it took them: one datagram has one receipt."""
    keys = zip(raw.link.tolist(), raw.receive_time_ns.tolist(), strict=True)
    at = 0
    for (link, receipt), group in groupby(keys):
        count = sum(1 for _ in group)
        yield Moment(raw.links[link], receipt, at, at + count)
        at += count


def relived(fleet: Fleet, path: Path) -> Iterator[Relived]:
    """Moment by moment; a recording in several parts is one after another, with one fleet."""
    raw = Recording.open(path).raw()
    frames, decoder = raw.frames(), dialect.MAVLink(None)
    for moment in moments(raw):
        part = slice(moment.start, moment.end)
        rows, outs = list[TopicRows](), list[Shadowing]()
        for said in _said(fleet, moment, frames[part], decoder):
            rows += [*said.spoken.rows, *said.boat.status(moment.receive_time_ns, 0, 0)]
            outs += [] if said.spoken.out is None else [said.spoken.out]
        yield Relived(rows, outs, part)


def _said(fleet: Fleet, moment: Moment, frames: list[bytes], decoder: Any) -> Iterator[Said]:
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
