"""The generator's causes and the catalogue's effects: the same where they should be, else alike.

The two share no code. Here the acceleration of one boat is asked of both, with and without each; of
`sim` in plain Python, as a kernel for each takes seconds to compile.
"""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden.boats import FLEET
from benchmarks.hidden.causes import KNOWN, Hidden, causes_of
from benchmarks.hidden.nature import Nature
from benchmarks.hidden.sail import TICK, stepped
from benchmarks.hidden.vessel_toml import vessel_toml
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import EFFECTS, named
from sim.vessel import AddedEffect
from tests.sim.simulated import on_floats

VOLTS, COUNT = 15.0, 60
SAME = {
    "steady_current": {"speed": 0.3, "direction": 1.0},
    "inertial_force": {"force": 6.0, "direction": -1.0},
    "cubic_drag": {"X_uuu": -12.0},
    "drag_growth": {"rate": 0.02},
    "cg_offset": {"x_g": -0.15},
    "cross_damping": {"Y_r": -8.0, "N_v": 6.0},
    "hull_lift": {"Y_uv": -30.0, "Y_ur": 5.0, "N_uv": 8.0, "N_ur": -5.0},
    "towed_load": {"drag": 8.0, "x": -0.8},
    "thruster_misalignment": {"angle": 0.12},
    "thrust_curve": {"exponent": 1.4},
    "thruster_imbalance": {"port_gain": 0.85},
    "reverse_loss": {"factor": 0.6},
    "battery_sag": {"nominal": 17.5},
    "steering_offset": {"angle": 0.1},
    "steering_scale": {"gain": 0.7},
    "thrust_scale": {"gain": 0.7},
    "lever_arm": {"gain": 0.6},
}
ALIKE = {  # nature has its own form: least correlation of what they do
    "varying_current": ({"speed": 0.3, "direction": 1.0, "period": 90.0, "phase": 0.4}, 0.97),
    "current_change": (
        {"speed": 0.3, "direction": 1.0, "later_speed": 0.2, "later_direction": 4.0, "time": 30.0},
        0.85,
    ),
    "wind_change": (
        {"speed": 8.0, "direction": 2.0, "later_speed": 4.0, "later_direction": 5.0, "time": 30.0},
        0.85,
    ),
    "steady_wind": ({"speed": 8.0, "direction": 2.0}, 0.9),
    "wave_motion": ({"force": 15.0, "omega": 2.2, "direction": 0.5, "phase": 0.0}, 0.6),
    "crossing_waves": ({"force": 15.0, "omega": 1.6, "direction": 2.5, "phase": 1.0}, 0.6),
    "payload_change": ({"factor": 1.4, "time": 10.0}, 0.95),
    "thruster_deadband": ({"width": 0.15}, 0.3),  # as our files had it, rescaled
    "advance_loss": ({"per_mps": 0.2}, 0.9),
    "astern_stall": ({"per_mps": 0.8, "above": 0.1}, 0.85),
}
JUMPING = {"width": 0.15, "jump": 1.0}  # nature's dead-band gives at once what is commanded
OTHER_NAMES = {
    "thruster_fault": (
        {"channel": 3.0, "gain": 0.6, "time": 10.0}, {"thruster": 2.0, "gain": 0.6, "time": 10.0},
    ),
    "actuator_wiring": ({}, {"order": 21.0, "reversed": 0.0}),
}  # fmt: skip
STRIPS = {"crossflow_drag": {"drag": 60.0}}  # nature has more of them
# nothing at one moment
IN_TIME = {
    "thruster_lag",
    "steering_lag",
    "steering_play",
    "command_delay",
    "velocity_latency",
    "steering_rate",
}
SENSORS = {"heading_offset", "compass_deviation", "antenna_offset", "yaw_rate_bias"}


def moments():
    """Poses and velocities (K, 6), commands (K, 2), times (K,): a bit of everything."""
    rng = np.random.default_rng(8)
    states = rng.uniform(-1.0, 1.0, (COUNT, 6)) * [20.0, 20.0, 3.1, 1.5, 0.5, 0.5]
    return states, rng.uniform(-1.0, 1.0, (COUNT, 2)), np.linspace(0.0, 60.0, COUNT)


def boat_for(name):
    """A boat that the cause can act on."""
    return FLEET["heron" if name.startswith("steering") else "grebe"]


def in_nature(boat, *hidden):
    """Accelerations of the body-frame velocity (K, 3) by the generator."""
    nature, out = Nature(boat, causes_of(hidden)), []
    for (north, east, yaw, u, v, r), commands, time in zip(*moments(), strict=True):
        c, s = np.cos(yaw), np.sin(yaw)
        state = [north, east, yaw, c * u - s * v, s * u + c * v, r, 0.0, 0.0]
        rates = nature.rates(time, state, commands.tolist(), VOLTS)
        ahead, right = c * rates[3] + s * rates[4], c * rates[4] - s * rates[3]
        out.append([ahead + r * v, right - r * u, rates[5]])
    return np.array(out)


