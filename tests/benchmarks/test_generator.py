"""The generator of hidden effects: independent of `sim`, right where it claims to agree with it."""

import ast
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.hidden.boats import BOATS, FLEET, Boat
from benchmarks.hidden.causes import KNOWN, UNKNOWN, UNLISTED, Hidden, causes_of, water
from benchmarks.hidden.missions import PILOTS
from benchmarks.hidden.nature import Nature
from benchmarks.hidden.pilots import random_steps
from benchmarks.hidden.sail import TICK, Truth, sail, ticks_of
from benchmarks.hidden.scene import Report, Scene
from benchmarks.hidden.talk import MODEST
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import hidden_of, main, write_voyage
from gateway.vessel_file import load_vessel
from tests.sim.simulated import on_floats

# what runs a diagnosis and scores it must call it; nothing of them sails
JUDGES = {
    "__main__.py", "run.py", "judge.py", "learned.py", "oracle.py", "twins.py", "score.py",
    "tables.py", "visible.py", "peers.py",
}  # fmt: skip
FOLDER = Path(__file__).resolve().parents[2] / "benchmarks" / "hidden"

EXAMPLES = {
    "steady_current": {"speed": 0.3, "direction": 1.0},
    "varying_current": {"speed": 0.3, "direction": 1.0, "period": 90.0, "phase": 0.4},
    "current_change": {
        "speed": 0.3,
        "direction": 1.0,
        "later_speed": 0.2,
        "later_direction": 4.0,
        "time": 10.0,
    },
    "wind_change": {
        "speed": 8.0,
        "direction": 2.0,
        "later_speed": 4.0,
        "later_direction": 5.0,
        "time": 10.0,
    },
    "steady_wind": {"speed": 8.0, "direction": 2.0},
    "inertial_force": {"force": 6.0, "direction": -1.0},
    "wave_motion": {"force": 15.0, "omega": 2.2, "direction": 0.5, "phase": 0.0},
    "crossing_waves": {"force": 10.0, "omega": 2.8, "direction": 2.5, "phase": 0.0},
    "cubic_drag": {"X_uuu": -12.0},
    "drag_growth": {"rate": 0.02},
    "payload_change": {"factor": 1.4, "time": 10.0},
    "cg_offset": {"x_g": -0.15},
    "cross_damping": {"Y_r": -8.0, "N_v": 6.0},
    "crossflow_drag": {"drag": 60.0},
    "hull_lift": {"Y_uv": -30.0, "Y_ur": 5.0, "N_uv": 8.0, "N_ur": -5.0},
    "towed_load": {"drag": 8.0, "x": -0.8},
    "thruster_lag": {"tau": 0.6},
    "command_delay": {"delay": 0.33},
    "thruster_misalignment": {"angle": 0.12},
    "thruster_deadband": {"width": 0.15},
    "thrust_curve": {"exponent": 1.4},
    "actuator_wiring": {},
    "thruster_imbalance": {"port_gain": 0.85},
    "reverse_loss": {"factor": 0.6},
    "thruster_fault": {"channel": 3.0, "gain": 0.6, "time": 10.0},
    "battery_sag": {"nominal": 17.5},
    "advance_loss": {"per_mps": 0.2},
    "astern_stall": {"per_mps": 0.8, "above": 0.1},
    "steering_lag": {"tau": 0.5},
    "steering_offset": {"angle": 0.1},
    "steering_scale": {"gain": 0.7},
    "steering_play": {"play": 0.08},
    "steering_rate": {"rate": 0.15},
    "thrust_scale": {"gain": 0.7},
    "lever_arm": {"gain": 0.6},
    "heading_offset": {"angle": 0.1},
    "compass_deviation": {"b": 0.1, "c": -0.05},
    "antenna_offset": {"x": 0.5, "y": 0.2},
    "velocity_latency": {"delay": 0.3},
    "yaw_rate_bias": {"bias": 0.02},
    "shoal": {"north": 0.0, "east": 0.0, "radius": 8.0, "gain": 1.0},
    "tether": {"north": 0.0, "east": 0.0, "slack": 1.0, "stiffness": 3.0},
    "shear_current": {"gradient": 0.02, "north": -10.0},
    "propeller_walk": {"share": 0.1},
    "stuttering_motor": {"channel": 1.0, "period": 7.0, "hold": 1.0},
    "bent_skeg": {"Y_uu": 6.0, "x": -0.7},
    "resistance_hump": {"height": 10.0, "speed": 1.0, "width": 0.25},
    "ventilation": {"speed": 0.8, "share": 0.5},
    "turning_loss": {"share": 0.6, "rate": 0.2},
    "wake_of_the_other": {"share": 0.3},
    "river_mouth": {"north": 0.0, "east": 0.0, "towards": 1.0, "width": 8.0, "speed": 0.5},
    "wind_shadow": {"force": 8.0, "towards": 2.0, "east": 0.0, "width": 3.0},
    "planing": {"speed": 0.8, "share": 0.5},
    "lopsided_turning": {"gain": 1.0},
    "stiff_turning": {"moment": 1.0},
    "weed": {"gain": 2.0, "period": 9.0, "holds": 3.0},
    "compass_lag": {"lag": 0.4},
    "thrust_gap": {"low": 0.1, "high": 0.6},
    "keel_stall": {"speed": 0.05, "share": 0.7},
    "turning_drag": {"X_rr": 60.0},
    "leeway_drag": {"X_vv": 300.0},
    "warming_up": {"share": 0.4, "seconds": 60.0},
    "eddy": {"north": 4.0, "east": 2.0, "radius": 8.0, "speed": 0.4},
    "squalls": {"force": 10.0, "towards": 2.0, "period": 9.0, "lasts": 3.0},
    "crossed_wash": {"share": 0.2, "x": -0.5},
    "gyro_gain": {"gain": 0.15},
    "log_gain": {"gain": 0.15},
    "tide": {"before": -0.2, "after": 0.3, "towards": 1.0, "turns": 10.0, "within": 4.0},
    "funnel": {"force": 10.0, "towards": 2.0, "north": 4.0, "east": 2.0, "radius": 8.0},
    "overheating": {"share": 0.4, "after": 10.0, "within": 4.0},
    "bank": {"suction": 10.0, "speed": 0.5, "north": 5.0, "width": 8.0},
    "compass_tilt": {"per_g": 4.0},
    "bottom_line": {"force": 10.0},
    "thrust_cap": {"share": 0.4},
    "slip_loss": {"share": 0.6, "speed": 0.1},
    "bow_rise": {"gain": 1.5, "speed": 0.5},
    "head_sea": {"gain": 1.5, "towards": 1.0},
    "leaking": {"more": 0.7, "seconds": 8.0},
    "listing": {"y": 0.1},
    "winch_cast": {"drag": 12.0, "x": -0.6, "period": 9.0, "lasts": 5.0},
    "undervoltage": {"share": 0.5, "volts": 16.5},
    "air_at_rest": {"share": 0.6, "speed": 0.7},
    "winding_weed": {"channel": 1.0, "share": 0.7, "period": 9.0},
    "ferry_wake": {
        "force": 20.0,
        "towards": 1.0,
        "speed": 4.0,
        "omega": 1.1,
        "rises": 1.1,
        "period": 15.0,
        "lasts": 8.0,
    },
    "loose_tarp": {"force": 10.0, "towards": 2.0, "x": 0.3},
    "steel_pier": {"angle": 0.3, "north": 4.0, "east": 2.0, "radius": 8.0},
    "aerator": {"north": 4.0, "east": 2.0, "radius": 8.0, "speed": 0.4},
    "own_wake": {"drag": 15.0, "seconds": 5.0},
    "one_way_board": {"gain": 2.5, "x": 0.2},
    "snaking_tow": {"pull": 6.0, "x": -0.6, "period": 7.0},
    "power_budget": {"share": 0.4},
    "hot_motors": {"share": 0.5, "load": 0.2, "seconds": 8.0},
    "notches": {"step": 0.3},
    "lily_field": {"north": 4.0, "east": 2.0, "radius": 8.0, "share": 0.7},
    "lying_across": {"moment": 1.3, "towards": 1.0},
    "seiche": {
        "speed": 0.4,
        "towards": 1.0,
        "period": 25.0,
        "length": 70.0,
        "north": 4.0,
        "east": 2.0,
    },
    "soft_iron": {"angle": 0.2, "at": 1.0},
}


