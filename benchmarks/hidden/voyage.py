"""One voyage of one boat with something hidden, as a .tlog.

python -m benchmarks.hidden.voyage out.tlog --boat teal --hidden steady_current:speed=0.3,direction=1.2
"""  # noqa: E501

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.hidden.boats import FLEET, Boat
from benchmarks.hidden.causes import Hidden, causes_of
from benchmarks.hidden.link import recorded
from benchmarks.hidden.missions import PILOTS
from benchmarks.hidden.nature import Nature
from benchmarks.hidden.sail import Truth, sail, ticks_of
from benchmarks.hidden.sensors import Sensors, estimate_error
from benchmarks.hidden.talk import RAISED, RATES, Rates, conversation
from benchmarks.hidden.telemetry import Clock
from benchmarks.hidden.vessel_toml import vessel_toml


def write_voyage(
    path: Path,
    boat: Boat,
    hidden: Sequence[Hidden],
    excitation: str,
    seed: int,
    seconds: float,
    rates: Rates = RAISED,
) -> Truth:
    """Sail and record; the same arguments give the same bytes. Returns what really happened."""
    dice = [np.random.default_rng([seed, i]) for i in range(5)]
    nature = Nature(boat, causes_of(hidden))
    noise = estimate_error(ticks_of(seconds), dice[0])
    start = [*dice[1].uniform(-5.0, 5.0, 2).tolist(), float(dice[1].uniform(-math.pi, math.pi))]
    truth = sail(nature, PILOTS[excitation](boat, dice[2]), noise, start, seconds)
    clock = Clock(boot=float(dice[1].uniform(60.0, 600.0)), unix=1.75e9 + 86_400.0 * (seed % 300))
    sensors = Sensors(nature, truth, noise, dice[3])
    said = conversation(boat, sensors, truth, rates, clock)
    path.write_bytes(recorded(said, clock, dice[4]))
    return truth


def hidden_of(text: str) -> Hidden:
    """`name:key=value,key=value` -> what is hidden."""
    name, _, values = text.partition(":")
    pairs = (pair.split("=") for pair in values.split(",") if pair)
    return Hidden(name, {key: float(value) for key, value in pairs})


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden.voyage", description=__doc__)
    parser.add_argument("path", type=Path, help="the .tlog to write")
    parser.add_argument("--boat", choices=FLEET, default="grebe")
    parser.add_argument("--hidden", type=hidden_of, action="append", default=[])
    parser.add_argument("--pilot", choices=PILOTS, default="excitation")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=300.0, help="armed")
    parser.add_argument("--rates", choices=RATES, default="raised")
    parser.add_argument("--vessel", type=Path, help="also write the vessel file of the plain boat")
    a = parser.parse_args(arguments)
    boat = FLEET[a.boat]
    try:
        write_voyage(a.path, boat, a.hidden, a.pilot, a.seed, a.seconds, RATES[a.rates])
        if a.vessel:
            a.vessel.write_text(vessel_toml(boat), encoding="utf-8")
    except (ValueError, OSError) as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