def in_sim(folder: Path, boat, *effects):
    """The same by `sim`."""
    file = folder / "boat.toml"
    file.write_text(vessel_toml(boat), encoding="utf-8")
    model, out = on_floats(load_vessel(file).with_effects(*effects)), []
    for state, commands, time in zip(*moments(), strict=True):
        _, said = model.simulate(
            commands[None], 0.01, state, voltage=np.array([VOLTS]), start_time=float(time)
        )
        out.append(said[0, 0, 6:])
    return np.array(out)


def differences(folder, name, hidden, values):
    """What the cause does to the accelerations, by the generator and by `sim`: (K, 3) each."""
    boat = boat_for(name)
    there = in_nature(boat, Hidden(name, hidden)) - in_nature(boat)
    here = in_sim(folder, boat, AddedEffect(named(name), values)) - in_sim(folder, boat)
    assert np.abs(there).max() > 0.01
    return there, here


@pytest.mark.parametrize("name", SAME)
def test_the_same_law_where_it_should_be(name, tmp_path):
    there, here = differences(tmp_path, name, SAME[name], SAME[name])
    np.testing.assert_allclose(here, there, atol=1e-9)


@pytest.mark.parametrize("name", OTHER_NAMES)
def test_the_same_law_with_other_names(name, tmp_path):
    there, here = differences(tmp_path, name, *OTHER_NAMES[name])
    np.testing.assert_allclose(here, there, atol=1e-9)


@pytest.mark.parametrize("name", ALIKE)
def test_alike_where_nature_has_a_form_of_its_own(name, tmp_path):
    values, least = ALIKE[name]
    there, here = differences(tmp_path, name, values, values)
    agreement = (here * there).sum() / np.sqrt((here**2).sum() * (there**2).sum())
    assert least < agreement < 1.0 - 1e-6


@pytest.mark.parametrize("name", STRIPS)
def test_strips_are_the_same_however_many(name, tmp_path):
    there, here = differences(tmp_path, name, STRIPS[name], STRIPS[name])
    np.testing.assert_allclose(here, there, atol=0.01 * np.abs(there).max())


def test_a_dead_band_that_jumps_is_that_of_nature(tmp_path):
    there, here = differences(tmp_path, "thruster_deadband", {"width": 0.15}, JUMPING)
    agreement = (here * there).sum() / np.sqrt((here**2).sum() * (there**2).sum())
    assert 0.85 < agreement < 1.0 - 1e-6  # the jump is spread over a tenth of the width


def answers_to_a_step(folder, name, tau):
    """Velocity (K, 3) two seconds from rest under a step of all commands, nature's and sim's."""
    boat, ticks = boat_for(name), 100
    commands = [0.6] * len(boat.outputs)
    if not boat.rudders:
        commands[0] = 0.3
    nature, state, there = Nature(boat, causes_of([Hidden(name, {"tau": tau})])), [0.0] * 8, []
    for k in range(ticks):
        state = stepped(nature, k * TICK, state, commands, VOLTS)
        c, s = np.cos(state[2]), np.sin(state[2])
        there.append([c * state[3] + s * state[4], c * state[4] - s * state[3], state[5]])
    file = folder / "boat.toml"
    file.write_text(vessel_toml(boat), encoding="utf-8")
    model = on_floats(load_vessel(file).with_effects(AddedEffect(named(name), {"tau": tau})))
    start = np.zeros(model.state_size)  # at rest, shafts and rudders too
    states, _ = model.simulate(np.tile(commands, (ticks, 1)), TICK, start)
    return np.array(there), states[0, 1:, 3:6]


@pytest.mark.parametrize(("name", "same"), [("steering_lag", True), ("thruster_lag", False)])
def test_a_shaft_that_lags_is_not_a_thrust_that_lags(name, same, tmp_path):
    """A rudder follows alike in both; nature's shaft speed lags, and thrust is its square."""
    there, here = answers_to_a_step(tmp_path, name, 0.5)
    at_once, _ = answers_to_a_step(tmp_path, name, TICK)
    off, effect = np.abs(there - here).max(), np.abs(there - at_once).max()
    assert effect > 0.03
    assert off < 1e-5 if same else 1e-3 < off < 0.6 * effect


def test_all_that_can_be_hidden_is_in_the_catalogue_and_compared():
    assert set(KNOWN) == {*SAME, *ALIKE, *OTHER_NAMES, *STRIPS, *IN_TIME, *SENSORS}
    assert {e.name for e in EFFECTS if not e.is_curve} == set(KNOWN)  # a table has no law
