"""A voyage as a boat's owner gets it: commands in, telemetry out, a log, a trial.

    commands → nature → sensors → MAVLink → .tlog → decoding → smoother → Trial

Nature, sensors and telemetry are those of benchmarks.hidden, which share no code with `sim`; from
the .tlog on everything is the gateway's.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.link import recorded
from benchmarks.hidden.nature import Nature
from benchmarks.hidden.pilots import TICK, Pilot, Stick
from benchmarks.hidden.sail import PRELUDE, Truth, sail, ticks_of
from benchmarks.hidden.scene import Report
from benchmarks.hidden.sensors import Sensors, estimate_error
from benchmarks.hidden.talk import RAISED, conversation
from benchmarks.hidden.telemetry import Clock
from benchmarks.paper.instruments import Instruments
from gateway.ingest.log import choose_boat
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.offline.trials import TrialOptions, load_trials
from sim.state import Floats
from sim.trial import Trial

CLOCK = Clock(boot=100.0, unix=1.76e9)
FIRST = 0.25  # s after the log begins, the first stream does


def played(boat: Boat, commands: Floats) -> Pilot:
    """Commands (K, 2) of port and starboard, tick by tick, as sticks that give just these."""
    rows: Iterator[tuple[float, float]] = ((p, s) for p, s in commands.tolist())
    for port, starboard in rows:
        yield Stick(0.5 * (port + starboard), 0.5 * (port - starboard) / boat.helm)


def sailed(boat: Boat, commands: Floats) -> Truth:
    """What really happens under commands (K, 2): from rest, at the origin, heading north."""
    seconds = len(commands) * TICK
    still = Report(*(np.zeros(ticks_of(seconds)) for _ in Report._fields))
    return sail(Nature(boat), played(boat, commands), still, [0.0, 0.0, 0.0], seconds)


def logged(path: Path, boat: Boat, truth: Truth, instruments: Instruments, seed: int) -> Path:
    """The voyage as a .tlog, seen through those instruments."""
    dice = [np.random.default_rng([seed, i]) for i in range(3)]
    noise = estimate_error(len(truth.time), dice[0], instruments.errors)
    sensors = Sensors(Nature(boat), truth, noise, dice[1], instruments.errors)
    path.write_bytes(recorded(conversation(boat, sensors, truth, RAISED, CLOCK), CLOCK, dice[2]))
    return path


def trial_of(path: Path, instruments: Instruments) -> Trial:
    """The log through decoding and smoother."""
    (trial,) = load_trials(path, options=TrialOptions(settings=instruments.offline))
    return trial


def clock_offset_s(log: Path) -> float:
    """Vehicle time of the gateway less the generator's time since arming, of one log [s].

    The gateway tells the boat's time by the receiver's clock; the generator knows when the first
    ATTITUDE was sent.
    """
    opened = open_log(log)
    heard = choose(opened.decode(choose_boat(opened, None)).samples)["yaw"].samples
    return float(heard.vehicle_time_ns.min()) * 1e-9 - (FIRST - PRELUDE)


def motion_of(truth: Truth) -> Floats:
    """True (eta, nu) (K, 6) at the ticks."""
    m = truth.motion
    c, s = np.cos(m[:, 2]), np.sin(m[:, 2])
    u, v = c * m[:, 3] + s * m[:, 4], c * m[:, 4] - s * m[:, 3]
    return np.column_stack([m[:, :3], u, v, m[:, 5]])


def true_at(truth: Truth, times: Floats) -> Floats:
    """True (eta, nu) (T, 6) at times [s after arming]."""
    return np.column_stack([np.interp(times, truth.time, c) for c in motion_of(truth).T])
