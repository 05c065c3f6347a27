"""Are a boat's numbers followed while it sails, and do they stand still where nothing shows them?

    python -m benchmarks.live_parameters tuning|reporting [--cache DIR] [--sail]

Voyages of the blind test's generator (`benchmarks.hidden`: physics that shares no code with `sim`)
go through the path of a replay, and the seconds that come of them through `NumberFollower`. A
thruster changes by 20 % on the way, or the drag by 30 %; or nothing does, in still water, in a
current, in wind; or the boat sails an hour at constant speed, in a tide and a wind that turn.

Numbers were chosen on `tuning`; the figures are those of `reporting`: other seeds, thrusters, days.
Printed: how long the changed number took to come within a third of the change of the truth and to
stay there, the largest error from three minutes on, when its event came, the largest error of all
numbers, how far they moved, the share of seconds in which a 95 % interval holds the truth, and
false events.
"""

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.hidden.boats import FLEET, Hull
from benchmarks.hidden.causes import Hidden, causes_of
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.scene import Stream
from benchmarks.live_diagnosis import Case, _current, _thrown
from benchmarks.live_naming import remembered
from sim.model import Model
from sim.monitoring import SecondMeans
from sim.monitoring.recursive import NumberFollower
from sim.state import Floats
from sim.vessel import Vessel

SECONDS, BEGINS, HOUR = 420.0, 120.0, 3600.0
PAIRS = {
    "tuning": (("grebe", "survey"), ("teal", "wander"), ("wam-v", "excitation"),
               ("heron", "survey")),
    "reporting": (("grebe", "drills"), ("dory", "wander"), ("iacquabot", "excitation"),
                  ("wam-v", "survey")),
}  # fmt: skip
STEADY = {"tuning": "grebe", "reporting": "wam-v"}
SETS = {"tuning": 21, "reporting": 23}  # first word of every seed
KINDS = ("thrust", "nothing", "drag", "current", "wind", "hour")
CHANGE, GROWTH = 0.2, 0.3
SOON_S, SETTLED_S = 180.0, 120.0
NEAR = CHANGE / 3.0  # of the truth: the change counts as followed


def cases(which: str) -> Iterator[tuple[Case, dict[str, float]]]:
    """Voyages, each with what its numbers come to in the end, as multiples of the vessel file's."""
    made = [one for k in range(len(PAIRS[which])) for one in _cases(which, k)]
    for kind in KINDS:
        yield from (one for one in made if one[0].kind == kind)


def _cases(which: str, k: int) -> Iterator[tuple[Case, dict[str, float]]]:
    """Those of one boat and course."""
    (boat, pilot), dice = PAIRS[which][k], np.random.default_rng([SETS[which], k])
    seed = 1000 * SETS[which] + 10 * k
    motor = FLEET[boat].motors[int(dice.integers(len(FLEET[boat].motors)))]
    share = 1.0 + CHANGE * (-1.0 if k % 2 == 0 else 1.0)
    gain = {"channel": float(motor.channel), "gain": share, "time": BEGINS}
    causes = tuple(causes_of([Hidden("thruster_fault", gain)]))
    truth = {f"thrust {motor.name}": share}
    yield Case("thrust", boat, pilot, seed, causes, begins=BEGINS), truth
    drag = Case("drag", boat, pilot, seed + 2, (_grown(1.0 + GROWTH),), begins=BEGINS)
    yield drag, {"drag": 1.0 + GROWTH}
    yield Case("nothing", boat, pilot, seed + 3), {}
    flow = _thrown(dice, 0.2, 0.4)
    yield Case("current", boat, pilot, seed + 4, (_current(flow, BEGINS),), flow, BEGINS), {}
    air = _thrown(dice, 4.0, 9.0)
    blown = {"speed": math.hypot(*air), "direction": math.atan2(-air[1], -air[0])}
    yield Case("wind", boat, pilot, seed + 5, tuple(causes_of([Hidden("steady_wind", blown)]))), {}
    if k == 0:
        air = _thrown(dice, 2.0, 6.0)
        blown = {"speed": math.hypot(*air), "direction": math.atan2(-air[1], -air[0])}
        turned = (_tide(dice), *causes_of([Hidden("steady_wind", blown)]))
        yield Case("hour", STEADY[which], "straight", seed + 6, turned), {}


def _grown(factor: float) -> Cause:
    """Surge drag times that from `BEGINS` on, within five seconds."""

    def grown(h: Hull, time: float) -> Hull:
        more = 1.0 + (factor - 1.0) * min(max((time - BEGINS) / 5.0, 0.0), 1.0)
        return h._replace(X_u=h.X_u * more, X_uu=h.X_uu * more)

    return Cause(hull=grown)


