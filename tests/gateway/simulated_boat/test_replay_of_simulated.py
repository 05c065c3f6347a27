"""A simulated boat through ingest and replay: its own model explains it, another does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.config import Settings, ZenohSettings
from gateway.ingest.log import choose_boat
from gateway.ingest.mapping import actuators
from gateway.ingest.open import open_log
from gateway.offline.replay import ReplayOptions, replay
from gateway.offline.vessel import init_vessel
from gateway.simulated_boat import FAST, THIN, SimulatedBoatSettings
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.vessel_file import load_vessel
from sim.diagnosis.fit_problem import neutral_values
from sim.effects.catalogue import EFFECTS
from sim.vessel import AddedEffect, Servo
from tests.gateway.simulated_boat.frames import frames_of, log_of, records
from tests.sim.vessels import VALUES

VESSELS = Path(__file__).resolve().parents[3] / "configs/vessels"
BOAT = load_vessel(VESSELS / "demo_boat.toml")
KNOWN = {effect.name: effect for effect in EFFECTS}
QUIET = ReplayOptions(settings=Settings(zenoh=ZenohSettings(publish=False)))


def missing(folder, truth, model, seconds=60.0, **settings):
    """Missing force of the model on a voyage of the truth: root mean square (3,) [N, N, N m]."""
    boat = SimulatedBoat(truth, SimulatedBoatSettings(**{"rates": FAST, **settings}))
    path = folder / "simulated.tlog"
    path.write_bytes(records(frames_of(boat, seconds)))
    return replay(path, model, options=QUIET).missing


@pytest.mark.parametrize("rates", [FAST, THIN], ids=["fast", "thin"])
def test_the_true_vessel_misses_little(tmp_path, rates):
    assert np.all(missing(tmp_path, BOAT, BOAT, rates=rates) < (6.0, 8.0, 4.0))


MISSED = (("steady_current", 1, 15.0), ("cubic_drag", 0, 6.0), ("heading_offset", 1, 12.0))


def with_others_off(name):
    """One of these effects, the others at values that do nothing: all share a compiled kernel."""
    effects = [KNOWN[other] for other, _, _ in MISSED]
    return tuple(
        AddedEffect(e, VALUES[name] if e.name == name else neutral_values(e)) for e in effects
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "axis", "at_least"), MISSED)
def test_an_effect_is_missed_and_found_again_where_the_model_has_it(tmp_path, name, axis, at_least):
    truth = replace(BOAT, effects=with_others_off(name))
    without, within = missing(tmp_path, truth, BOAT), missing(tmp_path, truth, truth)
    assert without[axis] > at_least
    assert within[axis] < 0.6 * without[axis]


@pytest.mark.usefixtures("plain_laws")
@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=() if p.stem == "steered" else pytest.mark.slow)
     for p in sorted(VESSELS.glob("*.toml"))],
    ids=lambda p: p.stem,
)  # fmt: skip
def test_a_first_vessel_comes_from_what_the_boat_says_of_its_outputs(tmp_path, path):
    vessel = load_vessel(path)
    log = tmp_path / "simulated.tlog"
    log.write_bytes(records(frames_of(SimulatedBoat(vessel), 5.0)))
    init_vessel(open_log(log), tmp_path / "first.toml", None, {})
    first = load_vessel(tmp_path / "first.toml")
    assert {a.servo for a in first.thrusters} == {a.servo for a in vessel.thrusters}
    assert {a.servo for a in first.rudders} == {a.servo for a in vessel.rudders}


def test_odd_servos_are_told_as_they_are():
    odd = Servo(9, (1000.0, 1480.0, 1950.0), reversed=True)
    left, right = BOAT.thrusters
    vessel = replace(BOAT, thrusters=(replace(left, servo=odd), right))
    log = log_of(frames_of(SimulatedBoat(vessel), 5.0))
    found = actuators(log.parameters(choose_boat(log)))
    assert {(a.channel, a.pwm, a.reversed) for a in found} == {
        (9, (1000.0, 1480.0, 1950.0), True),
        (right.servo.channel, right.servo.pwm, False),
    }


def test_sides_are_told_apart(tmp_path):
    log = log_of(frames_of(SimulatedBoat(BOAT), 5.0))
    kinds = [a.kind.value for a in actuators(log.parameters(choose_boat(log)))]
    assert kinds == ["throttle left", "throttle right"]


def test_the_firmware_says_that_it_is_no_real_boat():
    log = log_of(frames_of(SimulatedBoat(BOAT), 5.0))
    assert "played" in log.firmware(choose_boat(log))
