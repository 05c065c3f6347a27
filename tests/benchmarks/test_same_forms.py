"""The generator's causes and the catalogue's effects: the same where they should be, else alike.

The two share no code. Here the acceleration of one boat is asked of both, with and without each.
"""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.causes import KNOWN, Hidden, causes_of
from benchmarks.hidden.nature import Nature
from benchmarks.hidden.vessel_toml import vessel_toml
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import EFFECTS, named
from sim.model import Model
from sim.vessel import AddedEffect

BOAT, VOLTS, COUNT = BOATS["grebe"], 15.0, 60
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
}
ALIKE = {  # nature has its own form: least correlation of what they do
    "varying_current": ({"speed": 0.3, "direction": 1.0, "period": 90.0, "phase": 0.4}, 0.97),
    "steady_wind": ({"speed": 8.0, "direction": 2.0}, 0.9),
    "wave_motion": ({"force": 15.0, "omega": 2.2, "direction": 0.5, "phase": 0.0}, 0.6),
    "payload_change": ({"factor": 1.4, "time": 10.0}, 0.95),
    "thruster_deadband": ({"width": 0.15}, 0.3),
    "advance_loss": ({"per_mps": 0.2}, 0.9),
    "astern_stall": ({"per_mps": 0.8, "above": 0.1}, 0.85),
}
OTHER_NAMES = {
    "thruster_fault": (
        {"channel": 3.0, "gain": 0.6, "time": 10.0}, {"thruster": 2.0, "gain": 0.6, "time": 10.0},
    ),
    "actuator_wiring": ({}, {"order": 21.0, "reversed": 0.0}),
}  # fmt: skip
IN_TIME = {"thruster_lag", "command_delay", "velocity_latency"}  # nothing at one moment
SENSORS = {"heading_offset", "compass_deviation", "antenna_offset", "yaw_rate_bias"}


def moments():
    """Poses and velocities (K, 6), commands (K, 2), times (K,): a bit of everything."""
    rng = np.random.default_rng(8)
    states = rng.uniform(-1.0, 1.0, (COUNT, 6)) * [20.0, 20.0, 3.1, 1.5, 0.5, 0.5]
    return states, rng.uniform(-1.0, 1.0, (COUNT, 2)), np.linspace(0.0, 60.0, COUNT)


def in_nature(*hidden):
    """Accelerations of the body-frame velocity (K, 3) by the generator."""
    nature, out = Nature(BOAT, causes_of(hidden)), []
    for (north, east, yaw, u, v, r), commands, time in zip(*moments(), strict=True):
        c, s = np.cos(yaw), np.sin(yaw)
        state = [north, east, yaw, c * u - s * v, s * u + c * v, r, 0.0, 0.0]
        rates = nature.rates(time, state, commands.tolist(), VOLTS)
        ahead, right = c * rates[3] + s * rates[4], c * rates[4] - s * rates[3]
        out.append([ahead + r * v, right - r * u, rates[5]])
    return np.array(out)


def in_sim(folder: Path, *effects):
    """The same by `sim`."""
    file = folder / "boat.toml"
    file.write_text(vessel_toml(BOAT), encoding="utf-8")
    model, out = Model.of(load_vessel(file).with_effects(*effects)), []
    for state, commands, time in zip(*moments(), strict=True):
        _, said = model.simulate(
            commands[None], 0.01, state, voltage=np.array([VOLTS]), start_time=float(time)
        )
        out.append(said[0, 0, 6:])
    return np.array(out)


def differences(folder, name, hidden, values):
    """What the cause does to the accelerations, by the generator and by `sim`: (K, 3) each."""
    there = in_nature(Hidden(name, hidden)) - in_nature()
    here = in_sim(folder, AddedEffect(named(name), values)) - in_sim(folder)
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


def test_all_that_can_be_hidden_is_in_the_catalogue_and_compared():
    assert set(KNOWN) == {*SAME, *ALIKE, *OTHER_NAMES, *IN_TIME, *SENSORS}
    assert {e.name for e in EFFECTS} - set(KNOWN) == {"steering_lag", "steering_offset"}