@pytest.mark.slow
def test_a_sea_has_the_height_and_the_peak_that_were_asked_for():
    height, period = 0.2, 2.5
    sea = water.sea(height, period, 0.0, 0.0, 7.0)
    hull = BOATS["grebe"].hull._replace(length=1e-6, beam=1e-6, mass=1.0)
    time = np.arange(0.0, 6000.0, 0.1)
    push = np.array(
        [sea.push(Scene(t, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 12.0, hull), ()) for t in time]
    )
    assert np.abs(push[:, 1]).max() < 1e-9  # all of it runs ahead
    spectrum = np.abs(np.fft.rfft(push[:, 0] / 9.81)) ** 2 * 2.0 / len(time) ** 2  # of the slope
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(time), 0.1)
    peak = 2.0 * math.pi / period
    waves = omega > 0.5 * peak
    of_height = spectrum[waves] * (9.81 / omega[waves] ** 2) ** 2
    assert 4.0 * math.sqrt(of_height.sum()) == pytest.approx(height, rel=0.03)
    middle = np.exp(np.average(np.log(omega[waves]), weights=of_height))
    assert 1.0 < middle / peak < 1.4  # the tail lies above the peak


def sailed(boat: Boat, seconds: float, *hidden: Hidden, pilot: str = "excitation") -> Truth:
    """A voyage without noise."""
    nature = Nature(boat, causes_of(hidden))
    still = Report(*(np.zeros(ticks_of(seconds)) for _ in range(6)))
    chosen = PILOTS[pilot](boat, np.random.default_rng(3))
    return sail(nature, chosen, still, [1.0, -2.0, 0.7], seconds)


