"""`shadow simulate --live`: vessels played as boats on a port until somebody stops it."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event

from gateway.errors import BadInput
from gateway.played.boat import PlayedBoat
from gateway.played.play import Played, play
from gateway.played.port import parse_endpoint
from gateway.played.program import program_of
from gateway.played.settings import FAST, THIN, PlayedSettings
from sim.vessel import Vessel

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

    `program` is one of `gateway.played.program.PROGRAMS` or a CSV of commands; `fast` starts with
    high rates instead of a telemetry radio's.
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
