"""The model of a boat: hull, dynamics, thrusters, rudders, sensors, effects. Frozen values.

Thrust against command is a power, or a table of knots (command, share of full thrust) with straight
lines between them:

    F = ahead · s(c) for c > 0,   F = −astern · s(c) for c < 0
    s rises from s(−1) = −1 through s(0) = 0 to s(1) = 1:   s(c) = Σ_k (s_k − s_{k−1}) ramp_k(c)

A table is free in form but monotone: more command never means less thrust. Several thrusters may
share one: the others name the thruster that has it. Knots are named by their command in per cent
(`left.curve_25`): the numbers that identification may free.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from sim.effects.effect import Effect, Need
from sim.state import Floats
from sim.wind import areas_text, assumed_wind_areas

Point = tuple[float, float]
Points = tuple[Point, ...]
CURVES = {"linear": 1.0, "quadratic": 2.0}  # name -> exponent of thrust against command
DEFAULT_KNOTS = (0.1, 0.25, 0.5, 0.75)  # ahead and astern, of a curve that is to be identified
KNOT_PREFIX = "curve_"
ENDS = ((-1.0, -1.0), (0.0, 0.0), (1.0, 1.0))


def curve_problem(points: Sequence[Point]) -> str | None:
    """What is wrong with a table, or None."""
    commands, shares = [c for c, _ in points], [s for _, s in points]
    if not set(ENDS) <= set(points) or points[0] != ENDS[0] or points[-1] != ENDS[-1]:
        return "must run from [-1, -1] through [0, 0] to [1, 1]"
    if any(b <= a for a, b in pairwise(commands)):
        return "must have ascending commands"
    if any(b < a for a, b in pairwise(shares)):
        return "must not fall: more command, more thrust"
    if any(abs(100.0 * c - round(100.0 * c)) > 1e-9 for c in commands):
        return "must have commands in whole per cent (-0.25, 0.1)"
    return None if len(points) > len(ENDS) else "must have a knot between its ends"


def knot_commands(points: Points) -> tuple[float, ...]:
    """The commands whose shares are numbers of the model: all but −1, 0 and 1."""
    return tuple(c for c, _ in points if c not in (-1.0, 0.0, 1.0))


def knot_key(command: float) -> str:
    """0.25 -> "curve_25"."""
    return f"{KNOT_PREFIX}{round(100.0 * command)}"


def knot_shares(points: Points) -> dict[str, float]:
    """Key -> share of full thrust, knot by knot."""
    return {knot_key(c): s for c, s in points if c in knot_commands(points)}


def next_knot(key: str, keys: Iterable[str]) -> str | None:
    """The next knot away from zero on the same side; None: full thrust."""
    own = int(key.removeprefix(KNOT_PREFIX))
    beyond = [c for c in (int(k.removeprefix(KNOT_PREFIX)) for k in keys) if c / own > 1.0]
    return knot_key(min(beyond, key=abs) / 100.0) if beyond else None


def table_owner(thrusters: Sequence["Thruster"], thruster: "Thruster") -> int:
    """Number of the thruster whose table this one follows; −1: its curve is a power."""
    for i, other in enumerate(thrusters):
        if not isinstance(other.curve, str) and other.name in (thruster.name, thruster.curve):
            return i
    return -1


def curve_exponent(thruster: "Thruster") -> float:
    """Exponent of a curve that is a power; 1 for a table."""
    return CURVES.get(thruster.curve, 1.0) if isinstance(thruster.curve, str) else 1.0


def as_table(curve: str | Points) -> Points:
    """A curve as a table: a power is sampled at the default knots."""
    if not isinstance(curve, str):
        return curve
    commands = (*(-c for c in reversed(DEFAULT_KNOTS)), 0.0, *DEFAULT_KNOTS)
    inner = [(c, float(np.sign(c) * abs(c) ** CURVES[curve])) for c in commands]
    return (ENDS[0], *inner, ENDS[-1])


def with_free_curves(vessel: "Vessel", names: Iterable[str]) -> "Vessel":
    """The same vessel with tables where a free curve is asked for.

    "left.curve" is that of one thruster, "curve" one table for all of them.
    """
    free = set(names)
    if "curve" in free and not any(not isinstance(t.curve, str) for t in vessel.thrusters):
        first, *others = vessel.thrusters
        shared = [replace(t, curve=first.name) for t in others]
        return replace(vessel, thrusters=(replace(first, curve=as_table(first.curve)), *shared))
    return replace(
        vessel,
        thrusters=tuple(
            replace(t, curve=as_table(t.curve))
            if f"{t.name}.curve" in free and t.curve in CURVES
            else t
            for t in vessel.thrusters
        ),
    )


@dataclass(frozen=True)
class Hull:
    """Size [m], mass [kg], frontal and lateral area above water [m²], and how it floats.

    Areas above water: (0, 0) where not known. Area of the waterline [m²], transverse and
    longitudinal metacentric height [m]: 0 where they are to follow from the size.
    """

    length: float
    beam: float
    mass: float
    wind_area: tuple[float, float] = (0.0, 0.0)
    waterplane_area: float = 0.0
    metacentric_heights: tuple[float, float] = (0.0, 0.0)

    @property
    def has_wind_area(self) -> bool:
        """Whether the areas above water are known."""
        return min(self.wind_area) > 0.0

    @property
    def areas(self) -> tuple[float, float]:
        """The areas above water, assumed from the size where they are not known."""
        return self.wind_area if self.has_wind_area else assumed_wind_areas(self.length, self.beam)


@dataclass(frozen=True)
class Floating:
    """The hull in six degrees of freedom (`sim.plants.mujoco_hull`); what is not given is assumed.

    points              columns of the waterline: x, y [m, FRD], area [m²]
    inertia             I_x, I_y, I_z [kg m²] of the hull alone about its centre of gravity
    centre_of_gravity   m, down from the waterline at rest
    freeboard           m of hull above the waterline
    thruster_depth      m below the waterline where thrusters push
    """

    points: tuple[tuple[float, float, float], ...] = ()
    inertia: tuple[float, float, float] | None = None
    centre_of_gravity: float | None = None
    freeboard: float | None = None
    thruster_depth: float | None = None


@dataclass(frozen=True)
class Dynamics:
    """Base dynamics: inertia with added mass [kg, kg, kg m²], damping derivatives (negative)."""

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
    Y_r: float = 0.0
    N_v: float = 0.0
    Y_uv: float = 0.0
    Y_ur: float = 0.0
    N_uv: float = 0.0
    N_ur: float = 0.0


BASE = ("m11", "m22", "m33", "X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr")  # every hull has them


@dataclass(frozen=True)
class Servo:
    """Pulse widths [µs] of an output channel (1-based): lowest, neutral, highest."""

    channel: int
    pwm: tuple[float, float, float] = (1100.0, 1500.0, 1900.0)
    reversed: bool = False

    def command(self, pulse: Floats) -> Floats:
        """Pulse widths [µs] -> commands in [−1, 1]; 0, 65535 and NaN mean no command: 0."""
        low, neutral, high = self.pwm
        valid = np.isfinite(pulse) & (pulse > 0) & (pulse < 65535)
        command = np.interp(np.where(valid, pulse, neutral), (low, neutral, high), (-1, 0, 1))
        return -command if self.reversed else command

    def pulse(self, command: Floats) -> Floats:
        """Commands in [−1, 1] -> pulse widths [µs]."""
        signed = -np.asarray(command) if self.reversed else np.asarray(command)
        return np.interp(signed, (-1.0, 0.0, 1.0), self.pwm)


@dataclass(frozen=True)
class Thruster:
    """A propeller at `position` [m, FRD], pushing along `azimuth` [rad]."""

    name: str
    servo: Servo
    position: tuple[float, float]
    thrust: tuple[float, float]  # N full astern, full ahead
    azimuth: float = 0.0
    curve: str | Points = "linear"  # a power, a table, or the thruster that has the table


@dataclass(frozen=True)
class Rudder:
    """A rudder at `position` [m, FRD], or (`motor`) the steering of that thruster."""

    name: str
    servo: Servo
    position: tuple[float, float]
    angle: tuple[float, float]  # rad at command −1, +1; positive turns the bow to starboard ahead
    area: float = 0.0  # m²
    aspect: float = 1.5  # span² / area
    wash: str | None = None  # the thruster in whose slipstream it stands
    motor: str | None = None  # the thruster that turns instead


@dataclass(frozen=True)
class Sensors:
    """Where position and velocity (antenna) and accelerations (imu) are measured [m, FRD].

    The errors are those of a simulated boat's sensors (`shadow hil`); a fit does not read them.
    Noise of gyro and accelerometer is a density, per root of the bandwidth; that of position and
    velocity the standard deviation of a reading.
    """

    antenna: tuple[float, float] = (0.0, 0.0)
    imu: tuple[float, float] = (0.0, 0.0)
    gyro_noise: float = 0.0  # rad/s/√Hz
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad/s
    accel_noise: float = 0.0  # m/s²/√Hz
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s²
    position_noise: float = 0.0  # m
    velocity_noise: float = 0.0  # m/s


@dataclass(frozen=True)
class AddedEffect:
    """An effect in a vessel, with its parameters' values; those with a default may be left out."""

    effect: Effect
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        parameters = self.effect.parameters
        defaults = {p.name: p.default for p in parameters if p.default is not None}
        object.__setattr__(self, "values", defaults | dict(self.values))
        wanted = [p.name for p in self.effect.parameters]
        missing = [name for name in wanted if name not in self.values]
        unknown = [name for name in self.values if name not in wanted]
        if missing or unknown:
            raise ValueError(
                f"effect {self.effect.name} takes {', '.join(wanted)}"
                + (f"; missing {', '.join(missing)}" if missing else "")
                + (f"; unknown {', '.join(unknown)}" if unknown else "")
            )


