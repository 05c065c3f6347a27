"""What the laws read and return: numbers of the vessel, its flow and inputs, its reported motion.

Floats or arrays alike. `sim.vessel` is the vessel as a file describes it; these are its equations'
symbols.
"""

from typing import Any, NamedTuple

from sim.jit import jitable
from sim.state import to_body


class Body(NamedTuple):
    """Hull and base dynamics (`sim.balance`), SNAME names, damping derivatives negative."""

    length: float  # m
    beam: float  # m
    mass: float  # kg
    area_front: float  # m², above water
    area_side: float  # m², above water
    antenna_x: float  # m, where position and velocity are measured
    antenna_y: float  # m
    m11: float  # m − X_u̇ [kg]
    m22: float  # m − Y_v̇ [kg]
    m33: float  # I_z − N_ṙ [kg m²]
    X_u: float  # N s/m
    X_uu: float  # N s²/m²
    Y_v: float  # N s/m
    Y_vv: float  # N s²/m²
    N_r: float  # N m s
    N_rr: float  # N m s²
    x_g: float  # m, centre of gravity ahead of the origin
    Y_r: float  # N s
    N_v: float  # N s
    Y_uv: float  # N s²/m²
    Y_ur: float  # N s²/m
    N_uv: float  # N s²/m
    N_ur: float  # N s²


class ThrusterParameters(NamedTuple):
    """One thruster."""

    number: float  # 0, 1, … in the order of the vessel file
    x: float  # m, FRD
    y: float  # m
    azimuth: float  # rad
    astern: float  # N at full astern (negative or zero)
    ahead: float  # N at full ahead
    exponent: float  # thrust against command: sign(c) |c|^exponent


class RudderParameters(NamedTuple):
    """One rudder, or the steering of a motor (then only the angles count)."""

    number: float
    x: float  # m, FRD
    y: float  # m
    angle_low: float  # rad at command −1
    angle_high: float  # rad at command +1
    area: float  # m²
    aspect: float  # span² / area


class HeldInputs(NamedTuple):
    """What acts from outside during one step."""

    actuation: tuple[Any, ...]  # static thrusts [N], then rudder angles [rad]
    voltage: float  # V
    wind_north: float  # m/s, velocity of the air
    wind_east: float  # m/s
    wind_known: float  # 1 where the wind was measured, else 0


class Flow(NamedTuple):
    """How the boat moves through water and world."""

    u: float  # m/s through the water
    v: float  # m/s through the water
    r: float  # rad/s
    u_ground: float  # m/s
    v_ground: float  # m/s
    north: float  # m
    east: float  # m
    yaw: float  # rad
    time: float  # s after the first sample
    voltage: float  # V, NaN where not measured
    wind_north: float  # m/s, velocity of the air where measured
    wind_east: float  # m/s
    wind_known: float  # 1 where the wind was measured, else 0
    body: Body


class Report(NamedTuple):
    """Motion as the sensors report it."""

    north: float  # m
    east: float  # m
    yaw: float  # rad
    u: float  # m/s over ground
    v: float  # m/s over ground
    r: float  # rad/s
    u_dot: float  # m/s²
    v_dot: float  # m/s²
    r_dot: float  # rad/s²


@jitable
def with_heading_off(report: Report, error: float, rate: float) -> Report:
    """As a compass reports it that is off by so much [rad], which changes at a rate [rad/s].

    Velocity over ground is none of the compass's: it turns on board by −error, u̇ gets + rate v, v̇
    gets − rate u.
    """
    u, v = to_body(report.u, report.v, error)
    u_dot, v_dot = to_body(report.u_dot, report.v_dot, error)
    return Report(
        report.north,
        report.east,
        report.yaw + error,
        u,
        v,
        report.r,
        u_dot + rate * v,
        v_dot - rate * u,
        report.r_dot,
    )
