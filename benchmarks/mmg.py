"""A hull of another author: the tanker KVLCC2 by the MMG standard method, as a model that sails.

    pip install shipmmg
    python -m benchmarks.mmg [--length 3] [--only CASE] [--out FOLDER]

The package shipmmg (published coefficients of Yasukawa and Yoshimura, J. Mar. Sci. Technol. 20
(2015), Tables 3 and 4) sails; this file only scales the ship, moves helm and propeller, hides
something and writes what an autopilot would have said. The hull's law is another one than that of
`sim`: drift and turning mix up to the third power, the propeller loses thrust with advance, the
rudder stands in a wake that drift turns, and more on one side than on the other. As its owner
would, this program guesses a vessel from the size, fits it to one voyage, lets `diagnose` say what
is missing and takes the better vessel. What is hidden after that is looked for with that vessel.
"""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter

from benchmarks.hidden.boats import Boat, Hull
from benchmarks.hidden.link import recorded
from benchmarks.hidden.nature import Cause, Nature
from benchmarks.hidden.outputs import Motor, Rudder
from benchmarks.hidden.pilots import TICK
from benchmarks.hidden.sail import EPILOGUE, PRELUDE, Truth, ticks_of
from benchmarks.hidden.sensors import GRAVITY, Sensors, estimate_error
from benchmarks.hidden.talk import RAISED, conversation
from benchmarks.hidden.telemetry import Clock
from benchmarks.owner import first_voyage, tell_each
from sim.state import Floats

SECONDS = 600.0  # armed
MOST = math.radians(35.0)  # rudder
BEND = 0.21  # rad
TOP_FROUDE = 0.20  # the propeller is driven this fast at most; the ship's own speed is at 0.142
RHO = 1000.0


@dataclass(frozen=True)
class Trouble:
    """What is hidden on a voyage; as left out, nothing."""

    says: str  # what is hidden, in words
    current: tuple[float, float] = (0.0, 0.0)  # north, east [m/s]
    drag: float = 1.0  # of the ship's resistance ahead
    propeller: float = 1.0  # of its thrust
    mass: float = 1.0  # of mass and inertia
    helm: Callable[[Floats], Floats] = lambda angle: angle  # as sent -> as it stands
    cause: Cause = field(default_factory=Cause)  # of delays and sensors


TROUBLES: dict[str, Trouble] = {
    "none": Trouble("nothing"),
    "none_too": Trouble("nothing, on another voyage"),
    "current": Trouble("a current of 0.15 m/s", current=(0.12, -0.09)),
    "drag": Trouble("1.6 times the resistance", drag=1.6),
    "propeller": Trouble("0.7 of the thrust", propeller=0.7),
    "payload": Trouble("1.3 times the mass", mass=1.3),
    "rudder_offset": Trouble("a rudder 4° off", helm=lambda angle: angle + math.radians(4.0)),
    "rudder_lag": Trouble("a rudder with a lag of 1.5 s", helm=lambda angle: lagged(angle, 1.5)),
    "compass": Trouble(
        "a compass 6° off",
        cause=Cause(report=lambda r: r._replace(yaw=r.yaw + math.radians(6.0))),
    ),
    "latency": Trouble("velocities 0.4 s late", cause=Cause(latency=0.4)),
    "linkage": Trouble(
        "a linkage that gives a third of the angle beyond 12° (a stranger)",
        helm=lambda angle: np.where(
            np.abs(angle) < BEND, angle, np.sign(angle) * (BEND + (np.abs(angle) - BEND) / 3.0)
        ),
    ),
    "sticking": Trouble(
        "a rudder that follows by steps of 12° (a stranger)",
        helm=lambda angle: sticking(angle, BEND),
    ),
}  # fmt: skip


def lagged(angle: Floats, seconds: float) -> Floats:
    """A first-order lag."""
    stay = math.exp(-TICK / seconds)
    return np.asarray(lfilter([1.0 - stay], [1.0, -stay], angle))


def sticking(angle: Floats, play: float) -> Floats:
    """Stands still until what is sent is `play` [rad] away."""
    stands, at = np.empty_like(angle), 0.0
    for k, sent in enumerate(angle):
        at = sent if abs(sent - at) > play else at
        stands[k] = at
    return lagged(stands, 0.5)