def boat_for(cause: str) -> str:
    """A boat on which a cause can act."""
    return "heron" if cause.startswith("steering") else "teal"


def tossed(nature: Nature) -> Truth:
    """Twenty seconds of random sticks, astern while running ahead among them."""
    still = Report(*(np.zeros(ticks_of(20.0)) for _ in range(6)))
    sticks = random_steps(np.random.default_rng(4), (-0.9, 1.0), 0.4, 21.0)
    return sail(nature, sticks, still, [0.0, 0.0, 0.0], 20.0)


@pytest.fixture(scope="module")
def plain_motion() -> dict[str, np.ndarray]:
    """What `tossed` does to a boat with nothing hidden."""
    return {name: tossed(Nature(FLEET[name])).motion for name in ("teal", "heron")}


def in_body(motion: np.ndarray) -> np.ndarray:
    """North, east, yaw, v_north, v_east, r -> north, east, yaw, u, v, r: (T, 6)."""
    c, s = np.cos(motion[:, 2]), np.sin(motion[:, 2])
    u, v = c * motion[:, 3] + s * motion[:, 4], c * motion[:, 4] - s * motion[:, 3]
    return np.column_stack([motion[:, :3], u, v, motion[:, 5]])


def simulated(tmp_path: Path, boat: Boat, truth: Truth, effects: str = "") -> np.ndarray:
    """The same pulses through `sim` with the boat's vessel file: (T, 6)."""
    file = tmp_path / "vessel.toml"
    file.write_text(vessel_toml(boat) + effects, encoding="utf-8")
    vessel = load_vessel(file)
    channels = [output.channel for output in boat.outputs]
    commands = vessel.commands(channels, truth.pulses.astype(float))
    start = in_body(truth.motion[:1])[0]
    states, _ = on_floats(vessel).simulate(commands, TICK, start)
    return states[0, :-1, :6]


def records(file: Path) -> list[tuple[int, Any]]:
    """Stamp [µs] and message of every frame, decoded by pymavlink; no byte is left over."""
    data, parser, out = file.read_bytes(), mavlink.MAVLink(None), []
    at = 0
    while at < len(data):
        length = 8 + 12 + data[at + 9]
        stamp = struct.unpack_from(">Q", data, at)[0]
        out.append((stamp, parser.decode(bytearray(data[at + 8 : at + length]))))
        at += length
    assert at == len(data)
    return out


