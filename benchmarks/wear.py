"""How often wear is found, and how often it is only thought to be: made series, made voyages.

    python -m benchmarks.wear series --seed 2            # false alarms, and losses found
    python -m benchmarks.wear voyages FOLDER --seed 2    # recordings of a boat that wears

Seed 1 is for tuning, any other for reporting.
"""

import argparse
import subprocess
import sys
from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.talk import MODEST
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage
from sim.wear import Evidence, Series, believed, evidence_of

WEARS = (-1, -1, 1, 1, 0, 0, 0, 0)  # of one boat: two thrusters, two of drag, four of damping
RECORDINGS, DAYS = 20, 100.0
LOSS = 0.1
STATED = 0.006  # median standard deviation that a fit states, as a share; as on made voyages


class Counts(NamedTuple):
    """Of made fleets: how many raised any alarm, and how many found what was there."""

    fleets: int
    false: int
    found: int
    held: int  # 95 % intervals of those found that hold the true loss


def made(
    random: np.random.Generator, change: float, kind: str, scatter: float, heavy: bool, wears: int
) -> Series:
    """One number over recordings: its level, its change, and the scatter of voyages."""
    time = np.sort(random.uniform(0.0, DAYS, RECORDINGS))
    level = np.ones(RECORDINGS)
    if kind == "step":
        level[random.integers(5, RECORDINGS - 4) :] += change
    elif kind:
        begins = time[0] if kind == "drift" else time[RECORDINGS // 2]
        level += change * np.maximum(time - begins, 0.0) / (time[-1] - begins)
    std = STATED * random.uniform(0.5, 2.0, RECORDINGS)
    noise = random.standard_t(3, RECORDINGS) / np.sqrt(3.0) if heavy else random.normal(
        size=RECORDINGS
    )  # fmt: skip
    value = level + std * random.normal(size=RECORDINGS) + scatter * noise
    return Series(time, value, std, wears)


def count(
    seed: int, fleets: int, boats: int, kind: str, scatter: float, heavy: bool, change: float
) -> Counts:
    """Fleets of so many boats; where there is a `kind`, one thruster of one changes by so much."""
    random = np.random.default_rng([seed, boats, int(1e4 * scatter), len(kind), heavy, change > 0])
    false = found = held = 0
    for _ in range(fleets):
        series = [made(random, 0.0, "", scatter, heavy, w) for _ in range(boats) for w in WEARS]
        if kind:
            series[0] = made(random, change, kind, scatter, heavy, WEARS[0])
        evidence = [evidence_of(one, i) for i, one in enumerate(series)]
        sure = believed([e.p_value for e in evidence if e is not None], WEARS * boats)
        false += bool(sure[1 if kind else 0 :].any())
        if kind and sure[0] and isinstance(evidence[0], Evidence):
            found += 1
            low, high = evidence[0].change.share95
            held += low <= change <= high
    return Counts(fleets, false, found, held)


def print_series(seed: int, fleets: int) -> None:
    """The table of results/wear.md."""
    print(f"seed {seed}, {date.today()}: {RECORDINGS} recordings over {DAYS:.0f} days, "
          f"{len(WEARS)} numbers a boat, change {LOSS:.0%}\n")  # fmt: skip
    print("| boats | scatter of voyages | what happens | false alarms | found | interval holds |")
    print("|---|---|---|---|---|---|")
    lost, gained = -LOSS, LOSS
    for boats, scatter, kind, heavy, change in [
        (1, 0.01, "", False, 0.0), (1, 0.03, "", False, 0.0), (1, 0.03, "", True, 0.0),
        (5, 0.02, "", False, 0.0),
        *((1, s, k, False, lost) for s in (0.02, 0.03, 0.04) for k in ("step", "drift")),
        (1, 0.03, "late drift", False, lost), (1, 0.03, "step", True, lost),
        (1, 0.03, "drift", True, lost), (1, 0.03, "step", False, gained),
        (1, 0.03, "drift", False, gained), (5, 0.02, "drift", False, lost),
        (5, 0.03, "drift", False, lost),
    ]:  # fmt: skip
        done = count(seed, fleets if kind else 3 * fleets, boats, kind, scatter, heavy, change)
        rate = f"{done.found / done.fleets:.0%}" if kind else "–"
        held = f"{done.held / done.found:.0%}" if done.found else "–"
        name = f"{kind or 'nothing'}{' up' * (change > 0.0)}{', heavy tails' * heavy}"
        false = f"{done.false / done.fleets:.1%}"
        print(f"| {boats} | {scatter:.0%} | {name} | {false} | {rate} | {held} |", flush=True)


def make_voyages(folder: Path, seed: int, seconds: float, loss: float) -> None:
    """Twenty recordings of a boat whose port thruster loses that share, each in its own water."""
    boat, random = BOATS["grebe"], np.random.default_rng([seed, 7])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "worn.toml").write_text(vessel_toml(boat), encoding="utf-8")
    for i in range(RECORDINGS):
        gain = 1.0 - loss * i / (RECORDINGS - 1)
        water = {
            "speed": float(random.uniform(0.0, 0.1)),
            "direction": float(random.uniform(-3, 3)),
        }
        hidden = [
            Hidden("thruster_imbalance", {"port_gain": gain}), Hidden("steady_current", water),
        ]  # fmt: skip
        file = folder / f"worn-{i:02d}.tlog"
        if not file.exists():  # a voyage's seed is its day, too
            write_voyage(file, boat, hidden, "excitation", 300 * seed + 3 * i, seconds, MODEST)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wear", description=__doc__)
    parser.add_argument("what", choices=("series", "voyages"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/wear"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fleets", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--loss", type=float, default=LOSS, help="of voyages; 0: a steady boat")
    parser.add_argument("--workers", type=int, default=2)
    a = parser.parse_args()
    if a.what == "series":
        print_series(a.seed, a.fleets)
        return 0
    make_voyages(a.folder, a.seed, a.seconds, a.loss)
    shadow = [sys.executable, "-c", "from gateway.cli import run; run()", "fleet", str(a.folder),
              "--vessel", str(a.folder / "worn.toml"), "--out", str(a.folder / "table"),
              "--steps", "identify", "--workers", str(a.workers)]  # fmt: skip
    return subprocess.run(shadow, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
