"""A plant that nothing inverts, made to move as another boat: by prediction, and by an inverse.

    python -m benchmarks.following [--seconds 120] [--write]

Tables 7 and 8 of the paper (see benchmarks/paper) with the WAM-V afloat in MuJoCo, six degrees of
freedom, as what moves; the reference is IAcquaBot under the paper's joystick. Beside the predictive
follower stands the K e law with an inverse of three degrees: the right one (the vessel file that
the hull is made from), one whose nine numbers are 10 % off, and that of another boat. Then two
hulls that nothing here was tuned on, thrust limits kept, and what a row costs. `--write` renews
benchmarks/results/following.md.
"""

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.paper import excitations
from benchmarks.paper.boats import iacquabot, wam_v
from benchmarks.paper.campaign import DRIVER, Lengths
from benchmarks.paper.mismatch import Misjudged
from benchmarks.paper.published import CHANNELS, TABLE_7_FOLLOWING, TABLE_8, UNITS
from benchmarks.paper.scoring import header, off, row, scored
from benchmarks.paper.table4 import simulated
from benchmarks.paper.table7 import DT
from benchmarks.paper.table8 import disturbed, resultant, root_mean_square
from gateway.vessel_file import load_vessel
from sim.following.follower import FollowerOptions
from sim.following.stepwise import PlantFollower
from sim.model import Model
from sim.plants.mujoco_hull import MujocoHull
from sim.plants.plant import Plant, VesselPlant
from sim.state import Floats
from sim.vessel import Vessel

RESULTS = Path(__file__).parent / "results" / "following.md"
PREDICTED, RIGHT, WRONG, OTHER = "predictive", "right inverse", "10 % off", "another boat's"
BUDGET_MS = 20.0  # of a row at 50 Hz
LIMITED = FollowerOptions(limits=True)


def reference(seconds: float) -> Floats:
    """IAcquaBot under the paper's joystick, from rest: (T, 9)."""
    boat = iacquabot().vessel
    commands = excitations.joystick(seconds, np.random.default_rng([DRIVER, 3]))
    side = [0 if t.position[1] < 0.0 else 1 for t in boat.thrusters]
    return simulated(boat, commands[:, side], DT)


def plants(hull: Vessel, known: Vessel) -> dict[str, Plant]:
    """Ways to follow with a hull in MuJoCo; `known` is what an inverse can be made of."""
    moves = MujocoHull.of(Model.of(hull))
    careless = wam_v().guessed(Lengths().seed)
    believed = {RIGHT: known, WRONG: careless, OTHER: iacquabot().vessel}
    inverted = {n: Misjudged(moves, VesselPlant(Model.of(v))) for n, v in believed.items()}
    return {PREDICTED: moves, **inverted}


def followed(
    plant: Plant, vessel: Vessel, wanted: Floats, options: FollowerOptions | None = None
) -> tuple[Floats, Floats, float]:
    """Reference (T, 9) -> shadow (T, 9), CPU time of each row [ms], share of rows at a limit."""
    follower = PlantFollower.of(plant, options, vessel)
    follower.prepare()
    state, shadow, spent, limited = follower.start(), np.empty_like(wanted), [], 0
    for k in range(len(wanted)):
        begun = time.thread_time()
        result = follower.advance(state, np.array([DT * k]), wanted[k : k + 1])
        spent.append(1e3 * (time.thread_time() - begun))
        state, shadow[k] = result.state, result.shadows[0]
        limited += int(result.limited[0])
    return shadow, np.array(spent[1:]), limited / len(wanted)


