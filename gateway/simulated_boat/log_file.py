"""`shadow simulate --log`: what a radio would have received of a simulated boat, as a .tlog.

No clock and no link: the whole voyage is computed as fast as it can be. The same vessel, program
and seed give the same bytes. The boat moves by the model of the vessel itself, so such a log tests
what can be found in a recording, never whether a model is right.
"""

import struct
from collections.abc import Iterable
from pathlib import Path

from gateway.errors import BadInput
from gateway.files import write_whole
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.simulated_boat.program import program_of
from gateway.simulated_boat.settings import FAST, THIN, SimulatedBoatSettings, TimedFrame
from sim.vessel import Vessel

LONGEST_S = 86_400.0


def write_log(
    vessel: Vessel,
    file: Path,
    *,
    program: str = "mixed",
    system: int = 1,
    fast: bool = False,
    seed: int = 0,
    seconds: float = float("inf"),
) -> float:
    """Play a program, once where no duration [s] is given, into a .tlog -> the duration [s]."""
    if file.suffix.lower() != ".tlog":
        raise BadInput(f"{file}: a telemetry log is called NAME.tlog")
    commands = program_of(vessel, program, seed)
    duration = commands.period if seconds == float("inf") else seconds
    if not 0.0 < duration <= LONGEST_S:
        raise BadInput(f"{duration:g} s: a voyage lasts more than 0 s and at most a day")
    settings = SimulatedBoatSettings(system_id=system, rates=FAST if fast else THIN)
    boat = SimulatedBoat(vessel, settings, seed, commands)
    _, frames = boat.advance(boat.start(), duration)
    write_whole(file, tlog_bytes(frames, settings.unix_s), "the telemetry log")
    return duration


def tlog_bytes(frames: Iterable[TimedFrame], unix_s: float) -> bytes:
    """Frames -> a .tlog: before each the Unix time of its arrival [µs], 8 bytes big-endian."""
    return b"".join(
        struct.pack(">Q", round((unix_s + frame.time_s) * 1e6)) + frame.data for frame in frames
    )