def ship(length: float) -> dict[str, float]:
    """KVLCC2 at a length between perpendiculars [m]; Yasukawa and Yoshimura, Tables 3 and 4."""
    scale = length / 320.0
    draught, breadth = 20.8 * scale, 58.0 * scale
    mass = RHO * 312_600.0 * scale**3
    own = {"L_pp": length, "B": breadth, "d": draught, "m": mass, "x_G": 11.2 * scale}
    added = 0.5 * RHO * length**2 * draught
    screw = {"D_p": 9.86 * scale, "A_R": 112.5 * scale**2, "η": 0.626}
    inertia = {
        "I_zG": mass * (0.25 * length) ** 2,
        "m_x": 0.022 * added,
        "m_y": 0.223 * added,
        "J_z": 0.011 * added * length**2,
    }
    rudder = {
        "f_α": 2.747, "ε": 1.09, "t_R": 0.387, "x_R": -0.5 * length, "a_H": 0.312,
        "x_H": -0.464 * length, "γ_R_minus": 0.395, "γ_R_plus": 0.640, "l_R": -0.710, "κ": 0.50,
    }  # fmt: skip
    propeller = {
        "t_P": 0.220, "w_P0": 0.35, "x_P": -0.48, "k_0": 0.2931, "k_1": -0.2753, "k_2": -0.1385,
    }  # fmt: skip
    hull = {
        "R_0_dash": 0.022, "X_vv_dash": -0.040, "X_vr_dash": 0.002, "X_rr_dash": 0.011,
        "X_vvvv_dash": 0.771, "Y_v_dash": -0.315, "Y_r_dash": 0.083, "Y_vvv_dash": -1.607,
        "Y_vvr_dash": 0.379, "Y_vrr_dash": -0.391, "Y_rrr_dash": 0.008, "N_v_dash": -0.137,
        "N_r_dash": -0.049, "N_vvv_dash": -0.030, "N_vvr_dash": -0.294, "N_vrr_dash": 0.055,
        "N_rrr_dash": -0.013,
    }  # fmt: skip
    return {**own, **screw, **inertia, **rudder, **propeller, **hull}


def turns_at(made_of: dict[str, float], speed: float) -> float:
    """Turns of the propeller [1/s] that hold a speed [m/s] straight ahead."""
    of = made_of
    needed = 0.5 * RHO * of["L_pp"] * of["d"] * speed**2 * of["R_0_dash"]

    def missing(n: float) -> float:
        J = (1.0 - of["w_P0"]) * speed / (n * of["D_p"])
        K_T = of["k_0"] + of["k_1"] * J + of["k_2"] * J**2
        return (1.0 - of["t_P"]) * RHO * K_T * n**2 * of["D_p"] ** 4 - needed

    return float(brentq(missing, 0.1, 1e3))


def top_speed(length: float) -> float:
    """At full throttle, ahead [m/s]."""
    return TOP_FROUDE * math.sqrt(GRAVITY * length)


def commands(seed: int, seconds: float, slowness: float) -> Floats:
    """Throttle and helm, shares of their most: (K, 2). Steps of many lengths, helm both ways.

    A step lasts 4 to 25 times `slowness` [s], in which the hull moves on by its own length.
    """
    dice = np.random.default_rng([seed, 0x33])
    n = ticks_of(seconds)
    sent = np.zeros((n, 2))
    for column, low, high in ((0, 0.25, 1.0), (1, -1.0, 1.0)):
        k = round(PRELUDE / TICK)
        while k < n:
            last = k + round(slowness * dice.uniform(4.0, 25.0) / TICK)
            straight = column == 1 and dice.random() < 0.25
            sent[k:last, column] = 0.0 if straight else dice.uniform(low, high)
            k = last
        # nobody's hand jumps, and splines would ring
        sent[:, column] = lagged(lagged(sent[:, column], 0.4), 0.4)
    sent[-round(EPILOGUE / TICK) :] *= np.linspace(1.0, 0.0, round(EPILOGUE / TICK))[:, None]
    return sent


