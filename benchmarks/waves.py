"""Two trains of waves that cross: are both told, and what else is there, and nothing else?

    python -m benchmarks.waves [--seed 0] [--every 1] [--calm | --hunting]

Voyages of the blind test's generator (`benchmarks.hidden`; it shares no code with `sim`) in which
two groups of three waves each push the boat, alone or beside one effect; every second vessel file
is 10 % off in each of its nine numbers. `--calm`: the same effects without waves. `--hunting`: no
waves, but an autopilot that is set too sharp and swings, which is no sea.
Printed: what is hidden, the verdict, the effects found, the error before and after and the noise.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.diagnosed import diagnosed
from benchmarks.hidden.boats import FLEET, Boat
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.strengths import strong
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage

SEED = 58_000
SECONDS = 480.0
TRAINS = ("wave_motion", "crossing_waves")
CASES = (
    ("grebe", "survey", "thruster_imbalance"), ("wam-v", "excitation", "cubic_drag"),
    ("teal", "wander", ""), ("iacquabot", "survey", "heading_offset"),
    ("dory", "excitation", "steady_current"), ("grebe", "wander", "reverse_loss"),
    ("wam-v", "survey", ""), ("teal", "excitation", "payload_change"),
)  # fmt: skip
HUNTED = (
    ("grebe", "command_delay"), ("wam-v", "thruster_lag"), ("teal", ""), ("grebe", "cross_damping"),
    ("wam-v", "towed_load"), ("teal", "keel_stall"), ("wam-v", "stiff_turning"), ("grebe", ""),
)  # fmt: skip


class Voyage(NamedTuple):
    """One voyage, and what is hidden on it."""

    boat: Boat
    pilot: str
    seed: int
    hidden: tuple[Hidden, ...]


def voyages(seed: int = 0, calm: bool = False) -> Iterator[Voyage]:
    """The same for the same seed."""
    for k, (name, pilot, effect) in enumerate(CASES):
        dice, boat = np.random.default_rng([SEED, seed, k]), FLEET[name]
        names = (*TRAINS, *([effect] if effect else []))
        hidden = tuple(Hidden(n, strong(n, boat, dice, 1.0, SECONDS)) for n in names)
        own = tuple(h for h in hidden if not (calm and h.name in TRAINS))
        yield Voyage(boat, pilot, SEED + 1000 * seed + k, own)


def hunted(seed: int = 0) -> Iterator[Voyage]:
    """In calm water, by an autopilot that swings; two strangers among what is hidden."""
    for k, (name, effect) in enumerate(HUNTED):
        dice, boat = np.random.default_rng([SEED, seed, 100 + k]), FLEET[name]
        hidden = (Hidden(effect, strong(effect, boat, dice, 1.0, SECONDS)),) if effect else ()
        yield Voyage(boat, "hunting", SEED + 1000 * seed + 100 + k, hidden)


def write(voyage: Voyage, folder: Path) -> tuple[Path, Path]:
    """Sail it: the log, and a vessel file that is right or 10 % off."""
    log, file = folder / "voyage.tlog", folder / "vessel.toml"
    boat = voyage.boat.misjudged(voyage.seed) if voyage.seed % 2 else voyage.boat
    file.write_text(vessel_toml(boat), encoding="utf-8")
    write_voyage(log, voyage.boat, voyage.hidden, voyage.pilot, voyage.seed, SECONDS)
    return log, file


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.waves", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="other dice")
    parser.add_argument("--every", type=int, default=1, help="only every so many of the voyages")
    calm = parser.add_mutually_exclusive_group()
    calm.add_argument("--calm", action="store_true", help="without waves")
    calm.add_argument("--hunting", action="store_true", help="no waves, an autopilot that swings")
    a = parser.parse_args(arguments)
    heads = ("boat, pilot", "hidden", "answer", "error (noise)", "s")
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    chosen = hunted(a.seed) if a.hunting else voyages(a.seed, a.calm)
    for v in list(chosen)[:: a.every]:
        with tempfile.TemporaryDirectory() as folder:
            done = diagnosed(*write(v, Path(folder)))
        row = [f"{v.boat.name}, {v.pilot}", ", ".join(h.name for h in v.hidden) or "nothing",
               done.answer, done.errors, f"{done.seconds:.0f}"]  # fmt: skip
        print(f"| {' | '.join(row)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
