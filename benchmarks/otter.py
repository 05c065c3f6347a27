"""A hull of another author: Fossen's Otter in six degrees of freedom, as a model that sails.

    python -m benchmarks.otter --source PATH [--payload KG] [--only CASE] [--together] [--out DIR]

PATH is the folder `src` of the repository PythonVehicleSimulator, which is on no package index
(class `otter`; T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed.
2021). Its equations move the boat; this file only drives it, hides something and writes what an
autopilot would have said. The law differs from that of `sim`: centre of gravity ahead of the
origin, payload, heave, roll and pitch, cross-flow drag of strips, shafts that lag by 0.1 s, and
a hull that does not hold its course. A payload, 25 kg as published, also pushes: its weight along
the trimmed hull, some 7 N ahead at any time, is held by nothing there. `--payload 0` leaves it
ashore. What the owner does is in `benchmarks.owner`. `--together`: what is hidden in a boat is
hidden on four voyages under other currents and winds; three are diagnosed at once, the fourth is
kept back.
"""

import argparse
import inspect
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden.boats import Boat, Hull
from benchmarks.hidden.link import recorded
from benchmarks.hidden.missions import PILOTS
from benchmarks.hidden.nature import Cause, Nature
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.pilots import REST, TICK, pulses_of
from benchmarks.hidden.sail import PRELUDE, Truth, ticks_of
from benchmarks.hidden.scene import Report
from benchmarks.hidden.sensors import GRAVITY, Sensors, estimate_error
from benchmarks.hidden.talk import RAISED, conversation
from benchmarks.hidden.telemetry import Clock
from benchmarks.owner import first_voyage, tell_each, tell_together
from sim.state import Floats

SECONDS = 600.0  # armed
AHEAD, ASTERN = 12.2 * GRAVITY, 6.8 * GRAVITY  # N a motor, at a standstill
BEAM_BETWEEN = 0.395  # m from the centre line to a motor
SUBSTEPS = 2  # Euler's, in a tick
PAYLOAD = "self.mp = 25.0"  # as the source says it

Otter = Any
Wrench6 = Callable[["Otter", float, Floats, Floats], Floats]  # otter, time, eta, nu -> (6,) N, N m


def calm(otter: Otter, t: float, eta: Floats, nu: Floats) -> Floats:
    """Nothing pushes."""
    return np.zeros(6)


@dataclass(frozen=True)
class Trouble:
    """What is hidden on a voyage; as left out, nothing."""

    says: str  # what is hidden, in words
    pilot: str = "excitation"
    current: tuple[float, float] = (0.0, 0.0)  # speed [m/s], towards [degrees]
    turns: tuple[float, float, float] | None = None  # time [s] from which on it is another: these
    payload: float = 0.0  # kg more
    changed: Callable[[Otter], None] = lambda otter: None  # its numbers
    command: Callable[[Floats, float, Floats], Floats] = lambda c, t, nu: c  # (2,), as it is taken
    push: Wrench6 = calm
    cause: Cause = field(default_factory=Cause)  # of sensors


def wind(speed: float, towards: float) -> Wrench6:
    """Wind by its pressure on the areas above water: Isherwood-like sines, moment by the side."""

    def push(otter: Otter, t: float, eta: Floats, nu: Floats) -> Floats:
        a = math.radians(towards) - eta[5]
        u, v = speed * math.cos(a) - nu[0], speed * math.sin(a) - nu[1]
        q = 0.5 * 1.225 * math.hypot(u, v)
        Y = q * v * 0.9 * 0.7
        return np.array([q * u * 0.6 * 0.4, Y, 0.0, 0.0, 0.0, 0.1 * otter.L * Y])

    return push


def towed(otter: Otter, t: float, eta: Floats, nu: Floats) -> Floats:
    """A drogue in the water, on a line from the middle of the stern."""
    off = otter.beta_c - eta[5]
    u = nu[0] - otter.V_c * math.cos(off)
    v = nu[1] - otter.V_c * math.sin(off) - 1.0 * nu[5]
    X, Y = -9.0 * math.hypot(u, v) * np.array([u, v])
    return np.array([X, Y, 0.0, 0.0, 0.0, -1.0 * Y])


