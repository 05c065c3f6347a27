"""Errors that follow the commands: a made delay is found, noise, gain and blur are not one."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from sim.comparison.compare import compare
from sim.comparison.independence import MAX_LAG, independence, independence_of, whitening_filter
from sim.model import Model
from sim.state import Floats
from tests.sim.voyages import WAM_V, commands, simulated, trial_of

STEP, COUNT = 0.1, 4000


def held(seed: int, count: int = COUNT) -> Floats:
    """Forces (n, 3) as commands are: held for 2 to 8 s."""
    drive = commands(count * STEP, STEP, seed)
    ahead, turn = drive.sum(axis=1) * 90.0, (drive[:, 0] - drive[:, 1]) * 63.0
    return np.column_stack([ahead, np.zeros(len(ahead)), turn])


def noise(seed: int, count: int = COUNT, colour: float = 3.0) -> Floats:
    """Errors (n, 3) that hang together over some steps."""
    white = np.random.default_rng(seed).standard_normal((count, 3))
    return np.asarray(5.0 * np.sqrt(colour) * gaussian_filter1d(white, colour, axis=0))


def late(forces: Floats, steps: int) -> Floats:
    moved = np.vstack([np.repeat(forces[:1], steps, axis=0), forces[:-steps]])
    return moved - forces


def test_noise_follows_nothing() -> None:
    for seed in range(20):
        found = independence_of([noise(seed)], [held(seed)], STEP)
        assert found.description == ""


def test_independent_series_lie_in_the_band() -> None:
    inside = [
        np.mean(np.abs(pair.correlation) <= found.band)
        for seed in range(20)
        for found in [independence_of([noise(seed, colour=1.0)], [held(seed)], STEP)]
        for pair in found.pairs
    ]
    assert np.mean(inside) > 0.97


@pytest.mark.parametrize("steps", [2, 3, 6, 10])
def test_a_delay_is_found_at_its_lag(steps: int) -> None:
    forces = held(3)
    found = independence_of([noise(3) + late(forces, steps)], [forces], STEP)
    for pair in found.pairs:
        assert pair.delay == pytest.approx(steps * STEP, rel=0.25)
        assert np.argmax(pair.correlation) - MAX_LAG == steps
    assert "a delay or lag is missing" in found.description


def test_velocities_that_come_late_while_the_turn_rate_is_in_time_may_be_the_receiver() -> None:
    forces = held(3)
    ahead = forces * [1.0, 1.0, 0.0]
    found = independence_of([noise(3) + late(ahead, 3)], [forces], STEP)
    assert [pair.error for pair in found.pairs if pair.delay > 0.0] == ["u"]
    assert "or reported velocities come late (velocity_latency)" in found.description
    found = independence_of([noise(3) + late(forces, 3)], [forces], STEP)
    assert "velocity_latency" not in found.description  # the boat itself turns late


@pytest.mark.parametrize("thrust", [0.4, 0.8, 1.25, 2.5])
def test_thrust_of_another_size_is_late_by_as_much(thrust: float) -> None:
    forces = held(3)
    found = independence_of([noise(3) + thrust * late(forces, 3) + (thrust - 1.0) * forces],
                            [forces], STEP)  # fmt: skip
    for pair in found.pairs:
        assert pair.delay == pytest.approx(0.3, rel=0.25)


@pytest.mark.parametrize("thrust", [-1.0, -0.3, 0.0, 0.2])
def test_of_thrust_that_hardly_comes_or_is_reversed_no_delay_is_told(thrust: float) -> None:
    forces = held(3)
    errors = 0.01 * noise(3) + thrust * late(forces, 3) + (thrust - 1.0) * forces
    assert independence_of([errors], [forces], STEP).description == ""


@pytest.mark.parametrize("thrust", [0.4, 0.8, 1.25, 2.5])
def test_a_wrong_scale_is_no_delay_beside_streams_that_are_apart_by_less_than_a_step(
    thrust: float,
) -> None:
    """Thrust that comes 0.08 s late, as of a right model; it is 0.1 s of thrust × 1.25."""
    forces = held(3)
    apart = 0.2 * forces + 0.8 * (forces + late(forces, 1))
    found = independence_of([0.3 * noise(3) + thrust * apart - forces], [forces], STEP)
    assert found.description == ""


def test_a_lag_is_found_too() -> None:
    forces, tau = held(4), 0.5
    slow = np.empty_like(forces)
    slow[0] = forces[0]
    for k in range(1, len(forces)):
        slow[k] = slow[k - 1] + (forces[k] - slow[k - 1]) * STEP / tau
    found = independence_of([0.3 * noise(4) + slow - forces], [forces], STEP)
    assert found.pairs[0].delay == pytest.approx(tau, rel=0.3)


def test_a_wrong_scale_is_no_delay() -> None:
    forces = held(5)
    for scale in (-0.3, 0.3):
        assert independence_of([noise(5) + scale * forces], [forces], STEP).description == ""


def test_the_blur_of_a_smoother_is_no_delay() -> None:
    forces = held(6)
    blurred = np.asarray(gaussian_filter1d(forces, 3.0, axis=0))
    assert independence_of([noise(6) + blurred - forces], [forces], STEP).description == ""


def test_an_answer_of_the_autopilot_is_no_delay() -> None:
    """Commands that follow the errors show at negative lags."""
    errors = noise(7)
    forces = held(7)
    forces[3:] += 2.0 * errors[:-3]
    found = independence_of([errors], [forces], STEP)
    assert np.argmax(found.pairs[0].correlation) - MAX_LAG < 0
    assert found.description == ""


def test_stretches_do_not_run_into_each_other() -> None:
    forces, errors = held(8), noise(8)
    errors = errors + late(forces, 3)
    cut = [slice(0, 1500), slice(1700, 4000)]
    found = independence_of([errors[s] for s in cut], [forces[s] for s in cut], STEP)
    assert found.pairs[0].delay == pytest.approx(0.3, rel=0.25)


def test_whitening_leaves_no_colour() -> None:
    rng, x = np.random.default_rng(1), np.zeros(20000)
    for k in range(1, len(x)):
        x[k] = 0.9 * x[k - 1] + rng.standard_normal()
    a = whitening_filter([x])
    assert a[:2] == pytest.approx([1.0, -0.9], abs=0.03)
    assert np.abs(a[2:]).max() < 0.05


def test_a_trial_sailed_with_late_commands_says_so() -> None:
    trial, steps = simulated(WAM_V, 300.0), 6
    model, drive = Model.of(WAM_V), (trial.pwm - 1500.0) / 400.0
    _, reports = model.simulate(np.vstack([np.repeat(drive[:1], steps, axis=0), drive]), trial.dt)
    motion = reports[0, steps : steps + len(drive)]
    motion = motion + 1e-4 * np.random.default_rng(2).standard_normal(motion.shape)
    after = trial_of(
        motion[:, :3], motion[:, 3:6], motion[:, 6:], np.roll(drive, 0, axis=0), trial.dt,
        np.diag(np.full(9, 1e-8)),
    )  # fmt: skip
    on_time = independence(after, model)
    assert on_time is not None
    late_by = np.vstack([drive[steps:], np.repeat(drive[-1:], steps, axis=0)])
    early = trial_of(
        motion[:, :3], motion[:, 3:6], motion[:, 6:], late_by, trial.dt, np.diag(np.full(9, 1e-8))
    )
    (found,) = compare(early, [model])
    assert found.independence is not None
    ahead = found.independence.pairs[0].delay - on_time.pairs[0].delay
    assert ahead == pytest.approx(steps * trial.dt, rel=0.25)
    said = found.to_dict()["independence"]
    assert "a delay or lag is missing" in said["says"]
    assert len(said["correlations"][0]["correlation"]) == 2 * MAX_LAG + 1


def test_a_short_trial_says_nothing() -> None:
    assert independence(simulated(WAM_V, 20.0), Model.of(WAM_V)) is None
