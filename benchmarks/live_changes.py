"""Does a live gateway name a cause that follows another one, or comes to it?

    python -m benchmarks.live_changes [SERIES] [--cache DIR]      # another series: other dice

Voyages of the blind test's generator (`benchmarks.hidden`: physics that shares no code with `sim`),
eight minutes each, with two causes: one from 80 s to 240 or to 400 s, another from 240 to 400 s.
Of current, wind, a thruster that keeps a part of its thrust, and surge drag each comes before and
after each, and each beside each. Printed: per voyage all that was told; how many second causes were
named as the one that came last, how soon, and how many names were false when they were told (none
of those that are offered holds then, or what is told beside them does not).

How blind: numbers were chosen with a look at series 1 and 2.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.hidden.boats import FLEET, Hull
from benchmarks.hidden.causes import Hidden, causes_of
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.scene import Push, Scene, Stream
from benchmarks.live_diagnosis import Case, _thrown
from benchmarks.live_naming import NONE_CLEAR, PAIRS, SOON_S, name_of, news, remembered
from sim.monitoring import SecondMeans
from sim.monitoring.alarm import ModelEvent
from sim.vessel import Vessel

SECONDS, FIRST, SECOND, END = 480.0, 80.0, 240.0, 400.0
LATE_S = 6.0  # after its end a cause may still be told: an explanation must have lasted so long
KINDS = ("current", "wind", "thrust", "drag")
NOTHING_PUSHES = Push(0.0, 0.0, 0.0)


class Voyage(NamedTuple):
    """A case, and its causes with the time in which they act [s]."""

    case: Case
    spans: tuple[tuple[str, float, float], tuple[str, float, float]]

    def acting(self, time: float) -> set[str]:
        """Which act then, or did until a moment ago."""
        return {kind for kind, begin, end in self.spans if begin <= time < end + LATE_S}


def voyages(series: int) -> Iterator[Voyage]:
    """Each pair of causes, one after the other and one beside the other."""
    pairs = [(a, b, lasts) for lasts in (False, True) for a, b in permutations(KINDS, 2)]
    for k, (first, second, lasts) in enumerate(pairs):
        boat, pilot = PAIRS[k % len(PAIRS)]
        dice = np.random.default_rng([31, series, k])
        spans = ((first, FIRST, END if lasts else SECOND), (second, SECOND, END))
        causes = tuple(_cause(kind, begin, end, boat, dice) for kind, begin, end in spans)
        name = f"{first}-{'and' if lasts else 'then'}-{second}"
        yield Voyage(Case(name, boat, pilot, 100_000 + 100 * series + k, causes), spans)


def _cause(kind: str, begin: float, end: float, boat: str, dice: np.random.Generator) -> Cause:
    """One of the kinds, that acts from then to then."""

    def share(time: float) -> float:
        return min(max((time - begin) / 5.0, 0.0), 1.0) * (1.0 if time < end else 0.0)

    if kind == "current":
        return _current(_thrown(dice, 0.25, 0.5), begin, end)
    if kind == "wind":
        air = _thrown(dice, 7.0, 12.0)
        blown = {"speed": math.hypot(*air), "direction": math.atan2(-air[1], -air[0])}
        return _blown(causes_of([Hidden("steady_wind", blown)])[0], share)
    if kind == "drag":
        return _fouled(float(dice.uniform(1.6, 2.2)), share)
    motors = FLEET[boat].motors
    bad, kept = motors[int(dice.integers(len(motors)))], float(dice.uniform(0.3, 0.6))
    return Cause(
        thrust=lambda force, motor, scene: (
            force * (1.0 - (1.0 - kept) * share(scene.time)) if motor.name == bad.name else force
        )
    )


def _current(flow: tuple[float, float], begin: float, end: float) -> Cause:
    """Water that begins to move within ten seconds, and stops within ten."""

    def water(at: float, north: float, east: float) -> Stream:
        share = min(max((at - begin) / 10.0, 0.0), max((end + 10.0 - at) / 10.0, 0.0), 1.0)
        rate = 0.1 if begin < at < begin + 10.0 else -0.1 if end < at < end + 10.0 else 0.0
        return Stream(share * flow[0], share * flow[1], rate * flow[0], rate * flow[1])

    return Cause(water=water)


def _blown(wind: Cause, share: Callable[[float], float]) -> Cause:
    """A wind for a while."""
    law = wind.push
    assert law is not None

    def push(scene: Scene, thrusts: object) -> Push:
        part = share(scene.time)
        return Push(*(part * x for x in law(scene, []))) if part else NOTHING_PUSHES

    return Cause(push=push)


def _fouled(factor: float, share: Callable[[float], float]) -> Cause:
    """Surge drag times that, for a while."""

    def grown(h: Hull, time: float) -> Hull:
        more = 1.0 + (factor - 1.0) * share(time)
        return h._replace(X_u=h.X_u * more, X_uu=h.X_uu * more)

    return Cause(hull=grown)


class Told(NamedTuple):
    """One thing told: when [s], what is offered as the cause, and what holds beside it."""

    time: float
    names: tuple[str, ...]
    beside: tuple[str, ...]

    def is_false(self, acting: set[str]) -> bool:
        """Whether none of the names holds then, or one beside them does not."""
        return acting.isdisjoint(self.names) or not acting.issuperset(self.beside)

    @property
    def text(self) -> str:
        """In one word or some."""
        return " beside ".join([" or ".join(self.names), *self.beside])


def told(vessel: Vessel, seconds: list[SecondMeans | None]) -> tuple[list[Told], list[float]]:
    """Names, and when the model was called right again [s]."""
    names, right = list[Told](), list[float]()
    for time, alarm, event in news(vessel, seconds):
        if event is ModelEvent.RIGHT:
            right.append(time)
        elif (name := name_of(alarm)) and name != NONE_CLEAR:
            beside = tuple(one.cause.value for one in alarm.beside)
            names.append(Told(time, tuple(name.split(" or ")), beside))
    return names, right


def main() -> int:
    """Print the voyages and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("series", type=int, nargs="?", default=1)
    parser.add_argument("--cache", type=Path, default=None)
    given = parser.parse_args()
    counts = dict.fromkeys(("first", "second", "soon", "voyages", "told", "false", "right"), 0)
    for voyage in voyages(given.series):
        vessel, seconds = remembered(voyage.case, SECONDS, given.cache)
        names, right = told(vessel, seconds)
        (first, begin, _), (second, came, end) = voyage.spans
        alone = [one for one in names if len(one.names) == 1]
        named = [t.time - came for t in alone if came <= t.time < end and t.names == (second,)]
        counts["voyages"] += 1
        counts["first"] += any(begin <= t.time < came and t.names == (first,) for t in alone)
        counts["second"] += bool(named)
        counts["soon"] += bool(named) and named[0] <= SOON_S
        counts["told"] += len(names)
        counts["false"] += sum(one.is_false(voyage.acting(one.time)) for one in names)
        counts["right"] += sum(begin <= at < end for at in right)
        said = [
            (t.time, t.text + (" !" if t.is_false(voyage.acting(t.time)) else "")) for t in names
        ]
        said = sorted([*said, *((at, "right") for at in right)])
        line = ", ".join(f"{at:.0f} s {text}" for at, text in said)
        print(f"{voyage.case.kind:20}{voyage.case.boat:10}{voyage.case.pilot:11}{line}", flush=True)
    n = counts["voyages"]
    print(
        f"\nfirst named {counts['first']} of {n}; second named {counts['second']} of {n}, within "
        f"{SOON_S:.0f} s {counts['soon']}\nfalse when told: {counts['false']} of {counts['told']} "
        f"names; called right though something was wrong: {counts['right']}"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
