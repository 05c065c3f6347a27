"""One thing in the vessel file is wrong, as people get it wrong: is that told, and nothing else?

    python -m benchmarks.mistakes [--kind number unit arm two] [--beside] [--every 1] [--seed 0]

Voyages of the blind test's generator (`benchmarks.hidden`; it shares no code with `sim`). The file
is right but for one thing: one of its nine numbers or two of one axis, at a third to half or at
twice to three times (`number`); thrust in pounds or kilograms where newtons are asked for (`unit`);
a steered motor at half its distance from midships or twice that (`arm`). Of `two` it is two numbers
of different axes, each by its own factor. With `--beside` a second thing is true of the voyage,
that the file does not know: a current, a compass, a starboard motor.
Right is who names the effects that are there and no other. Printed: what is wrong, the verdict, the
effects found, the error before and after and the noise, and how far each wrong number is from the
truth in the end.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.diagnosed import diagnosed
from benchmarks.hidden.boats import EVERY, Boat
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage
from benchmarks.motors import PAIRS
from gateway.offline.diagnose import DiagnosisResult

SEED = 91_000
SECONDS = 300.0
KINDS = ("number", "unit", "arm", "two")
FAR = (2.0, 3.0)  # times the true number, or its part
WRONG = (
    ("m33",), ("X_u",), ("N_r",), ("Y_v",), ("m11",), ("X_uu",), ("N_r", "N_rr"), ("Y_v", "Y_vv"),
    ("m22",), ("X_u", "X_uu"),
)  # fmt: skip
TWO = (
    ("m33", "X_u"), ("N_r", "m11"), ("Y_v", "m33"), ("X_uu", "N_r"), ("m11", "Y_v"), ("m22", "N_r"),
    ("X_u", "Y_vv"), ("m33", "m11"), ("N_rr", "X_uu"), ("Y_v", "N_r"),
)  # fmt: skip
UNITS_N = (4.448, 9.807)
STEERED = (("dory", "survey"), ("dory", "excitation"), ("dory", "wander"), ("dory", "drills"))


class Mistake(NamedTuple):
    """One voyage and what is wrong in its file: names of numbers, and what they are multiplied by;
    `thrust`, and `x` of all motors, are names too.
    """

    boat: Boat
    pilot: str
    seed: int
    wrong: Mapping[str, float]
    hidden: tuple[Hidden, ...]

    @property
    def effects(self) -> set[str]:
        """What should be told."""
        told = {"thrust": "thrust_scale", "x": "lever_arm"}
        of_file = {told[name] for name in self.wrong if name in told}
        names = {"thruster_fault": "thruster_imbalance"}
        return of_file | {names.get(h.name, h.name) for h in self.hidden}


def mistakes(kind: str, beside: bool, seed: int = 0) -> Iterator[Mistake]:
    """Those of one kind; the same for the same seed, whatever else is run."""
    for k, (name, pilot) in enumerate(STEERED if kind == "arm" else PAIRS):
        own = [SEED, seed, KINDS.index(kind), k]
        dice, boat = np.random.default_rng(own), EVERY[name]
        factor = float(dice.uniform(*FAR)) ** (1.0 if dice.random() < 0.5 else -1.0)
        if kind == "number":
            wrong = dict.fromkeys(WRONG[(k + seed) % len(WRONG)], factor)
        elif kind == "two":
            first, second = TWO[(k + seed) % len(TWO)]
            other = float(dice.uniform(*FAR)) ** (1.0 if dice.random() < 0.5 else -1.0)
            wrong = {first: factor, second: other}
        elif kind == "unit":
            wrong = {"thrust": 1.0 / UNITS_N[k % len(UNITS_N)]}
        else:
            wrong = {"x": 2.0 if factor > 1.0 else 0.5}
        way = float(dice.uniform(-np.pi, np.pi))
        weak = [m.channel for m in boat.motors if m.y > 0.0]
        more: tuple[tuple[Hidden, ...], ...] = (
            (Hidden("steady_current", {"speed": 0.3, "direction": way}),),
            (Hidden("heading_offset", {"angle": 0.15}),),
            tuple(
                Hidden("thruster_fault", {"channel": float(c), "gain": 0.7, "time": -1.0})
                for c in weak
            ),
        )
        able = [some for some in more if some]
        hidden = able[k % len(able)] if beside else ()
        yield Mistake(boat, pilot, SEED + 1000 * seed + 100 * KINDS.index(kind) + k, wrong, hidden)


def write(case: Mistake, folder: Path) -> tuple[Path, Path]:
    """Sail it: the log, and the vessel file with the mistake."""
    log, file = folder / "voyage.tlog", folder / "vessel.toml"
    boat, wrong = case.boat, dict(case.wrong)
    thrust, x = wrong.pop("thrust", 1.0), wrong.pop("x", 1.0)
    motors = [
        replace(m, astern=thrust * m.astern, ahead=thrust * m.ahead, x=x * m.x) for m in boat.motors
    ]
    hull = boat.hull._replace(**{name: f * getattr(boat.hull, name) for name, f in wrong.items()})
    file.write_text(vessel_toml(replace(boat, hull=hull, motors=tuple(motors))), encoding="utf-8")
    write_voyage(log, case.boat, case.hidden, case.pilot, case.seed, SECONDS)
    return log, file


def is_right(case: Mistake, said: Mapping[str, Any]) -> bool:
    """Whether what is there is named, and nothing else, and no more is said to be missing."""
    return set(said["effects"]) == case.effects and said["verdict"] != "unknown"


def off_by(case: Mistake, found: DiagnosisResult) -> str:
    """How far each wrong number of the hull is from the truth in the end."""
    boat = found.diagnosis.vessel
    pairs = ((n, getattr(boat.dynamics, n) / getattr(case.boat.hull, n)) for n in case.wrong
             if n not in ("thrust", "x"))  # fmt: skip
    return ", ".join(f"{name} {100.0 * (ratio - 1.0):+.0f} %" for name, ratio in pairs) or "–"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mistakes", description=__doc__)
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--beside", action="store_true", help="something else is hidden too")
    parser.add_argument("--every", type=int, default=1, help="only every so many of ten voyages")
    parser.add_argument("--seed", type=int, default=0, help="other dice")
    a = parser.parse_args(arguments)
    heads = ("wrong in the file", "boat, pilot", "hidden", "answer", "right", "error (noise)",
             "in the end", "s")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for kind in a.kind:
        for case in list(mistakes(kind, a.beside, a.seed))[:: a.every]:
            with tempfile.TemporaryDirectory() as folder:
                done = diagnosed(*write(case, Path(folder)))
            wrong = ", ".join(f"{name} × {factor:.2f}" for name, factor in case.wrong.items())
            row = [wrong, f"{case.boat.name}, {case.pilot}",
                   ", ".join(sorted({h.name for h in case.hidden})) or "–",
                   done.answer, "yes" if is_right(case, done.said) else "**no**", done.errors,
                   off_by(case, done.found), f"{done.seconds:.0f}"]  # fmt: skip
            print(f"| {' | '.join(row)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
