"""Days with several causes on a hull of another author: Fossen's Otter, see `benchmarks.otter`.

    python -m benchmarks.otter_days --source PATH [--days 20] [--seed 0] [--out DIR]

Each day has two to four drawn causes, of water, air, motors, hull and compass one each at most; a
current and a wind may become another at a drawn time, a motor may fail. The boat's owner has fitted
the vessel to one quiet voyage (`benchmarks.owner`). A table comes out: what was hidden, what was
said, and whether each cause was named and nothing invented. No law is shared with `sim`.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.random import Generator as Dice

from benchmarks.otter import (
    SECONDS,
    TROUBLES,
    Otter,
    Trouble,
    Wrench6,
    boat,
    dead_band,
    lag,
    says,
    towed,
    use_source,
    wind,
    write,
)
from benchmarks.owner import diagnosed, first_voyage
from sim.state import Floats

Draw = Callable[[Dice, Trouble], tuple[str, Trouble]]  # -> the effect's name, the trouble with it
PILOTS = ("excitation", "survey", "wander", "drills")
AWAY = 120.0  # s between a change and either end of the voyage, at least
OTHER_CURRENT, OTHER_WIND = 0.12, 4.0  # m/s by which one that changes becomes another, at least


def _moment(dice: Dice) -> float:
    return float(dice.uniform(AWAY, SECONDS - AWAY))


def _velocity(dice: Dice, low: float, high: float) -> tuple[float, float]:
    """A speed [m/s], and where to [degrees]."""
    return float(dice.uniform(low, high)), float(dice.uniform(0.0, 360.0))


def _another(
    dice: Dice, first: tuple[float, float], low: float, high: float, least: float
) -> tuple[float, float]:
    """A velocity that differs from the first by so much [m/s]."""
    while True:
        later = _velocity(dice, low, high)
        a, b = (speed * np.exp(1j * math.radians(towards)) for speed, towards in (first, later))
        if abs(a - b) >= least:
            return later


def _current(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    return "steady_current", replace(t, current=_velocity(dice, 0.12, 0.4))


def _current_change(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    first = _velocity(dice, 0.1, 0.4)
    later = _another(dice, first, 0.1, 0.4, OTHER_CURRENT)
    return "current_change", replace(t, current=first, turns=(_moment(dice), *later))


def _wind(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    return "steady_wind", replace(t, push=_sum(t.push, wind(*_velocity(dice, 5.0, 11.0))))


def _wind_change(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    first = _velocity(dice, 3.0, 10.0)
    later = _another(dice, first, 5.0, 11.0, OTHER_WIND)
    before, after, at = wind(*first), wind(*later), _moment(dice)

    def push(otter: Otter, now: float, eta: Floats, nu: Floats) -> Floats:
        return (before if now < at else after)(otter, now, eta, nu)

    return "wind_change", replace(t, push=_sum(t.push, push))


def _sum(one: Wrench6, other: Wrench6) -> Wrench6:
    return lambda otter, t, eta, nu: one(otter, t, eta, nu) + other(otter, t, eta, nu)


def _share(dice: Dice, t: Trouble, low: float, high: float, since: float) -> Trouble:
    """One motor, either, gives a share of its thrust from a time [s] on."""
    left = bool(dice.integers(2))
    root = math.sqrt(dice.uniform(low, high))
    inner = t.command

    def command(c: Floats, now: float, nu: Floats) -> Floats:
        shares = np.ones(2)
        shares[0 if left else 1] = root if now >= since else 1.0
        return inner(c, now, nu) * shares

    return replace(t, command=command)


def _imbalance(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    return "thruster_imbalance", _share(dice, t, 0.65, 0.85, 0.0)


def _fault(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    return "thruster_fault", _share(dice, t, 0.35, 0.7, _moment(dice))


def _dead_band(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    inner = t.command
    return "thruster_deadband", replace(
        t, command=lambda c, now, nu: dead_band(inner(c, now, nu), now, nu)
    )


def _lag(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    return "thruster_lag", replace(t, changed=lag(float(dice.uniform(0.5, 0.9))))


def _drogue(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    return "towed_load", replace(t, push=_sum(t.push, towed))


def _compass(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    off = math.radians(float(dice.uniform(5.0, 9.0))) * float(dice.choice([-1.0, 1.0]))
    return "heading_offset", replace(t, cause=says(yaw=lambda a: a + off))


def _iron(dice: Dice, t: Trouble) -> tuple[str, Trouble]:
    size, towards = float(dice.uniform(0.1, 0.16)), float(dice.uniform(-math.pi, math.pi))
    return "compass_deviation", replace(t, cause=says(yaw=lambda a: a + size * np.sin(a - towards)))


WHERE: dict[str, Sequence[Draw]] = {
    "water": (_current, _current_change),
    "air": (_wind, _wind_change),
    "motors": (_imbalance, _fault, _dead_band, _lag),
    "hull": (_drogue,),
    "compass": (_compass, _iron),
}
SHARES = (0.3, 0.3, 0.25, 0.05, 0.1)  # of the draws; the drogue is hardly told alone


def day(number: int) -> tuple[list[str], Trouble]:
    """Names of what is hidden, and a day with it."""
    dice = np.random.default_rng([0x0DA7, number])
    trouble = Trouble("", str(dice.choice(PILOTS)))
    count = int(dice.integers(2, 5))
    names = []
    for where in dice.choice(list(WHERE), size=count, replace=False, p=SHARES):
        draws = WHERE[str(where)]
        name, trouble = draws[int(dice.integers(len(draws)))](dice, trouble)
        names.append(name)
    return sorted(names), trouble


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.otter_days", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--source", type=Path, required=True, help="src of PythonVehicleSimulator")
    parser.add_argument("--days", type=int, default=20, help="so many, from number 1000 × seed")
    parser.add_argument("--only", type=int, action="append", help="this day alone")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/otter-days"))
    a = parser.parse_args(arguments)
    use_source(parser, a.source)
    vessel = first_voyage(
        a.out, boat(0.0), lambda log: write(log, TROUBLES["none"], 1000 + a.seed, 0.0)
    )
    named = clean = 0
    print("| day | hidden | answer | named | none invented | s |\n|---|---|---|---|---|---|")
    numbers = a.only or range(1000 * a.seed, 1000 * a.seed + a.days)
    for number in numbers:
        hidden, trouble = day(number)
        log = a.out / f"day-{number:04d}.tlog"
        write(log, trouble, 20_000 + number, 0.0)
        began = time.perf_counter()
        said = json.loads(diagnosed(log, vessel).read_text(encoding="utf-8"))
        took = time.perf_counter() - began
        found = set(said["effects"])
        named += (all_named := set(hidden) <= found)
        clean += (none_invented := found <= set(hidden))
        errors = [said["ladder"][i]["heldout_nrmse"] for i in (0, -1)]
        answer = (
            f"`{said['verdict']}` {', '.join(said['effects'])}; {errors[0]:.3f} → {errors[1]:.3f}"
        )
        print(
            f"| {number}, {trouble.pilot} | {', '.join(hidden)} | {answer} "
            f"({said['noise_floor_nrmse']:.3f}) | {'yes' if all_named else 'no'} "
            f"| {'yes' if none_invented else 'no'} | {took:.0f} |",
            flush=True,
        )
    print(f"\nevery cause named on {named} of {len(numbers)}, none invented on {clean}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
