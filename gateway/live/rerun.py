"""A recording made by `shadow live`, run again: the same datagrams and ticks in the same order.

Any other log is decoded in bulk; here the loop's own inputs are at hand, so that its outputs can
be reproduced to the last bit.
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
from gateway.links import Datagram, Frame
from gateway.live.boats import BoatPlan, Fleet, FleetOutput
from gateway.recording.reader import RawFrames, Recording
from gateway.recording.recorder import TICK_LINK
from gateway.shadow.path import ShadowRows
from gateway.shadow.topic_rows import LIVE, METADATA


class LoopInput(NamedTuple):
    """One input of the loop: frames [start, end) of the recording, received or ticked then."""

    link: str
    receive_time_ns: int
    start: int
    end: int


class RerunStep(NamedTuple):
    """What one input led to: messages, rows of the path, and the frames that it was made of."""

    rows: list[TopicRows]
    outs: list[ShadowRows]
    frames: slice


def recorded_live(recording: Recording) -> bool:
    """Was it made by `shadow live`?"""
    return LIVE in recording.metadata.get(METADATA, {})


def fleet_of(recording: Recording, plan: BoatPlan, settings: Settings) -> Fleet:
    """A fleet that shadows the boat of that recording alone."""
    if not recorded_live(recording):
        raise BadInput(f"{recording.path}: not a recording of `shadow live`: replay it as a log")
    system = int(recording.metadata[METADATA]["system"])
    return Fleet([replace(plan, system=system)], settings)


def loop_inputs(raw: RawFrames) -> Iterator[LoopInput]:
    """The loop's inputs in the order in which it took them: one datagram has one receipt."""
    keys = zip(raw.link.tolist(), raw.receive_time_ns.tolist(), strict=True)
    at = 0
    for (link, receipt), group in groupby(keys):
        count = sum(1 for _ in group)
        yield LoopInput(raw.links[link], receipt, at, at + count)
        at += count


def rerun(fleet: Fleet, path: Path) -> Iterator[RerunStep]:
    """Input by input; the parts of a recording are run one after another, with one fleet."""
    raw = Recording.open(path).raw()
    frames, decoder = raw.frames(), dialect.MAVLink(None)
    for given in loop_inputs(raw):
        part = slice(given.start, given.end)
        rows, outs = list[TopicRows](), list[ShadowRows]()
        for boat, output in _outputs(fleet, given, frames[part], decoder):
            rows += [*output.rows, *boat.status(given.receive_time_ns, 0, 0)]
            outs += [] if output.out is None else [output.out]
        yield RerunStep(rows, outs, part)


def _outputs(
    fleet: Fleet, given: LoopInput, frames: list[bytes], decoder: Any
) -> Iterator[FleetOutput]:
    if given.link == TICK_LINK:
        return fleet.tick(given.receive_time_ns)
    received = tuple(Frame(frame, _message(frame, decoder)) for frame in frames)
    return fleet.datagrams([Datagram(given.link, given.receive_time_ns, received)])


def _message(frame: bytes, decoder: Any) -> Any:
    """pymavlink's object; None where the id is unknown, as on a live link."""
    try:
        return decoder.decode(bytearray(frame))
    except dialect.MAVError:
        return None