def hump(otter: Otter, t: float, eta: Floats, nu: Floats) -> Floats:
    """A stranger: a hump in the resistance about 1.2 m/s."""
    X = -35.0 * math.exp(-(((abs(nu[0]) - 1.2) / 0.3) ** 2)) * math.tanh(5.0 * nu[0])
    return np.array([X, 0.0, 0.0, 0.0, 0.0, 0.0])


def both(factor: float) -> Callable[[Otter], None]:
    """Both propellers pull by a factor."""

    def change(otter: Otter) -> None:
        otter.k_pos *= factor
        otter.k_neg *= factor

    return change


def drag(factor: float) -> Callable[[Otter], None]:
    """The resistance ahead by a factor."""

    def change(otter: Otter) -> None:
        otter.D[0, 0] *= factor

    return change


def lag(seconds: float) -> Callable[[Otter], None]:
    """The shafts' time constant."""

    def change(otter: Otter) -> None:
        otter.T_n = seconds

    return change


def astern(otter: Otter) -> None:
    """The propellers pull half as much astern."""
    otter.k_neg *= 0.5


def port(share: float, since: float = 0.0) -> Callable[[Floats, float, Floats], Floats]:
    """The motor to port gives a share of its thrust, from a time [s] on."""
    return lambda c, t, nu: c * np.array([math.sqrt(share) if t >= since else 1.0, 1.0])


def dead_band(c: Floats, t: float, nu: Floats) -> Floats:
    """Nothing turns below a command of 0.2."""
    return np.where(np.abs(c) < 0.2, 0.0, np.sign(c) * (np.abs(c) - 0.2) / 0.8)


def ventilated(c: Floats, t: float, nu: Floats) -> Floats:
    """A stranger: half of the thrust is lost above 1.1 m/s."""
    return c * math.sqrt(1.0 - 0.25 * (1.0 + math.tanh((nu[0] - 1.1) / 0.1)))


def slipping(c: Floats, t: float, nu: Floats) -> Floats:
    """A stranger: thrust is lost in a turn."""
    return c * math.sqrt(1.0 / (1.0 + (nu[5] / 0.35) ** 2))


def says(**changed: Callable[[Any], Any]) -> Cause:
    """Sensors that report something else."""
    return Cause(report=lambda r: r._replace(**{k: f(getattr(r, k)) for k, f in changed.items()}))


TROUBLES: dict[str, Trouble] = {
    "none": Trouble("nothing"),
    "none_survey": Trouble("nothing, on a survey", "survey"),
    "none_wander": Trouble("nothing, from point to point", "wander"),
    "current": Trouble("a current of 0.25 m/s towards 200°", current=(0.25, 200.0)),
    "current_survey": Trouble(
        "a current of 0.3 m/s towards 70°, on a survey", "survey", current=(0.3, 70.0)
    ),
    "wind": Trouble("a wind of 9 m/s towards 120°", push=wind(9.0, 120.0)),
    "wind_wander": Trouble(
        "a wind of 8 m/s towards 300°, from point to point", "wander", push=wind(8.0, 300.0)
    ),
    "port": Trouble("80 % of the thrust to port", command=port(0.8)),
    "port_survey": Trouble("75 % of the thrust to port, on a survey", "survey", command=port(0.75)),
    "fault": Trouble("half of the thrust to port from 300 s on", command=port(0.5, 300.0)),
    "dead_band": Trouble("a dead-band of 20 %", command=dead_band),
    "lag": Trouble("shafts that lag by 0.6 s", changed=lag(0.6)),
    "astern": Trouble("half of the thrust astern", "drills", changed=astern),
    "propellers": Trouble("0.7 of the thrust", changed=both(0.7)),
    "drag": Trouble("1.6 times the linear resistance", changed=drag(1.6)),
    "payload": Trouble("20 kg more on board, on a survey", "survey", payload=20.0),
    "towed": Trouble("a drogue in tow, from point to point", "wander", push=towed),
    "compass": Trouble(
        "a compass 7° off, on a survey", "survey", cause=says(yaw=lambda a: a + math.radians(7.0))
    ),
    "iron": Trouble(
        "iron beside the compass, 8°", cause=says(yaw=lambda a: a + 0.14 * np.sin(a - 0.6))
    ),
    "late": Trouble("velocities 0.4 s late", cause=Cause(latency=0.4)),
    "current_port": Trouble(
        "a current of 0.2 m/s and 80 % to port", current=(0.2, 310.0), command=port(0.8)
    ),
    "wind_dead_band": Trouble(
        "a wind of 8 m/s and a dead-band", "drills", push=wind(8.0, 20.0), command=dead_band
    ),
    "hump": Trouble("a hump in the resistance (a stranger)", push=hump),
    "ventilated": Trouble("thrust lost at speed (a stranger)", command=ventilated),
    "slipping": Trouble("thrust lost in turns (a stranger)", "wander", command=slipping),
}


