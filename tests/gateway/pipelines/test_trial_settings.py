"""What trials assume of sensors: the yaw rate is the gyro's, not that of a wandering compass."""

import numpy as np

from gateway.estimation.events import join, make_events
from gateway.estimation.names import Kind
from gateway.estimation.settings import FilterSettings
from gateway.estimation.smoother import smooth
from gateway.offline.trials import AS_REPORTED
from tests.gateway.estimation.boat import gauss_markov, weaving_boat

FAST, SLOW = 0.02, 0.04  # s between messages
LIVE = FilterSettings(heading_error_rad=1e-3)


def yaw_rate_error(settings: FilterSettings, seed: int) -> float:
    """Root mean square of means over 0.4 s [rad/s], a compass that wanders by 0.7° in a minute."""
    rng = np.random.default_rng(seed)
    truth = weaving_boat(rng, 80.0)
    fast, slow = np.arange(0.5, 79.0, FAST), np.arange(0.5, 79.0, SLOW)
    now, then = truth.at(fast), truth.at(slow)
    yaw = now[:, 2] + gauss_markov(rng, 0.012, 60.0, fast)
    c, s = np.cos(then[:, 2]), np.sin(then[:, 2])
    velocity = np.stack([c * then[:, 3] - s * then[:, 4], s * then[:, 3] + c * then[:, 4]], 1)
    rate = now[:, 5] + rng.normal(0.0, 0.002, len(fast))
    events = join([
        make_events(Kind.YAW, fast, yaw, settings.white_std(Kind.YAW, "ATTITUDE")),
        make_events(Kind.YAW_RATE, fast, rate, settings.white_std(Kind.YAW_RATE, "ATTITUDE")),
        make_events(
            Kind.VELOCITY, slow, velocity + rng.normal(0.0, 0.02, velocity.shape),
            settings.white_std(Kind.VELOCITY, "LOCAL_POSITION_NED"),
        ),
    ])  # fmt: skip
    grid = np.arange(5.0, 74.99, 0.1)
    found = smooth(events[np.argsort(events.time_s, kind="stable")], grid, settings)
    error = (found.nu[:, 2] - truth.at(grid)[:, 5])[:696].reshape(-1, 4).mean(axis=1)
    return float(np.sqrt(np.mean(error**2)))


def test_a_wandering_compass_hardly_touches_the_yaw_rate():
    ours = np.mean([yaw_rate_error(AS_REPORTED, seed) for seed in range(3)])
    taken_as_white = np.mean([yaw_rate_error(LIVE, seed) for seed in range(3)])
    assert ours < 0.001
    assert ours < 0.5 * taken_as_white