def _tide(dice: np.random.Generator) -> Cause:
    """Water that turns once around within two hours."""
    speed, phase = float(dice.uniform(0.1, 0.25)), float(dice.uniform(-math.pi, math.pi))
    rate = 2.0 * math.pi / 7200.0

    def water(at: float, north: float, east: float) -> Stream:
        c, s = speed * math.cos(rate * at + phase), speed * math.sin(rate * at + phase)
        return Stream(c, s, -rate * s, rate * c)

    return Cause(water=water)


def after(
    first: list[SecondMeans | None], second: list[SecondMeans | None]
) -> list[SecondMeans | None]:
    """One voyage after another of the same boat, a minute later."""
    ends = [next(s.time for s in each if s is not None) for each in (first[::-1], second)]
    shift = ends[0] + 60.0 - ends[1]
    return [*first, *(s and replace(s, time=s.time + shift) for s in second)]


class Followed(NamedTuple):
    """A voyage's numbers: seconds (T,), shares, std (T, n), valid (T, n), events (time, name)."""

    names: list[str]
    times: Floats
    shares: Floats
    std: Floats
    valid: Floats
    events: list[tuple[float, str]]


def followed(vessel: Vessel, seconds: list[SecondMeans | None]) -> Followed:
    """The numbers of a vessel over the seconds of a voyage."""
    follower = NumberFollower.of(Model.of(vessel))
    now, rows, events = follower.start(), [], []
    names = [number.name for number in follower.numbers]
    known = [second for second in seconds if second is not None]
    for second in known:
        before, now = now, follower.observe(now, second)
        at = second.time - known[0].time
        events += [(at, names[i]) for i in np.flatnonzero(now.left & ~before.left)]
        rows.append((at, now.shares, now.std, now.valid))
    times, shares, std, valid = (np.array(column) for column in zip(*rows, strict=True))
    return Followed(names, times, shares, std, valid, events)


def line(case: Case, truth: dict[str, float], found: Followed) -> str:
    """One row of the table."""
    true = np.array([truth.get(name, 1.0) - 1.0 for name in found.names])
    off = found.shares - np.where((found.times >= case.begins)[:, None], true, 0.0)
    learnt = SECONDS + 120.0 if case.kind == "hour" else SETTLED_S
    late = found.times >= (case.begins + SOON_S if truth else learnt)
    held = (np.abs(off) <= 1.96 * found.std)[late]
    row = f"{case.kind:9}{case.boat:10}{case.pilot:11}"
    if truth:
        k = int(np.flatnonzero(true)[0])
        near = np.abs(off[:, k]) <= NEAR
        far = np.flatnonzero(~near & (found.times >= case.begins))
        at = found.times[min(far[-1] + 1, len(near) - 1)] - case.begins if len(far) else 0.0
        after = found.times >= case.begins + SOON_S
        row += f"{true[k]:+6.2f}{at:6.0f}{np.abs(off[after, k]).max():7.3f}"
        told = next((t - case.begins for t, name in found.events if name == found.names[k]), None)
        row += f"{'-' if told is None else f'{told:.0f}':>6}"
        others = [name for _, name in found.events if name != found.names[k]]
    else:
        row += f"{'':25}"
        others = [name for _, name in found.events]
    worst = np.abs(off[late]).max()
    drift = np.abs(found.shares[late] - found.shares[late][0]).max()
    return f"{row}{worst:8.3f}{drift:7.3f}{held.mean():7.2f}  {', '.join(others)}"


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("which", choices=tuple(SETS))
    parser.add_argument("--cache", type=Path, default=None)
    parser.add_argument("--sail", action="store_true", help="fill the cache and end")
    parser.add_argument("--only", action="store_true", help="what the cache has")
    given = parser.parse_args()
    print("kind     boat      pilot       true  near  worst  told  others  drift  holds  false")
    made = list(cases(given.which))
    for case, truth in made:
        span = HOUR if case.kind == "hour" else SECONDS
        if given.only and not (given.cache / f"{case.kind}-{case.seed}-{span:.0f}.pickle").exists():
            continue
        vessel, seconds = remembered(case, span, given.cache)
        if case.kind == "hour" and not given.sail:  # the boat's numbers were learnt before it
            calm = next(c for c, _ in made if c.kind == "nothing" and c.boat == case.boat)
            seconds = after(remembered(calm, SECONDS, given.cache)[1], seconds)
        if given.sail:
            print(case.kind, case.boat, case.pilot, flush=True)
            continue
        print(line(case, truth, followed(vessel, seconds)), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