# pilot, current (speed [m/s], towards [degrees]) and wind of voyages that are diagnosed together,
# and of the one that is kept back
VOYAGES: Sequence[tuple[str, tuple[float, float], Wrench6]] = (
    ("excitation", (0.2, 40.0), calm),
    ("survey", (0.0, 0.0), wind(6.0, 250.0)),
    ("wander", (0.3, 300.0), calm),
    ("excitation", (0.0, 0.0), calm),
)
TOGETHER = ("none", "port", "dead_band", "payload", "towed", "slipping")  # without weather


def on_voyage(trouble: Trouble, voyage: int) -> Trouble:
    """The same in a boat on another voyage."""
    pilot, current, air = VOYAGES[voyage]

    def push(otter: Otter, t: float, eta: Floats, nu: Floats) -> Floats:
        return trouble.push(otter, t, eta, nu) + air(otter, t, eta, nu)

    return replace(trouble, pilot=pilot, current=current, push=push)


def boat(payload: float) -> Boat:
    """What its owner knows: size, mass, motors; the nine numbers as `shadow init` guesses them."""
    mass, length, pull = 55.0 + payload, 2.0, 2.0 * AHEAD
    hull = Hull(
        length, 1.08, mass, 0.4, 0.7, 1.1 * mass, 1.6 * mass, 0.13 * mass * length**2,
        *(k * pull for k in (-0.25, -0.125, -0.75, -1.25, -0.11, -0.11)),
    )  # fmt: skip
    motors = (
        Motor("port", 1, -0.9, -BEAM_BETWEEN, -ASTERN, AHEAD),
        Motor("starboard", 3, -0.9, BEAM_BETWEEN, -ASTERN, AHEAD),
    )
    return Boat(name="Otter", source="Fossen 2021", hull=hull, motors=motors, curve=2)


def otter_of(trouble: Trouble, payload: float) -> Otter:
    """Fossen's boat with what is hidden in its numbers, and a payload [kg]."""
    from python_vehicle_simulator.vehicles import otter as theirs  # not part of this project

    text = inspect.getsource(theirs)
    if PAYLOAD not in text:
        raise SystemExit("this version of the simulator says its payload in other words")
    names = dict(vars(sys.modules[theirs.__module__]))
    exec(
        text.replace(PAYLOAD, f"self.mp = {payload + trouble.payload!r}"), names
    )  # it has no argument
    speed, towards = trouble.current
    otter = names["otter"](V_current=speed, beta_current=towards)
    trouble.changed(otter)
    return otter