def table_7(wanted: Floats) -> list[str]:
    """RMSE of each channel beside the paper's, way by way."""
    wam = wam_v().vessel
    found, times = {}, {}
    for name, plant in plants(wam, wam).items():
        shadow, times[name], _ = followed(plant, wam, wanted)
        found[name] = scored(wanted[:, :6], shadow[:, :6])
    lines = ["## Table 7: WAM-V in MuJoCo made to move as IAcquaBot", ""]
    lines += ["RMSE; the paper's plant has three degrees of freedom and its inverse is right.", ""]
    lines += header(["", "paper", *found])
    for c in CHANNELS:
        numbers = [f"{s[c].rmse:.4f}" for s in found.values()]
        lines.append(row([f"{c} [{UNITS[c]}]", f"{TABLE_7_FOLLOWING[c].rmse:.4f}", *numbers]))
    p50, p99 = np.percentile(times[PREDICTED], (50, 99))
    law = np.percentile(times[RIGHT], 50)
    share = 100.0 * float(np.mean(times[PREDICTED])) / BUDGET_MS
    cost = (
        f"A row of 20 ms takes {p50:.1f} ms of a core by prediction (p99 {p99:.1f}), {law:.1f} ms "
        f"by the law in Python. Prediction at 50 Hz takes {share:.0f} % of a core."
    )
    return [*lines, "", cost, ""]


def table_8(wanted: Floats) -> list[str]:
    """The largest RMSE of the six channels under each trial's pushes, and of position."""
    wam = wam_v().vessel
    lines = ["## Table 8: current and wind that push the hull", ""]
    lines += [
        "Largest RMSE of the six channels, then that of position [m]. The inverses do not know of "
        "the pushes; the predictive follower steps the hull itself, and so it does.", "",
        *header(["trial", PREDICTED, RIGHT, WRONG, OTHER]),
    ]  # fmt: skip
    for number, pushes in enumerate(TABLE_8, 1):
        cells = []
        for plant in plants(disturbed(wam, pushes), wam).values():
            error = off(wanted[:, :6], followed(plant, wam, wanted)[0][:, :6])
            rmse = root_mean_square(error)
            cells.append(f"{max(rmse.values()):.4f}, {np.hypot(rmse['x'], rmse['y']):.4f}")
        lines.append(row([f"{number}: {resultant(pushes)}", *cells]))
    return [*lines, ""]


def other_hulls(wanted: Floats) -> list[str]:
    """Hulls that nothing was tuned on, and thrust that does not suffice everywhere."""
    lines = ["## Other hulls, and thrust limits", ""]
    lines += ["The same path at twice the pace. RMSE; share of rows at a limit of thrust.", ""]
    lines += header(["hull", "way", *(f"{c} [{UNITS[c]}]" for c in CHANNELS), "at a limit"])
    fast = paced(wanted, 2.0)
    for name in ("wam-v", "otter", "blueboat"):
        vessel = load_vessel(name)
        ways = plants(vessel, vessel)
        for way, plant, options in (
            ("predictive, no limits", ways[PREDICTED], FollowerOptions()),
            ("predictive, within limits", ways[PREDICTED], LIMITED),
            ("right inverse, clipped", ways[RIGHT], LIMITED),
        ):
            shadow, _, limited = followed(plant, vessel, fast, options)
            scores = scored(fast[:, :6], shadow[:, :6])
            numbers = [f"{scores[c].rmse:.4f}" for c in CHANNELS]
            lines.append(row([vessel.name, way, *numbers, f"{100 * limited:.0f} %"]))
    sway = (
        "Two thrusters astern give no sway: with limits, what the reference has of it is left out, "
        "and the position keeps its distance."
    )
    return [*lines, "", sway, ""]


def paced(wanted: Floats, pace: float) -> Floats:
    """The same path, `pace` times as fast."""
    rows = np.arange(0.0, len(wanted) - 1.0, pace)
    out = np.column_stack([np.interp(rows, np.arange(len(wanted)), c) for c in wanted.T])
    out[:, 3:6] *= pace
    out[:, 6:] *= pace**2
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, print, and write where asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--write", action="store_true", help=f"renew {RESULTS.name}")
    options = parser.parse_args(arguments)
    wanted = reference(options.seconds)
    lines = [
        "# Following what nothing inverts", "",
        f"`python -m benchmarks.following --seconds {options.seconds:g} --write`, "
        f"{time.strftime('%Y-%m-%d')}, {os.cpu_count()} cores with a load of "
        f"{os.getloadavg()[0]:.0f}; CPU times.", "",
    ]  # fmt: skip
    for part in (table_7, table_8, other_hulls):
        done = part(wanted)
        print("\n".join(done), flush=True)
        lines += done
    if options.write:
        RESULTS.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
