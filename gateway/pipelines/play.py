"""`shadow simulate --live`: a vessel played as a MAVLink boat until it is stopped."""

import signal
from collections.abc import Callable
from threading import Event

from gateway.played.company import Company
from gateway.played.session import simulate_live
from sim.vessel import Vessel


def play_until_stopped(
    vessel: Vessel,
    endpoint: str,
    tell: Callable[[str], None],
    *,
    program: str,
    system: int,
    fast: bool,
    seed: int,
    seconds: float,
) -> None:
    """Play a program over and over until SIGINT, SIGTERM, or that long has passed."""
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    tell(f"playing {vessel.name} as system {system} on {endpoint}; Ctrl-C ends")
    played = simulate_live(
        [vessel], endpoint, stop, system=system, program=program, fast=fast, seed=seed,
        seconds=seconds, tell=Company(endpoint, tell).note,
    )  # fmt: skip
    tell(f"played {played.seconds:.0f} s, {played.frames} frames, heard {played.heard} messages")