def test_shares_no_code_with_what_it_tests() -> None:
    files = [f for f in sorted(FOLDER.rglob("*.py")) if f.name not in JUDGES]
    assert len(files) > 20
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {n.split(".")[0] for n in names} & {"sim", "gateway", "tests"}, file


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n in ("teal", "heron") else pytest.mark.slow) for n in FLEET],
)
def test_the_plain_boat_is_exactly_its_vessel_file(name: str, tmp_path: Path) -> None:
    truth = sailed(FLEET[name], 40.0)
    assert np.ptp(truth.motion[:, 3:], axis=0).min() > 0.05
    difference = simulated(tmp_path, FLEET[name], truth) - in_body(truth.motion)
    assert np.abs(difference).max() < 1e-3


def test_a_current_and_cubic_drag_are_those_of_the_catalogue(tmp_path: Path) -> None:
    current, drag = EXAMPLES["steady_current"], EXAMPLES["cubic_drag"]
    truth = sailed(
        BOATS["grebe"], 40.0, Hidden("steady_current", current), Hidden("cubic_drag", drag)
    )
    effects = (
        '\n[[effects]]\ntype = "steady_current"\nspeed = 0.3\ndirection = 1.0\n'
        '\n[[effects]]\ntype = "cubic_drag"\nX_uuu = -12.0\n'
    )
    difference = simulated(tmp_path, BOATS["grebe"], truth, effects) - in_body(truth.motion)
    assert np.abs(difference).max() < 1e-3


def test_only_the_boat_that_should_be_is_unstable() -> None:
    fast = {name for name, boat in FLEET.items() if boat.unstable_above() < boat.top_speed()}
    assert fast == {"teal"}
    assert BOATS["teal"].unstable_above() == pytest.approx(1.0, abs=0.1)


def test_every_cause_has_an_example() -> None:
    assert set(EXAMPLES) == {*KNOWN, *UNKNOWN, *UNLISTED}
    assert not set(KNOWN) & {*UNKNOWN, *UNLISTED}
    assert len(UNKNOWN) >= 4


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if k % 4 else ())
        for k, name in enumerate(EXAMPLES)
    ],
)
def test_every_cause_changes_what_is_reported(
    name: str, plain_motion: dict[str, np.ndarray]
) -> None:
    nature = Nature(FLEET[boat_for(name)], causes_of([Hidden(name, EXAMPLES[name])]))
    moved = tossed(nature)
    seen = nature.reported(Report(*moved.motion.T))
    reported = np.column_stack(np.broadcast_arrays(*seen))
    assert np.abs(reported - plain_motion[boat_for(name)]).max() > 0.01 or nature.latency > 0.0
    assert np.isfinite(reported).all()
    assert np.abs(moved.motion[:, 3:5]).max() < 3.0


def test_drag_only_takes_energy_out() -> None:
    boat = BOATS["teal"]
    nature = Nature(boat)
    h = boat.hull
    state = [0.0, 0.0, 0.3, 1.0, -0.4, 0.5, 0.0, 0.0]
    rates = nature.rates(0.0, state, [0.0, 0.0], 16.0)
    u, v, r = in_body(np.array([state[:6]]))[0, 3:]
    c, s = math.cos(0.3), math.sin(0.3)
    u_dot = c * rates[3] + s * rates[4] + r * v
    v_dot = c * rates[4] - s * rates[3] - r * u
    power = h.m11 * u * u_dot + h.m22 * v * v_dot + h.m33 * r * rates[5]
    loss = (
        (h.X_u + h.X_uu * abs(u)) * u**2
        + (h.Y_v + h.Y_vv * abs(v)) * v**2
        + (h.N_r + h.N_rr * abs(r)) * r**2
    )
    assert power == pytest.approx(loss, rel=1e-12)


def test_pulses_know_reversal() -> None:
    for boat in FLEET.values():
        for output in boat.outputs:
            assert output.command(output.pulse(0.4)) == pytest.approx(0.4, abs=2e-3)
            assert (output.pulse(0.4) < output.pulses[1]) == output.reversed


@pytest.mark.parametrize("name", ["teal", "heron", "dory"])
def test_more_steer_turns_to_starboard(name: str) -> None:
    circling = sailed(FLEET[name], 30.0, pilot="circles")
    assert circling.motion[-1, 2] - circling.motion[0, 2] > 1.3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["teal", "heron"])
