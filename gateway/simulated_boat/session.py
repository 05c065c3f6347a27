"""Says when a played boat speaks to nobody for a while, and when somebody is there; once each.

`shadow simulate --live`: vessels played as boats on a port until somebody stops it.

`shadow simulate --live`: a vessel played as a MAVLink boat until it is stopped.
"""

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event

from gateway.errors import BadInput
from gateway.simulated_boat.boat import PlayedBoat
from gateway.simulated_boat.play import Played, play
from gateway.simulated_boat.port import parse_endpoint
from gateway.simulated_boat.program import program_of
from gateway.simulated_boat.settings import FAST, THIN, PlayedSettings
from sim.vessel import Vessel

PATIENCE_S = 2.0


class Company:
    """Of one endpoint; `note` is called each turn of the play."""

    def __init__(self, endpoint: str, tell: Callable[[str], None]) -> None:
        self._endpoint, self._tell = endpoint, tell
        self._since_s = 0.0
        self._said = False

    def note(self, played: Played) -> None:
        """Tell what has changed."""
        if played.alone is None:
            if self._said:
                self._tell(f"{self._endpoint}: connected")
            self._since_s, self._said = played.seconds, False
        elif not self._said and played.seconds - self._since_s >= PATIENCE_S:
            self._tell(f"{self._endpoint}: {played.alone}")
            self._said = True


ABREAST_M = 30.0  # between boats that start together


def simulate_live(
    vessels: Sequence[Vessel],
    endpoint: str,
    stop: Event,
    *,
    system: int = 1,
    program: str | Path = "mixed",
    fast: bool = False,
    noise: float = 1.0,
    station: bool = False,
    seed: int = 0,
    seconds: float = float("inf"),
    tell: Callable[[Played], None] = lambda played: None,
) -> Played:
    """Play vessels side by side, with ids from `system` on, until `stop` is set.

    `program` is one of `gateway.simulated_boat.program.PROGRAMS` or a CSV of commands; `fast`
    starts with high rates instead of a telemetry radio's.
    """
    if not vessels:
        raise BadInput("no vessel to play: give one or more with --vessel")
    parse_endpoint(endpoint)  # before anything is compiled
    now = time.time()
    boats = [
        PlayedBoat(
            vessel,
            PlayedSettings(
                system_id=system + i,
                rates=FAST if fast else THIN,
                noise=noise,
                unix_s=now,
                start=(0.0, ABREAST_M * i, 0.0),
                station=station and i == 0,
            ),
            seed + i,
            program_of(vessel, program, seed + i),
        )
        for i, vessel in enumerate(vessels)
    ]
    return play(boats, endpoint, stop, seconds=seconds, tell=tell)


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
