"""Does a live gateway notice a current or a wind, and keep quiet where the model is right?

    python -m benchmarks.live_diagnosis [SECONDS [SERIES]]     # another series: other dice

Voyages of the blind test's generator (`benchmarks.hidden`: physics that shares no code with `sim`)
go through the path of `shadow replay`. Printed: when the model was called wrong, when the cause was
told, how far speed and direction were off at the end, in metres per second and degrees and in the
stated standard deviations; false events on complete vessels; what it costs.
"""

import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.hidden.boats import FLEET, Boat
from benchmarks.hidden.causes import Hidden, causes_of
from benchmarks.hidden.link import recorded
from benchmarks.hidden.missions import PILOTS
from benchmarks.hidden.nature import Cause, Nature
from benchmarks.hidden.sail import sail, ticks_of
from benchmarks.hidden.scene import Stream
from benchmarks.hidden.sensors import Sensors, estimate_error
from benchmarks.hidden.talk import RAISED, conversation
from benchmarks.hidden.telemetry import Clock
from benchmarks.hidden.vessel_toml import vessel_toml
from gateway.ingest.open import open_log
from gateway.offline.replay import replay_input_of
from gateway.shadow.model_monitor import ModelMonitor
from gateway.shadow.path import ShadowPath, ShadowRows, follower_of
from gateway.shadow.topic_rows import EventRow
from gateway.vessel_file import load_vessel
from sim.following.follower import Reference
from sim.model import Model
from sim.monitoring import air_velocity, air_velocity_covariance

SECONDS = 300.0
PAIRS = (
    ("grebe", "survey"), ("teal", "survey"), ("wam-v", "excitation"), ("heron", "survey"),
    ("dory", "wander"), ("iacquabot", "circles"), ("grebe", "drills"), ("teal", "gentle"),
)  # fmt: skip
OTHERS = (  # what is neither current nor wind
    ("grebe", "survey", Hidden("cubic_drag", {"X_uuu": -8.0})),
    ("teal", "survey", Hidden("thruster_imbalance", {"port_gain": 0.8})),
    ("wam-v", "excitation", Hidden("heading_offset", {"angle": 0.15})),
    ("grebe", "excitation", Hidden("reverse_loss", {"factor": 0.5})),
    ("heron", "survey", Hidden("thruster_lag", {"tau": 0.5})),
)


class Case(NamedTuple):
    """One voyage; truth: of what, north and east of what moves [m/s]; set in at `begins` [s]."""

    kind: str
    boat: str
    pilot: str
    seed: int
    causes: tuple[Cause, ...] = ()
    truth: tuple[float, float] = (0.0, 0.0)
    begins: float = 0.0


def cases(seconds: float, series: int = 0) -> Iterator[Case]:
    """Complete vessels, currents, currents that set in midway, winds, and other causes."""
    for k, (boat, pilot) in enumerate(PAIRS):
        dice, k = np.random.default_rng([7 + series, k]), k + 1000 * series
        yield Case("complete", boat, pilot, 100 + k)
        flow = _thrown(dice, 0.2, 0.4)
        yield Case("current", boat, pilot, 200 + k, (_current(flow, 0.0),), flow)
        begins = 0.4 * seconds
        yield Case("sets in", boat, pilot, 300 + k, (_current(flow, begins),), flow, begins)
        air = _thrown(dice, 8.0, 12.0)
        blown = {"speed": math.hypot(*air), "direction": math.atan2(-air[1], -air[0])}
        causes = tuple(causes_of([Hidden("steady_wind", blown)]))
        yield Case("wind", boat, pilot, 400 + k, causes, air)
    for k, (boat, pilot, hidden) in enumerate(OTHERS, 1000 * series):
        yield Case("other", boat, pilot, 500 + k, tuple(causes_of([hidden])))


