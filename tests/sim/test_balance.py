"""Laws of the dynamics, for every shape of vessel and for mass matrices at random."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.balance import (
    acceleration_through,
    balance_residual,
    base_inertia,
    coriolis_force,
    damping_force,
    inertia_force,
    kinematics,
    relative_velocity,
    solve,
    velocity_through,
)
from sim.body import Body, Flow
from sim.model import Model
from sim.state import Inertia, Pose, Velocity, Water, Wrench
from sim.vessel import Dynamics, Vessel
from tests.sim.vessels import IACQUABOT, SHAPES, SLENDER, WAMV, excitation

DT = 0.05
small = st.floats(-3.0, 3.0)
mass = st.floats(20.0, 200.0)
coupling = st.floats(-10.0, 10.0)
inertias = st.builds(Inertia, mass, coupling, coupling, mass, coupling, mass)
velocities = st.builds(Velocity, small, small, small)


def shape_id(vessel: Vessel) -> str:
    return vessel.name.replace(" ", "_")


every_shape = pytest.mark.parametrize("vessel", SHAPES, ids=shape_id)


@given(inertias, velocities)
def test_coriolis_does_no_work(M, nu):
    c = coriolis_force(M, nu)
    power = c.X * nu.u + c.Y * nu.v + c.N * nu.r
    size = abs(c.X * nu.u) + abs(c.Y * nu.v) + abs(c.N * nu.r)
    assert abs(power) <= 1e-12 * (1.0 + size)


@given(inertias, velocities)
def test_solve_undoes_inertia(M, a):
    np.testing.assert_allclose(solve(M, inertia_force(M, a)), a, rtol=1e-9, atol=1e-9)


@given(inertias, velocities)
def test_fossens_matrices_give_the_same_forces(M, nu):
    """M ν̇ and C(ν) ν against the matrices as the book writes them (6.43)."""
    m = np.array([[M.m11, M.m12, M.m13], [M.m12, M.m22, M.m23], [M.m13, M.m23, M.m33]])
    p = m @ nu
    c = np.array([[0, 0, -p[1]], [0, 0, p[0]], [p[1], -p[0], 0]])
    np.testing.assert_allclose(inertia_force(M, nu), p, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(coriolis_force(M, nu), c @ nu, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("yaw", [-2.0, 0.3, 1.5])
def test_the_boat_goes_over_ground_as_its_heading_turns_its_velocity(yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    J = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    nu = Velocity(1.2, -0.4, 0.3)
    np.testing.assert_allclose(kinematics(Pose(5.0, 7.0, yaw), nu), J @ nu, rtol=1e-12)
    water = Water(0.5, -0.2, 0.0, 0.0)
    through = J.T @ (J @ nu - [0.5, -0.2, 0.0])  # the current turns nothing
    np.testing.assert_allclose(velocity_through(water, Pose(5.0, 7.0, yaw), nu), through)


def test_the_acceleration_through_the_water_is_the_rate_of_the_velocity_through_it():
    """On a course that turns, in a current that grows: by differences of a hundredth second."""
    yaw, r, r_dot, h = 0.7, 0.4, -0.3, 1e-2
    nu, nu_dot = Velocity(1.5, -0.3, r), Velocity(0.2, 0.6, r_dot)

    def through(t):
        pose = Pose(0.0, 0.0, yaw + r * t + 0.5 * r_dot * t * t)
        water = Water(0.4 + 0.05 * t, -0.3 + 0.08 * t, 0.05, 0.08)
        moving = Velocity(*(x + dx * t for x, dx in zip(nu, nu_dot, strict=True)))
        return np.array(velocity_through(water, pose, moving))

    at = acceleration_through(Water(0.4, -0.3, 0.05, 0.08), Pose(0.0, 0.0, yaw), nu, nu_dot)
    np.testing.assert_allclose(at, (through(h) - through(-h)) / (2.0 * h), atol=2e-5)


def test_the_balance_is_what_moves_the_boat_less_what_pushes_it():
    """M a + C(v) v + D(v) v - tau with the matrices of a boat whose weight lies ahead, by hand."""
    numbers = dict.fromkeys(Body._fields, 0.0)
    given = {"m11": 50.0, "m22": 80.0, "m33": 30.0, "mass": 40.0, "x_g": 0.25}
    body = Body(**(numbers | given | {"X_u": -6.0, "Y_v": -20.0, "N_r": -9.0, "N_v": 3.0}))
    M = base_inertia(body)
    assert M == Inertia(50.0, 0.0, 0.0, 80.0, 10.0, 30.0)
    matrix = np.array([[50.0, 0.0, 0.0], [0.0, 80.0, 10.0], [0.0, 10.0, 30.0]])
    v, a, tau = np.array([2.0, -1.0, 0.5]), np.array([0.3, 0.2, -0.4]), np.array([7.0, -5.0, 3.0])
    p = matrix @ v
    c = np.array([[0.0, 0.0, -p[1]], [0.0, 0.0, p[0]], [p[1], -p[0], 0.0]])
    d = np.array([[6.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, -3.0, 9.0]])
    left = balance_residual(M, body, Velocity(*v), Velocity(*a), Wrench(*tau))
    np.testing.assert_allclose(left, matrix @ a + c @ v + d @ v - tau, rtol=1e-12)
    flow = Flow(*(0.0,) * (len(Flow._fields) - 1), body)._replace(u=2.0, v=-1.0, r=0.5)
    assert relative_velocity(flow) == Velocity(2.0, -1.0, 0.5)


@given(velocities)
def test_damping_takes_energy_out(nu):
    body = Body(*(getattr(WAMV.dynamics, name, 0.0) for name in Body._fields))
    d = damping_force(body, nu)
    assert d.X * nu.u + d.Y * nu.v + d.N * nu.r >= 0.0


def test_every_term_of_damping_is_there_once():
    """With a prime for each number and the signs of all speeds, no two mistakes look alike."""
    names = ("X_u", "X_uu", "Y_v", "Y_vv", "Y_r", "Y_uv", "Y_ur", "N_r", "N_rr", "N_v", "N_uv",
             "N_ur")  # fmt: skip
    primes = dict(zip(names, (2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0),
                      strict=True))  # fmt: skip
    body = Body(**{name: primes.get(name, 0.0) for name in Body._fields})
    d = damping_force(body, Velocity(2.0, -3.0, 5.0))
    assert d.X == -(2.0 + 3.0 * 2.0) * 2.0
    assert d.Y == (5.0 + 7.0 * 3.0) * 3.0 - (11.0 * 5.0 - 13.0 * 6.0 + 17.0 * 10.0)
    assert d.N == -(19.0 + 23.0 * 5.0) * 5.0 - (-29.0 * 3.0 - 31.0 * 6.0 + 37.0 * 10.0)


@every_shape
def test_at_rest_without_command_nothing_moves(vessel):
    states, reports = Model.of(vessel).simulate(np.zeros((40, len(vessel.actuators))), DT)
    assert not states.any()
    assert not reports.any()


@every_shape
def test_drag_takes_energy_out(vessel):
    """Motors off, whatever the start: kinetic energy falls from row to row."""
    model, d = Model.of(vessel), vessel.dynamics
    start = np.zeros((20, 6))
    start[:, 3:] = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3))
    states, _ = model.simulate(np.zeros((400, len(vessel.actuators))), DT, start)
    energy = 0.5 * states[..., 3:6] ** 2 @ [d.m11, d.m22, d.m33]
    assert np.all(np.diff(energy, axis=1) < 0.0)
    assert np.all(energy[:, -1] < 0.05 * energy[:, 0])


@every_shape
def test_port_mirrors_starboard(vessel):
    """A mirrored boat with mirrored rudder commands makes the mirrored voyage."""
    flip = np.array([1.0, -1.0, -1.0] * 2)
    mirrored = replace(
        vessel,
        thrusters=tuple(
            replace(t, position=(t.position[0], -t.position[1]), azimuth=-t.azimuth)
            for t in vessel.thrusters
        ),
        sensors=replace(vessel.sensors, antenna=(0.0, 0.0)),
    )
    commands = excitation(vessel, 30.0, DT)
    other = commands.copy()
    other[:, len(vessel.thrusters) :] *= -1.0
    start = np.array([1.0, 2.0, 0.3, 0.8, -0.2, 0.1])
    a, _ = Model.of(vessel).simulate(commands, DT, start)
    b, _ = Model.of(mirrored).simulate(other, DT, flip * start)
    np.testing.assert_allclose(b[0], flip * a[0], rtol=0, atol=1e-9)


@every_shape
def test_a_batch_equals_a_loop(vessel):
    rng = np.random.default_rng(3)
    model = Model.of(vessel)
    tables = np.stack([excitation(vessel, 5.0, DT, seed) for seed in range(4)])
    start = rng.normal(0.0, 0.3, (4, 6))
    thetas = model.theta * rng.uniform(0.8, 1.2, (4, len(model.theta)))
    states, reports = model.simulate(tables, DT, start, theta=thetas)
    for b in range(4):
        one, reported = model.simulate(tables[b], DT, start[b], theta=thetas[b])
        np.testing.assert_array_equal(states[b], one[0])
        np.testing.assert_array_equal(reports[b], reported[0])


def test_runge_kutta_is_of_fourth_order():
    """Held commands, no kinks (u, v, r keep their signs): halving the step divides error by 16."""
    model = Model.of(WAMV)
    start = np.array([0.0, 0.0, 0.4, 0.8, -0.5, 0.6])

    def end(steps):
        return model.simulate(np.full((steps, 2), [0.9, 0.5]), 1.6 / steps, start)[0][0, -1]

    exact = end(2048)
    errors = [np.linalg.norm(end(steps) - exact) for steps in (32, 64, 128)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 3.9) & (orders < 4.2)), orders


@pytest.mark.parametrize("nu", [(-12.8, -2.8, 0.0), (11.0, 0.3, 1.0), (0.0, 6.0, 0.0)])
def test_a_coarse_table_does_not_make_a_fast_boat_run_away(nu):
    """A dinghy guessed from its size, thrown at speeds that no step of 0.2 s would survive."""
    guess = Dynamics(33.0, 48.0, 10.8, -20.0, -10.0, -60.0, -100.0, -12.8, -12.8)
    model, start = Model.of(replace(WAMV, dynamics=guess)), np.array([0.0, 0.0, 0.0, *nu])
    coarse = model.simulate(np.zeros((10, 2)), 0.2, start)[0][0, :, 3:6]
    fine = model.simulate(np.zeros((400, 2)), 0.005, start)[0][0, ::40, 3:6]
    assert np.max(np.abs(coarse - fine)) < 0.03 * np.linalg.norm(nu)


def test_a_hull_damped_far_too_strongly_does_not_run_away_on_its_way_up():
    """As fitted to three short recordings: steps that do at rest are too long in a spin."""
    fitted = Dynamics(30.0, 30.0, 1.0, 0.0, -9.0, -10.0, -400.0, -20.0, -400.0)
    model = Model.of(replace(WAMV, dynamics=fitted))
    spin = np.tile([1.0, -1.0], (60, 1))
    coarse = model.simulate(spin, 0.1)[0][0, -1, 3:6]
    fine = model.simulate(np.repeat(spin, 200, axis=0), 5e-4)[0][0, -1, 3:6]
    assert coarse == pytest.approx(fine, abs=0.02 * np.abs(fine).max())


@pytest.mark.parametrize("command", [-0.7, 0.3, 1.0])
@pytest.mark.parametrize("vessel", [WAMV, IACQUABOT], ids=shape_id)
def test_steady_speed_is_where_drag_equals_thrust(vessel, command):
    count = len(vessel.thrusters)
    states, _ = Model.of(vessel).simulate(np.full((2000, count), command), DT)
    u = states[0, -1, 3]
    astern, ahead = vessel.thrusters[0].thrust
    thrust = count * abs(command) * (ahead if command > 0 else astern)
    d = vessel.dynamics
    assert -d.X_u * u - d.X_uu * abs(u) * u == pytest.approx(thrust, rel=1e-9)
    assert np.sign(u) == np.sign(command)


def test_the_munk_moment_turns_the_bow_away_from_the_flow():
    """Drifting to starboard at speed, a hull with m22 > m11 turns its bow to port."""
    model = Model.of(replace(WAMV, dynamics=SLENDER))
    _, reports = model.simulate(np.zeros((1, 2)), DT, np.array([0, 0, 0, 1.0, 0.2, 0.0]))
    r_dot = reports[0, 0, 8]
    assert r_dot == pytest.approx(-(SLENDER.m22 - SLENDER.m11) * 1.0 * 0.2 / SLENDER.m33)
    assert r_dot < 0.0


@pytest.mark.parametrize("times", [0.9, 1.1])
def test_a_straight_course_is_unstable_above_its_critical_speed(times):
    """U_c = √(Y_v N_r / (m11 (m22 − m11)))."""
    d = Dynamics(60.0, 95.0, 30.0, -1e-12, 0.0, -30.0, 0.0, -20.0, 0.0)
    critical = np.sqrt(d.Y_v * d.N_r / (d.m11 * (d.m22 - d.m11)))
    start = np.array([0, 0, 0, times * critical, 1e-7, 0.0])
    states, _ = Model.of(replace(WAMV, dynamics=d)).simulate(np.zeros((1200, 2)), DT, start)
    size = np.abs(states[0, :, 5])
    grows = size[-1] > size[200]
    assert grows == (times > 1.0)
    assert states[0, -1, 3] == pytest.approx(times * critical, rel=1e-3)


def test_a_full_mass_matrix_is_felt():
    """The centre of gravity ahead of the origin couples sway and yaw, and still does no work."""
    vessel = replace(WAMV, dynamics=replace(WAMV.dynamics, x_g=0.3))
    start = np.array([0, 0, 0, 1.0, 0.4, 0.3])
    _, a = Model.of(vessel).simulate(np.zeros((1, 2)), DT, start)
    _, b = Model.of(WAMV).simulate(np.zeros((1, 2)), DT, start)
    assert np.abs(a[0, 0, 7:9] - b[0, 0, 7:9]).min() > 1e-3
    coupled = WAMV.hull.mass * 0.3
    nu, nu_dot = a[0, 0, 3:6], a[0, 0, 6:9]
    d = vessel.dynamics
    M = np.array([[d.m11, 0, 0], [0, d.m22, coupled], [0, coupled, d.m33]])
    p = M @ nu
    left = M @ nu_dot + np.cross([0, 0, nu[2]], [*p[:2], 0])
    left[2] += nu[0] * p[1] - nu[1] * p[0]
    D = -np.diag(
        [d.X_u + d.X_uu * abs(nu[0]), d.Y_v + d.Y_vv * abs(nu[1]), d.N_r + d.N_rr * abs(nu[2])]
    )
    np.testing.assert_allclose(left + D @ nu, 0.0, atol=1e-9)


def test_the_printed_equations_of_the_paper_are_the_balance():
    """τ = M ν̇ + C ν + D ν of a plain vessel, with the Munk moment (m22 − m11) u v in yaw."""
    model, d = Model.of(WAMV), WAMV.dynamics
    commands = excitation(WAMV, 20.0, DT)
    _, reports = model.simulate(commands, DT)
    u, v, r, du, dv, dr = reports[0, :-1, 3:].T
    left, right = np.where(commands > 0, 90.0, 85.0).T * commands.T
    X = d.m11 * du - d.m22 * v * r - (d.X_u + d.X_uu * abs(u)) * u
    Y = d.m22 * dv + d.m11 * u * r - (d.Y_v + d.Y_vv * abs(v)) * v
    N = d.m33 * dr + (d.m22 - d.m11) * u * v - (d.N_r + d.N_rr * abs(r)) * r
    np.testing.assert_allclose(X, left + right, atol=1e-9)
    np.testing.assert_allclose(Y, 0.0, atol=1e-9)
    np.testing.assert_allclose(N, 0.7 * (left - right), atol=1e-9)


def test_wrench_and_velocity_are_in_the_order_of_their_columns():
    assert Wrench._fields == ("X", "Y", "N")
    assert Velocity._fields == ("u", "v", "r")