def write(path: Path, trouble: Trouble, seed: int, payload: float = 25.0) -> None:
    """Sail once and record as a .tlog."""
    from python_vehicle_simulator.lib.gnc import Rzyx, attitudeEuler

    otter, known = otter_of(trouble, payload), boat(payload)
    dice = [np.random.default_rng([seed, i]) for i in range(4)]
    n = ticks_of(SECONDS)
    time_s = TICK * np.arange(n, dtype=np.float64) - PRELUDE
    armed = (time_s >= 0.0) & (time_s < SECONDS)
    noise = estimate_error(n, dice[0])
    nature = Nature(known, [trouble.cause])
    pilot = PILOTS[trouble.pilot](known, dice[2])
    eta, nu, shafts = np.zeros(6), np.zeros(6), np.zeros(2)
    eta[5] = dice[1].uniform(-math.pi, math.pi)
    motion, pulses = np.empty((n, 6)), np.empty((n, 2), dtype=np.int64)
    for k in range(n):
        over_ground = Rzyx(eta[3], eta[4], eta[5]) @ nu[:3]
        motion[k] = [eta[0], eta[1], eta[5], over_ground[0], over_ground[1], nu[5]]
        stick = REST
        if armed[k]:
            seen = Report(*(
                float(x) + float(e[k])
                for x, e in zip(nature.reported(Report(*motion[k])), noise, strict=True)
            ))  # fmt: skip
            stick = pilot.send(seen) if armed[k - 1] else next(pilot)
        pulses[k] = pulses_of(known, stick)
        asked = np.array([m.command(int(p)) for m, p in zip(known.motors, pulses[k], strict=True)])
        taken = trouble.command(asked, float(time_s[k]), nu)
        turns = np.where(taken > 0.0, taken * otter.n_max, -taken * otter.n_min)
        if trouble.turns and time_s[k] >= trouble.turns[0]:
            otter.V_c, otter.beta_c = trouble.turns[1], math.radians(trouble.turns[2])
        for _ in range(SUBSTEPS):
            step = TICK / SUBSTEPS
            outside = otter.Minv @ trouble.push(otter, float(time_s[k]), eta, nu)
            nu, shafts = otter.dynamics(eta, nu, shafts, turns, step)
            nu = nu + step * outside
            eta = attitudeEuler(eta, nu, step)
    still = np.column_stack((np.full(n, 12.6), np.zeros(n)))
    truth = Truth(time_s, motion, pulses, still[:, 0], still[:, 1], armed)
    clock = Clock(boot=100.0, unix=1.76e9 + 86_400.0 * (seed % 300))
    sensors = Sensors(nature, truth, noise, dice[3])
    path.write_bytes(recorded(conversation(known, sensors, truth, RAISED, clock), clock, dice[3]))


def use_source(parser: argparse.ArgumentParser, source: Path) -> None:
    """Let the simulator be imported from its folder `src`; an error of the command if it is not."""
    if not (source / "python_vehicle_simulator" / "vehicles" / "otter.py").exists():
        parser.error(f"there is no python_vehicle_simulator in {source}")
    sys.path.insert(0, str(source))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.otter", description=__doc__)
    parser.add_argument("--source", type=Path, required=True, help="src of PythonVehicleSimulator")
    parser.add_argument("--payload", type=float, default=25.0, help="on board as known [kg]")
    parser.add_argument("--only", action="append", choices=TROUBLES, help="these troubles alone")
    parser.add_argument("--out", type=Path, default=Path("out/otter"))
    parser.add_argument("--together", action="store_true", help="three voyages at once, a fourth")
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args(arguments)
    use_source(parser, a.source)

    def sail(name: str, log: Path) -> str:
        seed = 2000 + 100 * a.seed + list(TROUBLES).index(name)
        write(log, TROUBLES[name], seed, a.payload)
        return TROUBLES[name].says

    better = first_voyage(
        a.out,
        boat(a.payload),
        lambda log: write(log, TROUBLES["none"], 1000 + a.seed, a.payload),
    )

    def sail_all(name: str, out: Path) -> list[Path]:
        logs = [out / f"{name}_{i}.tlog" for i in range(len(VOYAGES))]
        for i, log in enumerate(logs):
            seed = 7000 + 100 * a.seed + 10 * list(TROUBLES).index(name) + i
            write(log, on_voyage(TROUBLES[name], i), seed, a.payload)
        return logs

    if a.together:
        tell_together(a.only or TOGETHER, a.out, better, sail_all)
    else:
        tell_each(a.only or TROUBLES, a.out, better, sail)
    return 0


if __name__ == "__main__":
    sys.exit(main())
