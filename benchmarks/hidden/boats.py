"""The fleet: invented and published boats, and the vessel file that describes each exactly."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from benchmarks.hidden.outputs import Motor, Output, Rudder


class Hull(NamedTuple):
    """Size [m], mass [kg], areas above water [m²], inertia and damping (SNAME, negative)."""

    length: float
    beam: float
    mass: float
    frontal: float
    lateral: float
    m11: float
    m22: float
    m33: float
    X_u: float
    X_uu: float
    Y_v: float
    Y_vv: float
    N_r: float
    N_rr: float
    x_g: float = 0.0


NINE = ("m11", "m22", "m33", "X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr")


@dataclass(frozen=True)
class Boat:
    """A boat that steers by differential thrust, or by what `rudders` it has.

    `curve` is 1 (thrust ∝ command) or 2 (∝ c |c|).
    """

    name: str
    source: str
    hull: Hull
    motors: tuple[Motor, ...]
    curve: int = 1
    rudders: tuple[Rudder, ...] = ()

    @property
    def outputs(self) -> tuple[Output, ...]:
        """All that servos drive: motors, then rudders."""
        return (*self.motors, *self.rudders)

    @property
    def ahead(self) -> float:
        """Thrust of all motors full ahead [N]."""
        return sum(motor.ahead for motor in self.motors)

    @property
    def helm(self) -> float:
        """How much more than others this boat must steer to turn, 1 … 3."""
        if self.rudders:
            return 2.0
        moment = sum(abs(m.y) * 0.5 * (m.ahead - m.astern) for m in self.motors)
        return min(max(-self.hull.N_r / moment, 1.0), 3.0)

    def top_speed(self) -> float:
        """Speed of the plain boat at full throttle [m/s]."""
        a, b = -self.hull.X_uu, -self.hull.X_u
        return (-b + math.sqrt(b * b + 4.0 * a * self.ahead)) / (2.0 * a)

    def unstable_above(self) -> float:
        """Speed above which a straight course is unstable with the helm fixed [m/s]."""
        h = self.hull
        if h.m22 <= h.m11:
            return float("inf")
        return math.sqrt(h.Y_v * h.N_r / (h.m11 * (h.m22 - h.m11)))

    def misjudged(self, seed: int, share: float = 0.1) -> "Boat":
        """The same boat with its nine numbers each off by about `share`: a careless vessel file."""
        rng = np.random.default_rng([seed, 0xBA5E])
        off = np.exp(share * rng.choice([-1.0, 1.0], 9) * rng.uniform(0.7, 1.3, 9))
        wrong = {name: getattr(self.hull, name) * float(off[i]) for i, name in enumerate(NINE)}
        return replace(self, hull=self.hull._replace(**wrong))


IACQUABOT = Boat(
    name="IAcquaBot",
    source="Saldarriaga-Mesa et al., Robotics 2025, 14(9), 124, Tables 1 and 5",
    hull=Hull(
        length=1.5, beam=0.67, mass=21.0, frontal=0.12, lateral=0.3,
        m11=124.5923, m22=120.0275, m33=141.5164, X_u=-25.9335, X_uu=-35.9833,
        Y_v=-37.0247, Y_vv=-25.7968, N_r=-200.2944, N_rr=-18.5319,
    ),
    motors=(
        Motor("front_left", 1, 0.5, -0.335, -28.4, 36.4),
        Motor("front_right", 2, 0.5, 0.335, -28.4, 36.4),
        Motor("rear_left", 3, -0.5, -0.335, -28.4, 36.4),
        Motor("rear_right", 4, -0.5, 0.335, -28.4, 36.4),
    ),
)  # fmt: skip

WAM_V = Boat(
    name="WAM-V",
    source="Saldarriaga-Mesa et al., Robotics 2025, 14(9), 124, Tables 1 and 5",
    hull=Hull(
        length=4.9, beam=2.3, mass=180.0, frontal=0.8, lateral=1.6,
        m11=125.9712, m22=121.4476, m33=70.5019, X_u=-26.5692, X_uu=-35.8778,
        Y_v=-36.4337, Y_vv=-27.4138, N_r=-99.1686, N_rr=-10.6007,
    ),
    motors=(
        Motor("left", 1, -0.7, -0.7, -85.0, 90.0),
        Motor("right", 3, -0.7, 0.7, -85.0, 90.0),
    ),
)  # fmt: skip

TEAL = Boat(
    name="Teal",
    source="invented: a light catamaran of 1.2 m, unstable on course above 1 m/s",
    hull=Hull(
        length=1.2, beam=0.8, mass=24.0, frontal=0.1, lateral=0.22,
        m11=27.0, m22=45.0, m33=6.5, X_u=-6.0, X_uu=-12.0,
        Y_v=-40.0, Y_vv=-55.0, N_r=-12.0, N_rr=-6.0,
    ),
    motors=(
        Motor("port", 1, -0.45, -0.32, -18.0, 24.0, pulses=(1000, 1500, 2000)),
        Motor("starboard", 3, -0.45, 0.32, -18.0, 24.0, pulses=(1000, 1500, 2000), reversed=True),
    ),
)  # fmt: skip

GREBE = Boat(
    name="Grebe",
    source="invented: a catamaran of 1.6 m for the recordings that ship, stable at its speeds",
    hull=Hull(
        length=1.6, beam=0.95, mass=38.0, frontal=0.15, lateral=0.35,
        m11=42.0, m22=52.0, m33=12.0, X_u=-9.0, X_uu=-14.0,
        Y_v=-90.0, Y_vv=-60.0, N_r=-18.0, N_rr=-14.0,
    ),
    motors=(
        Motor("left", 1, -0.6, -0.4, -26.0, 32.0),
        Motor("right", 3, -0.6, 0.4, -26.0, 32.0),
    ),
)  # fmt: skip

HERON = Boat(
    name="Heron",
    source="invented: a slender hull of 2 m with one propeller and a rudder behind it",
    hull=Hull(
        length=2.0, beam=0.6, mass=45.0, frontal=0.12, lateral=0.4,
        m11=48.0, m22=75.0, m33=22.0, X_u=-10.0, X_uu=-12.0,
        Y_v=-110.0, Y_vv=-90.0, N_r=-60.0, N_rr=-30.0,
    ),
    motors=(Motor("screw", 3, -0.8, 0.0, -35.0, 60.0),),
    rudders=(Rudder("rudder", 1, -0.95, 0.6, behind="screw", area=0.03),),
)  # fmt: skip

DORY = Boat(
    name="Dory",
    source="invented: a broad hull of 1.8 m with an outboard that turns",
    hull=Hull(
        length=1.8, beam=0.9, mass=60.0, frontal=0.25, lateral=0.45,
        m11=64.0, m22=95.0, m33=28.0, X_u=-12.0, X_uu=-14.0,
        Y_v=-120.0, Y_vv=-80.0, N_r=-65.0, N_rr=-20.0,
    ),
    motors=(Motor("outboard", 3, -0.9, 0.0, -45.0, 70.0),),
    rudders=(Rudder("tiller", 1, -0.9, 0.6, behind="outboard"),),
)  # fmt: skip

BOATS: Mapping[str, Boat] = {
    "iacquabot": IACQUABOT, "wam-v": WAM_V, "teal": TEAL, "grebe": GREBE,
}  # fmt: skip
STEERED: Mapping[str, Boat] = {"heron": HERON, "dory": DORY}
FLEET: Mapping[str, Boat] = {**BOATS, **STEERED}


def light_hull(number: int) -> Boat:
    """A light catamaran with m22 of 1.5 to 2.1 m11: unstable on a straight course at its speeds.

    Drawn from plausible ranges; its critical speed lies between 0.3 and 0.8 m/s, its top speed
    between 1.4 and 2.4 m/s, so that most of any voyage is sailed above the first.
    """
    dice = np.random.default_rng([number, 0x11647])

    def of(low: float, high: float) -> float:
        return float(f"{dice.uniform(low, high):.4g}")

    length = of(0.9, 1.8)
    mass = round(of(10.0, 14.0) * length**1.7, 1)
    m11 = round(mass * of(1.05, 1.15), 2)
    m22, m33 = round(m11 * of(1.5, 2.1), 2), round(m11 * length**2 * of(0.13, 0.2), 3)
    top, critical, share = of(1.4, 2.4), of(0.3, 0.8), of(0.2, 0.4)
    drag = m11 / length * of(0.5, 0.9)  # quadratic, N s²/m²
    linear = round(share * drag * top, 3)
    Y_v = -round(m22 * of(0.35, 0.8), 3)
    N_r = -round(critical**2 * m11 * (m22 - m11) / -Y_v, 3)
    ahead = round(0.5 * (linear * top + drag * top**2), 2)  # of either motor
    beam = round(length * of(0.5, 0.65), 2)
    y = round(0.4 * beam, 3)
    return Boat(
        name=f"Light {number}",
        source="invented by dice: a light catamaran, unstable on course",
        hull=Hull(
            length=length, beam=beam, mass=mass, frontal=round(0.09 * length, 3),
            lateral=round(0.18 * length, 3), m11=m11, m22=m22, m33=m33, X_u=-linear,
            X_uu=-round(drag, 3), Y_v=Y_v, Y_vv=-round(m22 / length * of(0.7, 1.4), 3), N_r=N_r,
            N_rr=-round(m33 * of(0.6, 1.6), 3),
        ),
        motors=(
            Motor("port", 1, -round(0.4 * length, 3), -y, -round(0.75 * ahead, 2), ahead),
            Motor("starboard", 3, -round(0.4 * length, 3), y, -round(0.75 * ahead, 2), ahead),
        ),
    )  # fmt: skip


LIGHT: Mapping[str, Boat] = {f"light-{number}": light_hull(number) for number in range(94)}
EVERY: Mapping[str, Boat] = {**FLEET, **LIGHT}
