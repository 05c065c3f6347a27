"""Is a wind told by boats whose areas above water nobody knows: named, from where, how strong?

    python -m benchmarks.wind [--kind steady gusts areas masts calm] [--boats grebe …] [--rivals]

Voyages of the blind test's generator (`benchmarks.hidden`: Blendermann's coefficients; it shares no
code with `sim`), tuning seeds. The areas are taken out of the vessel file. Kinds: a steady
wind; the same with gusts (turbulence of 20 %, direction ± 10°); areas of half and of twice what is
assumed; masts, which bring the centre of what the wind presses on by an eighth of the length ahead
of midships or aft; calm, where no wind may be named. Printed: the verdict, the effects found, the
error of the direction, of the force abeam, the range of the speed and whether it holds the true
(mean) one. `--rivals` tries what looks like a wind alone, not the whole catalogue: a few times
faster.
"""

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.hidden.boats import EVERY, Boat
from benchmarks.hidden.causes.water import AIR, steady_wind
from benchmarks.hidden.link import recorded
from benchmarks.hidden.missions import PILOTS
from benchmarks.hidden.nature import Cause, Nature
from benchmarks.hidden.sail import sail, ticks_of
from benchmarks.hidden.scene import Push, Scene
from benchmarks.hidden.sensors import Sensors, estimate_error
from benchmarks.hidden.talk import RAISED, conversation
from benchmarks.hidden.telemetry import Clock
from benchmarks.hidden.vessel_toml import vessel_toml
from gateway.offline.diagnose import diagnose_logs
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.effects.catalogue import EFFECTS, named
from sim.wind import assumed_wind_areas

SEED = 40_000  # of the tuning set's, which end at 50_000
CROSS = 0.85  # the generator's coefficient abeam
PAIRS = (
    ("grebe", "survey"), ("wam-v", "excitation"), ("heron", "survey"), ("dory", "wander"),
    ("iacquabot", "excitation"), ("teal", "survey"),
)  # fmt: skip
RIVALS = (
    "steady_wind", "steady_current", "varying_current", "inertial_force", "compass_deviation",
    "heading_offset", "thruster_imbalance", "thruster_misalignment", "hull_lift", "cross_damping",
)  # fmt: skip
KINDS = ("steady", "gusts", "areas", "masts", "calm")
OFF = 0.125  # lengths that masts bring the centre of the lateral area ahead or aft


class Voyage(NamedTuple):
    """One voyage; speed 0: calm."""

    kind: str
    boat: Boat
    pilot: str
    seed: int
    speed: float  # m/s, of the mean
    direction: float  # rad, from
    centre: float = 0.0  # of what it presses on, lengths ahead of midships


def voyages(kind: str, boats: Sequence[str]) -> Iterator[Voyage]:
    """Those of one kind, of these boats; a voyage is the same whatever the others."""
    for k, (name, pilot) in enumerate(PAIRS):
        if name not in boats:
            continue
        dice, boat = np.random.default_rng([SEED, k]), EVERY[name]
        speed, direction = float(dice.uniform(7.0, 11.0)), float(dice.uniform(-math.pi, math.pi))
        if kind == "areas":
            if k < 4:
                boat = with_areas(boat, 0.5 if k % 2 else 2.0)
                yield Voyage(kind, boat, pilot, SEED + 300 + k, speed, direction)
        elif kind == "masts":
            centre = -OFF if k % 2 else OFF
            yield Voyage(kind, boat, pilot, SEED + 400 + k, speed, direction, centre)
        elif kind == "calm":
            yield Voyage(kind, boat, pilot, SEED + 200 + k, 0.0, 0.0)
        else:
            yield Voyage(kind, boat, pilot, SEED + 100 * (kind == "gusts") + k, speed, direction)


def with_areas(boat: Boat, factor: float) -> Boat:
    """A boat with areas `factor` times what would be assumed of it."""
    front, side = assumed_wind_areas(boat.hull.length, boat.hull.beam)
    return replace(boat, hull=boat.hull._replace(frontal=factor * front, lateral=factor * side))


