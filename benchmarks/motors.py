"""Are weak motors told as that, those to starboard, to port, all of them? And a wrong steering?

    python -m benchmarks.motors [--kind starboard port all second steering later arm one_arm]
        [--every 1] [--seed 0]

Voyages of the blind test's generator (`benchmarks.hidden`; it shares no code with `sim`) with
motors at 60 to 88 % of their thrust from the first moment on; its own imbalance is one of the port
motors, now weaker, now stronger. Kinds: the motors to starboard; those to port; all of them; those
to starboard beside a second cause; with nothing hidden, a file that lets rudders and steered
motors turn further than they do, of which they turn such a share; all of them from a moment on
alone; and with nothing hidden, a file that has the motors too far from the centre line by 50 to
78 %, or on half of the voyages too near; and the same of those on one side alone. Every other
vessel file is 10 % off in each of its nine numbers.
Printed: what is hidden, the verdict, the effects found, the error before and after and the noise.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.diagnosed import diagnosed
from benchmarks.hidden.boats import EVERY, Boat
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage

SEED = 46_000
SECONDS = 300.0
KINDS = ("starboard", "port", "all", "second", "steering", "later", "arm", "one_arm")
WEAK = (0.6, 0.88)  # of the thrust, drawn
PAIRS = (
    ("grebe", "survey"), ("wam-v", "excitation"), ("light-5", "survey"), ("light-7", "wander"),
    ("teal", "drills"), ("iacquabot", "excitation"), ("light-18", "wander"), ("wam-v", "survey"),
    ("light-21", "drills"), ("teal", "survey"),
)  # fmt: skip
STEERED = (
    ("heron", "survey"), ("dory", "wander"), ("heron", "excitation"), ("dory", "survey"),
    ("heron", "drills"), ("dory", "excitation"), ("heron", "wander"), ("dory", "drills"),
)  # fmt: skip


class Voyage(NamedTuple):
    """One voyage; share: of their thrust, that the weak motors give, or of the angle in the file
    that the steering turns, or of the distance in the file that the motors are from the middle.
    """

    boat: Boat
    pilot: str
    seed: int
    share: float
    hidden: tuple[Hidden, ...]
    arms_off: tuple[float, ...] = (-1.0, 1.0)  # sides whose motors the file has elsewhere

    @property
    def second(self) -> str:
        """Name of what is hidden beside the motors; empty where nothing is."""
        return next((h.name for h in self.hidden if h.name != "thruster_fault"), "")


def voyages(kind: str, seed: int = 0) -> Iterator[Voyage]:
    """Those of one kind; the same for the same seed, whatever else is run."""
    for k, (name, pilot) in enumerate(STEERED if kind == "steering" else PAIRS):
        dice, boat = np.random.default_rng([SEED, seed, KINDS.index(kind), k]), EVERY[name]
        share = float(dice.uniform(*WEAK))
        both = (-1.0, 1.0)
        none = {"steering": (), "arm": (), "one_arm": ()}
        sides = {"port": (-1.0,), "all": both, "later": both, **none}.get(kind, (1.0,))
        if kind in ("arm", "one_arm"):
            share = (share - 0.1) ** (1.0 if k // 2 % 2 else -1.0)
        since = float(dice.uniform(0.3, 0.7)) * SECONDS if kind == "later" else -1.0
        weak = [m.channel for m in boat.motors if np.sign(m.y) in sides]
        hidden = [
            Hidden("thruster_fault", {"channel": float(c), "gain": share, "time": since})
            for c in weak
        ]
        way = float(dice.uniform(-np.pi, np.pi))
        more = (
            Hidden("steady_current", {"speed": 0.3, "direction": way}),
            Hidden("heading_offset", {"angle": 0.15}),
            Hidden("towed_load", {"drag": 8.0, "x": -0.5 * boat.hull.length}),
            Hidden("steady_wind", {"speed": 8.0, "direction": way}),
        )
        hidden += [more[k % len(more)]] if kind == "second" else []
        off = (both[k % 2],) if kind == "one_arm" else both
        yield Voyage(boat, pilot, SEED + 1000 * seed + 100 * KINDS.index(kind) + k, share,
                     tuple(hidden), off)  # fmt: skip


def write(voyage: Voyage, folder: Path) -> tuple[Path, Path]:
    """Sail it: the log, and a vessel file that is right or 10 % off."""
    log, file = folder / "voyage.tlog", folder / "vessel.toml"
    boat = voyage.boat.misjudged(voyage.seed) if voyage.seed % 2 else voyage.boat
    if not voyage.hidden and not boat.rudders:
        off = voyage.arms_off
        motors = [
            replace(m, y=m.y / voyage.share) if np.sign(m.y) in off else m for m in boat.motors
        ]
        boat = replace(boat, motors=tuple(motors))
    elif not voyage.hidden:
        turn = [replace(rudder, most=rudder.most / voyage.share) for rudder in boat.rudders]
        boat = replace(boat, rudders=tuple(turn))
    file.write_text(vessel_toml(boat), encoding="utf-8")
    write_voyage(log, voyage.boat, voyage.hidden, voyage.pilot, voyage.seed, SECONDS)
    return log, file


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.motors", description=__doc__)
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--every", type=int, default=1, help="only every so many of ten voyages")
    parser.add_argument("--seed", type=int, default=0, help="other dice")
    a = parser.parse_args(arguments)
    heads = ("kind", "boat, pilot", "share", "beside it", "answer", "error (noise)", "s")
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for kind in a.kind:
        for v in list(voyages(kind, a.seed))[:: a.every]:
            with tempfile.TemporaryDirectory() as folder:
                done = diagnosed(*write(v, Path(folder)))
            row = [kind, f"{v.boat.name}, {v.pilot}", f"{v.share:.2f}", v.second or "–",
                   done.answer, done.errors, f"{done.seconds:.0f}"]  # fmt: skip
            print(f"| {' | '.join(row)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
