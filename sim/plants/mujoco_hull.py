"""A vessel as a rigid body in MuJoCo: six degrees of freedom, afloat.

    M_RB ν̇ + C_RB ν = g + τ_engine,   τ_engine of `sim.plants.hydrodynamics`, anew every step

World NED, body FRD, as everywhere here; the engine's gravity points down z. The integrator is
MuJoCo's semi-implicit Euler, at steps short enough for the hull's fastest motion. Nothing inverts
this plant: `sim.following.predictive` follows with it. Source: Todorov, Erez & Tassa, MuJoCo: a
physics engine for model-based control, IROS 2012.

**The hull**, what its vessel file says, and what follows from its size.

    columns (x_i, y_i, a_i) of the waterline, Σ a_i = A_w,   draught T = m / (ρ A_w)
    GM_T = ρ Σ a_i y_i² / m + z_g − T/2,   GM_L = ρ Σ a_i x_i² / m + z_g − T/2

Where the file has no columns, 6 × 4 of equal area stand so that A_w and both metacentric heights
are those of `sim.plants.waves`; no inertia: the radii of gyration there; no centre of
gravity z_g [m, down from the waterline at rest]: that of buoyancy, T/2; no freeboard: 0.1 of the
length. Added inertia and damping of heave, roll and pitch are those of `sim.plants.waves`.
"""

from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from sim.model import MIN_STABLE_STEP_S, Model
from sim.plants.hydrodynamics import OUT, floating_force
from sim.plants.plant import Afloat, PlantInputs, PlantMotion
from sim.plants.waves import (
    ADDED_HEAVE,
    ADDED_PITCH,
    ADDED_ROLL,
    GRAVITY,
    HEAVE_DAMPING,
    PITCH_DAMPING,
    PITCH_RADIUS,
    ROLL_DAMPING,
    ROLL_RADIUS,
    WATER_DENSITY,
    hull_shape,
)
from sim.state import Floats, Pose, Velocity, Wrench
from sim.vessel import Vessel

ALONG, ACROSS = 6, 4  # columns of a hull whose file has none
FREEBOARD_SHARE = 0.1  # of the length, above the waterline


class FloatingNumbers(NamedTuple):
    """Numbers of a floating hull beside those of its balance."""

    mass: float  # kg
    I_x: float  # kg m², of the hull alone about its centre of gravity
    I_y: float
    I_z: float
    x_g: float  # m ahead of the origin
    z_g: float  # m below the waterline at rest
    draught: float  # m
    freeboard: float  # m
    thrust_depth: float  # m, where thrusters push
    added_heave: float  # kg
    added_roll: float  # kg m²
    added_pitch: float  # kg m²
    heave_damping: float  # N s/m
    roll_damping: float  # N m s
    pitch_damping: float  # N m s


class FloatingHull(NamedTuple):
    """Numbers, columns (K, 3) x, y [m], a [m²], and natural rates of heave, roll, pitch [rad/s]."""

    numbers: FloatingNumbers
    columns: Floats
    rates: tuple[float, float, float]


def floating_hull(vessel: Vessel) -> FloatingHull:
    """The hull of a vessel; ValueError where it would capsize or sink at rest."""
    hull, given = vessel.hull, vessel.floating
    columns = np.array(given.points) if given.points else _assumed_columns(vessel)
    x, y, a = columns.T
    area, m = float(a.sum()), hull.mass
    draught = m / (WATER_DENSITY * area)
    z_g = draught / 2.0 if given.centre_of_gravity is None else given.centre_of_gravity
    inertia = given.inertia or (
        m * (ROLL_RADIUS * hull.beam) ** 2,
        m * (PITCH_RADIUS * hull.length) ** 2,
        m * (PITCH_RADIUS * hull.length) ** 2,
    )
    x_c = float(a @ x) / area
    lever = z_g - draught / 2.0  # of weight below buoyancy
    height_t = WATER_DENSITY * float(a @ y**2) / m + lever
    height_l = WATER_DENSITY * float(a @ (x - x_c) ** 2) / m + lever
    for name, height in (("to the side", height_t), ("over its bow", height_l)):
        if height <= 0.0:
            raise ValueError(
                f"{vessel.name} would fall {name}: its metacentric height is {height:.3g} m; lower "
                "floating.centre_of_gravity, or move floating.points apart"
            )
    stiffness = WATER_DENSITY * GRAVITY * area, m * GRAVITY * height_t, m * GRAVITY * height_l
    total = ADDED_HEAVE * m, ADDED_ROLL * inertia[0], ADDED_PITCH * inertia[1]
    ratios = HEAVE_DAMPING, ROLL_DAMPING, PITCH_DAMPING
    rates = tuple(float(np.sqrt(k / i)) for k, i in zip(stiffness, total, strict=True))
    damping = [
        2.0 * z * float(np.sqrt(k * i)) for z, k, i in zip(ratios, stiffness, total, strict=True)
    ]
    numbers = FloatingNumbers(
        m, *inertia, vessel.dynamics.x_g, z_g, draught,
        FREEBOARD_SHARE * hull.length if given.freeboard is None else given.freeboard,
        draught if given.thruster_depth is None else given.thruster_depth,
        total[0] - m, total[1] - inertia[0], total[2] - inertia[1], *damping,
    )  # fmt: skip
    return FloatingHull(numbers, columns, (rates[0], rates[1], rates[2]))