def _thrown(dice: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    speed, towards = dice.uniform(low, high), dice.uniform(-math.pi, math.pi)
    return float(speed * math.cos(towards)), float(speed * math.sin(towards))


def _current(flow: tuple[float, float], begins: float) -> Cause:
    """Water that begins to move within ten seconds."""

    def water(at: float, north: float, east: float) -> Stream:
        share = min(max((at - begins) / 10.0, 0.0), 1.0) if begins else 1.0
        rate = 0.1 if 0.0 < share < 1.0 else 0.0
        return Stream(share * flow[0], share * flow[1], rate * flow[0], rate * flow[1])

    return Cause(water=water)


class Heard(NamedTuple):
    """What the lookout said of a voyage, and its last state; cost of one second [ms]."""

    events: list[EventRow]
    start_ns: int
    lookout: ModelMonitor
    cost_ms: float


def heard(case: Case, folder: Path, seconds: float) -> Heard:
    """Sail, record, and run it through the path of a replay."""
    log, toml = folder / "voyage.tlog", folder / "vessel.toml"
    boat = FLEET[case.boat]
    _sail(log, boat, case, seconds)
    toml.write_text(vessel_toml(boat), encoding="utf-8")
    given = replay_input_of(open_log(log))
    model, following = Model.of(load_vessel(toml)), given.settings.following
    path = ShadowPath(
        model, Reference(model, following.reference), follower_of(model, following.follower),
        given.settings.filter, following.rate_hz,
    )  # fmt: skip
    _, out, _ = path.advance(path.start(), given.feed)
    return _watched(ModelMonitor.of(model), out)


def _watched(lookout: ModelMonitor, out: ShadowRows) -> Heard:
    began = time.process_time()
    lookout, _, events = lookout.observe(out)
    cost = (time.process_time() - began) / max(lookout.alarm.estimate.count, 1) * 1e3
    return Heard(events, int(out.vehicle_time_ns[0]), lookout, cost)


def _sail(path: Path, boat: Boat, case: Case, seconds: float) -> None:
    """As `benchmarks.hidden.voyage` does, with causes that it has no name for."""
    dice = [np.random.default_rng([case.seed, i]) for i in range(5)]
    nature = Nature(boat, case.causes)
    noise = estimate_error(ticks_of(seconds), dice[0])
    start = [*dice[1].uniform(-5.0, 5.0, 2).tolist(), float(dice[1].uniform(-math.pi, math.pi))]
    truth = sail(nature, PILOTS[case.pilot](boat, dice[2]), noise, start, seconds)
    clock = Clock(boot=float(dice[1].uniform(60.0, 600.0)), unix=1.75e9)
    sensors = Sensors(nature, truth, noise, dice[3])
    said = conversation(boat, sensors, truth, RAISED, clock)
    path.write_bytes(recorded(said, clock, dice[4]))


def line(case: Case, found: Heard) -> str:
    """One row of the table."""
    wrong = _first(found, lambda h: h.kind == "model_wrong")
    wanted = {"current": "of current towards", "sets in": "of current towards", "wind": "of wind"}
    words = wanted.get(case.kind)
    told = _first(found, lambda h: words is not None and f"looks like {words}" in _bare(h.text))
    outlook = found.lookout.alarm.estimate
    row = f"{case.kind:9}{case.boat:10}{case.pilot:11}{_s(wrong, case)}{_s(told, case)}"
    if words is None:
        row += f"{'':22}"
    else:
        belief = outlook.air if case.kind == "wind" else outlook.water
        got = air_velocity(belief.disturbance) if case.kind == "wind" else belief.disturbance
        spread = air_velocity_covariance(belief.disturbance, belief.stated_covariance)
        row += _off(
            got,
            spread if case.kind == "wind" else belief.stated_covariance,
            np.array(case.truth),
        )
    return f"{row}  {found.lookout.alarm.cause.value:16}{len(found.events):3}{found.cost_ms:6.2f}"


def _bare(says: str) -> str:
    """The sentence without its numbers of speed."""
    head, _, tail = says.partition("looks like ")
    return f"{head}looks like {' '.join(tail.split()[2:])}"


def _first(found: Heard, is_it: Callable[[EventRow], bool]) -> float | None:
    times = [h.vehicle_time_ns for h in found.events if is_it(h)]
    return (times[0] - found.start_ns) * 1e-9 if times else None


def _s(at: float | None, case: Case) -> str:
    return f"{'-':>7}" if at is None else f"{at - case.begins:7.0f}"


def _off(got: np.ndarray, spread: np.ndarray, truth: np.ndarray) -> str:
    """Error of the size, of the direction [°], and of both in standard deviations."""
    size, angle = np.hypot(*got) - np.hypot(*truth), np.arctan2(got[1], got[0])
    turn = math.degrees(math.remainder(angle - np.arctan2(truth[1], truth[0]), 2.0 * math.pi))
    sigmas = math.sqrt((got - truth) @ np.linalg.solve(spread, got - truth))
    return f"{np.hypot(*truth):6.2f}{size:+6.2f}{turn:+6.0f}{sigmas:4.1f}"


def main() -> int:
    """Print the table."""
    given = [float(text) for text in sys.argv[1:]]
    seconds, series = (*given, *(SECONDS, 0.0)[len(given) :])
    print(
        "kind     boat      pilot       wrong   told  true  size   deg   σ  explains    events  ms"
    )
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(seconds, int(series)):
            print(line(case, heard(case, Path(folder), seconds)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
