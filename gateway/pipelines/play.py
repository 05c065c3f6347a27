"""`shadow simulate --live`: a vessel played as a MAVLink boat until it is stopped."""

import signal
from collections.abc import Callable
from threading import Event

from gateway.played.boat import PlayedBoat
from gateway.played.play import play
from gateway.played.program import program_of
from gateway.played.settings import PlayedSettings
from sim.vessel import Vessel


def play_until_stopped(
    vessel: Vessel,
    endpoint: str,
    program: str,
    system: int,
    seed: int,
    seconds: float,
    tell: Callable[[str], None],
) -> None:
    """Play a program over and over until SIGINT, SIGTERM, or that long has passed."""
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    boat = PlayedBoat(
        vessel, PlayedSettings(system_id=system), seed, program_of(vessel, program, seed)
    )
    tell(f"playing {vessel.name} as system {system} on {endpoint}; Ctrl-C ends")
    played = play([boat], endpoint, stop, seconds=seconds)
    tell(f"played {played.seconds:.0f} s, {played.frames} frames, heard {played.heard} messages")