def _assumed_columns(vessel: Vessel) -> Floats:
    """(K, 3) columns that float as hydrostatics has it: the same area and metacentric heights."""
    h = vessel.hull
    shape = hull_shape(h.length, h.beam, h.mass, h.waterplane_area, h.metacentric_heights)
    area = shape.waterplane_area
    per_height = h.mass / (WATER_DENSITY * area)  # GM -> mean square distance from the centre
    x = _unit_spread(ALONG) * np.sqrt(per_height * shape.gm_longitudinal) + vessel.dynamics.x_g
    y = _unit_spread(ACROSS) * np.sqrt(per_height * shape.gm_transverse)
    grid = np.array([(along, across) for along in x for across in y])
    return np.column_stack([grid, np.full(len(grid), area / len(grid))])


def _unit_spread(count: int) -> Floats:
    """Places (count,) at equal distances, of mean 0 and mean square 1."""
    places = np.arange(count) - 0.5 * (count - 1)
    return places / np.sqrt(np.mean(places**2))


LONGEST_STEP_S = 0.005
STEP_OF_RATE = 0.25  # of h ω: the phase of the fastest oscillation is then 0.3 % off
STEP_OF_DAMPING = 0.15  # of the step that Runge–Kutta would take for the damping
XML = """<mujoco>
<option gravity="0 0 9.80665"><flag contact="disable" constraint="disable"/></option>
<worldbody><body><freejoint/>
<inertial pos="{x} 0 {z}" mass="{m}" diaginertia="{inertia}"/></body></worldbody></mujoco>"""


class HullState(NamedTuple):
    """Place and quaternion (7), world velocity and body rates (6), memory of the effects."""

    position: tuple[float, ...]
    velocity: tuple[float, ...]
    memory: tuple[float, ...]