@pytest.mark.parametrize("pilot", PILOTS)
def test_every_pilot_keeps_the_boat_moving(pilot: str, name: str) -> None:
    truth = sailed(FLEET[name], 60.0, pilot=pilot)
    speed = np.hypot(truth.motion[:, 3], truth.motion[:, 4])
    assert speed.mean() > 0.2
    assert np.ptp(truth.motion[:, 2]) > 0.5


def test_a_voyage_is_the_same_bytes_from_the_same_seed(tmp_path: Path) -> None:
    files = [tmp_path / f"{i}.tlog" for i in range(3)]
    for file, seed in zip(files, (5, 5, 6), strict=True):
        write_voyage(file, BOATS["grebe"], [], "excitation", seed, 10.0)
    first, again, other = (file.read_bytes() for file in files)
    assert first == again
    assert first != other


def test_motion_does_not_hang_on_the_last_bit_of_a_sine(monkeypatch: pytest.MonkeyPatch) -> None:
    exactly = sailed(BOATS["teal"], 40.0).motion
    for name in ("sin", "cos", "sqrt"):
        exact = getattr(math, name)
        monkeypatch.setattr(math, name, lambda x, f=exact: math.nextafter(f(x), 2.0))
    assert (sailed(BOATS["teal"], 40.0).motion == exactly).all()


def test_what_a_voyage_says(tmp_path: Path) -> None:
    file = tmp_path / "a.tlog"
    truth = write_voyage(file, BOATS["teal"], [], "excitation", 7, 60.0, MODEST)
    said = records(file)
    stamps = [stamp for stamp, _ in said]
    assert stamps == sorted(stamps)
    by: dict[str, list[Any]] = {}
    for _, message in said:
        by.setdefault(message.get_type(), []).append(message)
    for name, rate in MODEST.items():
        count = sum(m.get_srcSystem() == 1 for m in by[name])
        assert count == pytest.approx(68.0 * rate, rel=0.05, abs=2)
    parameters = {m.param_id: m.param_value for m in by["PARAM_VALUE"]}
    assert (parameters["SERVO1_FUNCTION"], parameters["SERVO3_FUNCTION"]) == (73.0, 74.0)
    assert (parameters["SERVO1_REVERSED"], parameters["SERVO3_REVERSED"]) == (0.0, 1.0)
    boat = [m for m in by["HEARTBEAT"] if m.get_srcSystem() == 1]
    assert {(m.type, m.autopilot) for m in boat} == {(11, 3)}
    assert sum(m.base_mode >= 128 for m in boat) == pytest.approx(60, abs=1)
    assert all(m.autopilot == 8 for m in by["HEARTBEAT"] if m.get_srcSystem() == 255)
    assert 0.01 < velocity_error(said, truth, age=0.0) < 0.04


def test_latency_makes_velocity_old(tmp_path: Path) -> None:
    hidden = Hidden("velocity_latency", {"delay": 0.4})
    truth = write_voyage(tmp_path / "a.tlog", BOATS["teal"], [hidden], "survey", 7, 60.0)
    said = records(tmp_path / "a.tlog")
    assert velocity_error(said, truth, age=0.4) < 0.04 < velocity_error(said, truth, age=0.0)


def velocity_error(said: list[tuple[int, Any]], truth: Truth, age: float) -> float:
    """Standard deviation of reported velocity against the truth `age` [s] before [m/s]."""
    local = [m for _, m in said if m.get_type() == "LOCAL_POSITION_NED"]
    boot = min(m.time_boot_ms for _, m in said if m.get_type() == "ATTITUDE") * 1e-3
    first = truth.time[0] + 0.25  # when the first stream starts
    times = np.array([m.time_boot_ms for m in local]) * 1e-3 - boot + first - age
    true = np.column_stack([np.interp(times, truth.time, c) for c in truth.motion[:, 3:5].T])
    return float((np.array([[m.vx, m.vy] for m in local]) - true).std())


def test_the_command_line_refuses_what_does_not_exist(tmp_path: Path) -> None:
    assert hidden_of("thruster_lag:tau=0.5") == Hidden("thruster_lag", {"tau": 0.5})
    for wrong in ("sea_monster:size=3", "thruster_lag:size=3"):
        with pytest.raises(SystemExit) as stopped:
            main([str(tmp_path / "x.tlog"), "--hidden", wrong, "--seconds", "1"])
        assert stopped.value.code == 2
        assert not (tmp_path / "x.tlog").exists()