@dataclass(frozen=True)
class Vessel:
    """The model of a boat."""

    name: str
    hull: Hull
    dynamics: Dynamics
    thrusters: tuple[Thruster, ...]
    rudders: tuple[Rudder, ...] = ()
    sensors: Sensors = field(default_factory=Sensors)
    floating: Floating = field(default_factory=Floating)
    effects: tuple[AddedEffect, ...] = ()
    source: str = ""
    sketch: bool = False  # its dynamics were never fitted to a boat that moved

    def __post_init__(self) -> None:
        for added in self.effects:
            name, needs = added.effect.name, self.unmet_needs(added.effect)
            if needs:
                raise ValueError(f"effect {name} needs {needs}: {self.name} has none")

    def unmet_needs(self, effect: Effect) -> str:
        """What the vessel would need for that effect to act on it, in words; empty: nothing.

        Areas above water that are not known are assumed (`assumptions`).
        """
        has = {
            Need.WIND_AREA: True,
            Need.PORT_THRUSTER: any(t.position[1] < 0.0 for t in self.thrusters),
            Need.ARM: self.has_arms,
            Need.STEERING: bool(self.rudders),
            Need.FIXED_MOTOR: any(t.name not in self._steered for t in self.thrusters),
        }
        return " and ".join(need.value for need in effect.needs if not has[need])

    @property
    def has_arms(self) -> bool:
        """Whether thrust turns the boat by how far a motor is from the middle."""
        return any(t.position[1] for t in self.thrusters) or self.has_arms_along

    @property
    def has_arms_along(self) -> bool:
        """Whether it does by how far ahead or astern: a motor that is steered, or points aside."""
        steered = self._steered
        return any(
            t.position[0] and (t.name in steered or np.sin(t.azimuth)) for t in self.thrusters
        )

    @property
    def turns_on_the_spot(self) -> bool:
        """Whether motors turn the boat at rest: one that is steered turns her under way."""
        return any(t.position[1] or np.sin(t.azimuth) for t in self.thrusters)

    @property
    def _steered(self) -> set[str]:
        """Names of the motors that are steered."""
        return {rudder.motor for rudder in self.rudders if rudder.motor}

    @property
    def assumes_wind_area(self) -> bool:
        """Whether one of its effects acts on areas above water that nobody gave."""
        needed = any(Need.WIND_AREA in added.effect.needs for added in self.effects)
        return needed and not self.hull.has_wind_area

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What stands behind no measurement, a sentence each: a sketch, areas for its effects."""
        sketch = f"a sketch, not fitted to any recording ({self.source}): identify it first"
        areas = f"{areas_text(*self.hull.areas)}; give hull.wind_area in the vessel file"
        told = ((self.sketch, sketch), (self.assumes_wind_area, areas))
        return tuple(text for true, text in told if true)

    @property
    def actuators(self) -> tuple[Thruster | Rudder, ...]:
        """Thrusters, then rudders: the order of the columns of a command table."""
        return (*self.thrusters, *self.rudders)

    def commands(self, channels: Sequence[int], pwm: Floats) -> Floats:
        """Pulse widths (..., n) [µs] of `channels` -> commands (..., actuators) in [−1, 1].

        A channel that is not there gives no command.
        """
        column = {channel: i for i, channel in enumerate(channels)}
        out = np.zeros((*pwm.shape[:-1], len(self.actuators)))
        for k, actuator in enumerate(self.actuators):
            if actuator.servo.channel in column:
                out[..., k] = actuator.servo.command(pwm[..., column[actuator.servo.channel]])
        return out

    def pulses(self, commands: Floats) -> tuple[tuple[int, ...], Floats]:
        """Commands (..., actuators) -> channels and pulse widths (..., channels) [µs]."""
        servos = [actuator.servo for actuator in self.actuators]
        channels = tuple(sorted({servo.channel for servo in servos}))
        pwm = np.full((*commands.shape[:-1], len(channels)), np.nan)
        for k, servo in enumerate(servos):
            pwm[..., channels.index(servo.channel)] = servo.pulse(commands[..., k])
        return channels, pwm

    def with_effects(self, *added: AddedEffect) -> "Vessel":
        """The same vessel with these effects added."""
        return replace(self, effects=(*self.effects, *added))