@dataclass(frozen=True)
class MujocoHull:
    """The plant; `engine` is what MuJoCo works in, its content no part of the plant's state."""

    model: Model
    hull: FloatingHull
    numbers: Floats  # of the hull, as the compiled function takes them
    longest_step: float
    engine: Any

    @classmethod
    def of(cls, model: Model) -> "MujocoHull":
        """A vessel's hull; ValueError where it would not float upright or MuJoCo is not there."""
        hull = floating_hull(model.vessel)
        step = min(
            LONGEST_STEP_S,
            STEP_OF_RATE / max(hull.rates),
            STEP_OF_DAMPING * min(model.max_step(None, np.zeros((1, 3))), MIN_STABLE_STEP_S * 4),
        )
        return cls(model, hull, np.array(hull.numbers), step, _Engine.of(hull))

    @property
    def name(self) -> str:
        """The vessel's name."""
        return self.model.vessel.name

    @property
    def rewinds(self) -> bool:
        """Always: its state is a tuple."""
        return True

    def initial_state(self, motion: PlantMotion, inputs: PlantInputs) -> HullState:
        """Upright on calm water with that pose and velocity, memory settled."""
        (north, east, yaw), (u, v, r) = motion
        c, s = np.cos(yaw), np.sin(yaw)
        position = (north, east, 0.0, np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0))
        velocity = (c * u - s * v, s * u + c * v, 0.0, 0.0, 0.0, r)
        memory = (np.nan,) * (self.model.state_size - 6)
        return HullState(_plain(position), _plain(velocity), memory)

    def motion(self, state: HullState) -> PlantMotion:
        """Pose and velocity in the plane of the water."""
        _, _, _, w, x, y, z = state.position
        yaw = float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))
        north, east, _, _, q, r = state.velocity
        c, s = float(np.cos(yaw)), float(np.sin(yaw))
        tilt_y, tilt_z = 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        rate = (q * tilt_y + r * tilt_z) / max(tilt_y**2 + tilt_z**2, 1e-6)
        velocity = Velocity(c * north + s * east, c * east - s * north, rate)
        return PlantMotion(Pose(state.position[0], state.position[1], yaw), velocity)

    def acceleration(self, state: HullState, tau: Wrench, inputs: PlantInputs) -> Velocity:
        """ν̇ in the plane under a force [N, N, N m] -> [m/s², m/s², rad/s²]."""
        out, _ = self._force(state, np.array(tau, dtype=float), inputs, inputs.time, 0.0)
        return Velocity(*out[12:15].tolist())

    def afloat(self, state: HullState, tau: Wrench, inputs: PlantInputs) -> Afloat:
        """Heave, roll and pitch, their rates and accelerations."""
        out, _ = self._force(state, np.array(tau, dtype=float), inputs, inputs.time, 0.0)
        return Afloat(*out[15:25].tolist())

    def step(self, state: HullState, tau: Wrench, inputs: PlantInputs, dt: float) -> HullState:
        """The state dt [s] later under a constant force."""
        count = max(int(np.ceil(dt / self.longest_step - 1e-9)), 1)
        h, force = dt / count, np.array(tau, dtype=float)
        for i in range(count):
            out, memory = self._force(state, force, inputs, inputs.time + i * h, h)
            position, velocity = self.engine.step(state, out[:6], h)
            state = HullState(position, velocity, memory)
        return state

    def _force(
        self, state: HullState, tau: Floats, inputs: PlantInputs, time: float, h: float
    ) -> tuple[Floats, tuple[float, ...]]:
        """`floating_force` of a state -> (OUT,), and the memory of the effects h [s] later."""
        planar, out = np.empty(9), np.empty(OUT)
        row = np.array((*chain(*self.motion(state)), *state.memory))
        air = np.array((inputs.voltage, inputs.wind_north, inputs.wind_east))
        theta = self.model.theta if inputs.theta is None else inputs.theta
        self.model.kernel.module.horizontal_balance(theta, row, air, time, h, planar)
        floating_force(
            planar, np.array(state.position + state.velocity), tau, self.numbers,
            self.hull.columns, inputs.waves, time, out,
        )  # fmt: skip
        return out, tuple(row[6:].tolist())


def _plain(values: tuple[Any, ...]) -> tuple[float, ...]:
    return tuple(map(float, values))


@dataclass(frozen=True)
class _Engine:
    """MuJoCo's model of one rigid body, and the room that it computes in."""

    module: Any
    model: Any
    data: Any

    @classmethod
    def of(cls, hull: FloatingHull) -> "_Engine":
        try:
            import mujoco
        except ImportError:
            raise ValueError(
                "MuJoCo is not installed: pip install 'shadow-gateway[mujoco]'"
            ) from None
        n = hull.numbers
        xml = XML.format(x=n.x_g, z=n.z_g, m=n.mass, inertia=f"{n.I_x} {n.I_y} {n.I_z}")
        try:
            model = mujoco.MjModel.from_xml_string(xml)
        except ValueError as error:  # inertia that no body has
            raise ValueError(f"floating.inertia = {n[1:4]}: {error}") from None
        return cls(mujoco, model, mujoco.MjData(model))

    def step(
        self, state: HullState, force: Floats, h: float
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """One step under a force (6,) beside gravity -> position and velocity after it."""
        data = self.data
        self.model.opt.timestep = h
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = state.position, state.velocity, force
        self.module.mj_step(self.model, data)
        return tuple(data.qpos.tolist()), tuple(data.qvel.tolist())