def gusty_wind(speed: float, direction: float, seed: int) -> Cause:
    """Waves of speed (rms 20 % of the mean) and of direction (rms 10°), 4 s to two minutes long."""
    dice = np.random.default_rng([seed, 0x6057])
    periods = np.geomspace(4.0, 120.0, 12)
    size = math.sqrt(2.0 / len(periods))
    phases, turns = dice.uniform(-math.pi, math.pi, (2, len(periods)))

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        angle = 2.0 * np.pi * s.time / periods
        now = speed * (1.0 + 0.2 * size * float(np.sin(angle + phases).sum()))
        veer = math.radians(10.0) * size * float(np.sin(angle + turns).sum())
        wind = steady_wind(max(now, 0.0), direction + veer).push
        assert wind is not None
        return wind(s, thrusts)

    return Cause(push=push)


def write(voyage: Voyage, folder: Path, seconds: float) -> tuple[Path, Path]:
    """Sail it: the log, and the vessel file without areas."""
    v, dice = voyage, [np.random.default_rng([voyage.seed, i]) for i in range(5)]
    wind = (
        gusty_wind(v.speed, v.direction, v.seed)
        if v.kind == "gusts"
        else steady_wind(v.speed, v.direction, v.centre)
    )
    nature = Nature(v.boat, [wind] if v.speed > 0.0 else [])
    noise = estimate_error(ticks_of(seconds), dice[0])
    start = [*dice[1].uniform(-5.0, 5.0, 2).tolist(), float(dice[1].uniform(-math.pi, math.pi))]
    truth = sail(nature, PILOTS[v.pilot](v.boat, dice[2]), noise, start, seconds)
    clock = Clock(boot=float(dice[1].uniform(60.0, 600.0)), unix=1.75e9)
    said = conversation(v.boat, Sensors(nature, truth, noise, dice[3]), truth, RAISED, clock)
    log, file = folder / "voyage.tlog", folder / "vessel.toml"
    log.write_bytes(recorded(said, clock, dice[4]))
    file.write_text(without_areas(vessel_toml(v.boat)), encoding="utf-8")
    return log, file


def without_areas(text: str) -> str:
    """A vessel file without its areas above water."""
    lines = text.splitlines(keepends=True)
    left = [line for line in lines if not line.startswith("wind_area")]
    assert len(left) == len(lines) - 1
    return "".join(left)


def line(voyage: Voyage, found: dict[str, Any], seconds: float) -> str:
    """One row of the table."""
    v = voyage
    row = [v.kind, v.boat.name, v.pilot, found["verdict"], " + ".join(found["effects"]) or "–"]
    told = next((a for a in found["assumed"] if a["effect"] == "steady_wind"), None)
    if told is None or v.speed == 0.0:
        row += ["", "", "", ""]
    else:
        off = math.degrees(math.remainder(math.radians(told["from_deg"]) - v.direction, math.tau))
        abeam = 0.5 * AIR * CROSS * v.boat.hull.lateral * v.speed**2
        low, high = told["speed_low_mps"], told["speed_high_mps"]
        row += [
            f"{off:+.0f}°", f"{100.0 * (told['force_abeam_N'] / abeam - 1.0):+.0f} %",
            f"{v.speed:.1f} in {low:.1f} … {high:.1f}", "yes" if low <= v.speed <= high else "NO",
        ]  # fmt: skip
    return f"| {' | '.join([*row, f'{seconds:.0f}'])} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wind")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    names = [name for name, _ in PAIRS]
    parser.add_argument("--boats", nargs="+", choices=names, default=names)
    parser.add_argument("--seconds", type=float, default=300.0, help="of each voyage")
    parser.add_argument("--rivals", action="store_true", help="instead of the whole catalogue")
    a = parser.parse_args(arguments)
    settings = DiagnoseSettings(effects=tuple(map(named, RIVALS)) if a.rivals else EFFECTS)
    heads = ("kind", "boat", "pilot", "verdict", "found", "direction", "force abeam", "speed [m/s]",
             "held", "s")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for kind in a.kind:
        for voyage in voyages(kind, a.boats):
            with tempfile.TemporaryDirectory() as folder:
                log, file = write(voyage, Path(folder), a.seconds)
                begun = time.perf_counter()
                found = diagnose_logs([log], file, settings=settings).to_dict()
                print(line(voyage, found, time.perf_counter() - begun), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