def boat_of(length: float) -> Boat:
    """What its owner knows of it: size, outputs, the propeller's pull at a standstill."""
    of = ship(length)
    top = turns_at(of, top_speed(length))
    pull = (1.0 - of["t_P"]) * RHO * of["k_0"] * top**2 * of["D_p"] ** 4
    mass = of["m"]
    hull = Hull(  # the last nine as `shadow init` guesses them; what sails is not made of them
        length, of["B"], mass, 0.1, 0.3, 1.1 * mass, 1.6 * mass, 0.13 * mass * length**2,
        *(k * pull for k in (-0.25, -0.125, -0.75, -1.25, -0.11, -0.11)),
    )  # fmt: skip
    return Boat(
        name="KVLCC2", source="Yasukawa and Yoshimura 2015, by shipmmg", hull=hull, curve=2,
        motors=(Motor("screw", 3, of["x_R"], 0.0, -0.6 * pull, pull),),
        rudders=(Rudder("rudder", 1, of["x_R"], MOST, "screw", of["A_R"], 1.8),),
    )  # fmt: skip


def write(path: Path, length: float, trouble: Trouble, seed: int, seconds: float = SECONDS) -> None:
    """Sail once and record as a .tlog."""
    from shipmmg.mmg_3dof import simulate  # not part of this project

    boat, of = boat_of(length), ship(length)
    sent = commands(seed, seconds, length / top_speed(length))
    pulses = np.array(
        [[o.pulse(c) for o, c in zip(boat.outputs, row, strict=True)] for row in sent]
    )
    took = (pulses - 1500) / 400.0
    top = turns_at(of, top_speed(length))
    for name in ("k_0", "k_1", "k_2"):
        of[name] *= trouble.propeller
    of["R_0_dash"] *= trouble.drag
    of["m"] *= trouble.mass
    of["I_zG"] *= trouble.mass
    time_s = TICK * np.arange(len(sent), dtype=np.float64) - PRELUDE
    dice = [np.random.default_rng([seed, i]) for i in range(4)]
    # a propeller that stands still has no law in shipmmg: it idles
    turns = top * np.maximum(took[:, 0], 0.02)
    yaw = float(dice[1].uniform(-math.pi, math.pi))
    # a positive angle of MMG's rudder turns to starboard, as here
    sailed = simulate(
        **of, time_list=time_s, δ_list=trouble.helm(MOST * took[:, 1]), nps_list=turns, u0=0.01,
        ψ0=yaw, ρ=RHO, t_eval=time_s, max_step=0.1, rtol=1e-6,
    ).y  # fmt: skip
    u, v, r, north, east, yaw_s = sailed[:6]
    c, s = np.cos(yaw_s), np.sin(yaw_s)
    drift_north, drift_east = trouble.current
    motion = np.column_stack((
        north + drift_north * time_s, east + drift_east * time_s, yaw_s,
        c * u - s * v + drift_north, s * u + c * v + drift_east, r,
    ))  # fmt: skip
    armed = (time_s >= 0.0) & (time_s < seconds)
    still = np.column_stack((np.full(len(sent), 12.6), np.zeros(len(sent))))
    truth = Truth(time_s, motion, pulses, still[:, 0], still[:, 1], armed)
    clock = Clock(boot=100.0, unix=1.76e9 + 86_400.0 * (seed % 300))
    nature = Nature(boat, [trouble.cause])
    sensors = Sensors(nature, truth, estimate_error(len(sent), dice[0]), dice[2])
    path.write_bytes(recorded(conversation(boat, sensors, truth, RAISED, clock), clock, dice[3]))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mmg", description=__doc__)
    parser.add_argument("--length", type=float, default=3.0, help="between perpendiculars [m]")
    parser.add_argument("--only", action="append", choices=TROUBLES, help="these troubles alone")
    parser.add_argument("--out", type=Path, default=Path("out/mmg"))
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args(arguments)
    if find_spec("shipmmg") is None:
        parser.error("it needs another author's ship: pip install shipmmg")

    def sail(name: str, log: Path) -> str:
        seed = 2000 + 100 * a.seed + list(TROUBLES).index(name)
        write(log, a.length, TROUBLES[name], seed)
        return TROUBLES[name].says

    better = first_voyage(
        a.out, boat_of(a.length), lambda log: write(log, a.length, TROUBLES["none"], 1000 + a.seed)
    )
    tell_each(a.only or TROUBLES, a.out, better, sail)
    return 0


if __name__ == "__main__":
    sys.exit(main())
