"""Trials for identification: simulated motion under errors that wander, and careless vessels."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from sim.identification import BASE
from sim.model import Model
from sim.trial import Trial
from sim.vessel import Vessel

DT = 0.1


def noisy(vessel: Vessel, seconds: float, seed: int = 1, steering: float = 0.4) -> Trial:
    """Random steps for so long; velocities off by wandering errors like a receiver's."""
    rng = np.random.default_rng(seed)
    steps = int(seconds / DT)
    drive = np.empty((steps, 2))
    row = 0
    while row < steps:
        ahead, turn = rng.uniform(-0.3, 0.95), steering * rng.uniform(-1.0, 1.0)
        length = int(rng.uniform(1.0, 6.0) / DT)
        drive[row : row + length] = np.clip([ahead + turn, ahead - turn], -1.0, 1.0)
        row += length
    _, reports = Model.of(vessel).simulate(drive, DT)
    motion = reports[0, :steps]
    error = np.stack(
        [wander(std, tau, steps, rng) for std, tau in ((0.02, 2.0), (0.02, 2.0), (0.003, 0.4))], 1
    )
    variance = np.diag([0.1, 0.1, 1e-4, 4e-4, 4e-4, 9e-6, 1e-2, 1e-2, 1e-3])
    return Trial(
        name="voyage", time=DT * np.arange(steps), eta=motion[:, :3], nu=motion[:, 3:6] + error,
        nu_dot=motion[:, 6:], covariance=np.tile(variance, (steps, 1, 1)),
        channels=(1, 2), pwm=1500.0 + 400.0 * drive, voltage=np.full(steps, np.nan),
        wind=np.full((steps, 2), np.nan), usable=np.ones(steps, bool),
    )  # fmt: skip


def wander(std: float, tau: float, steps: int, rng: np.random.Generator) -> np.ndarray:
    """A first-order Gauss–Markov error (steps,)."""
    stay = np.exp(-DT / tau)
    shocks = rng.normal(0.0, std * np.sqrt(1.0 - stay**2), steps)
    shocks[0] = rng.normal(0.0, std)
    return np.asarray(lfilter([1.0], [1.0, -stay], shocks))


def off(vessel: Vessel, *names: str) -> Vessel:
    """The vessel with numbers that are a tenth too large and too small in turn."""
    changed = {
        name: getattr(vessel.dynamics, name) * (1.1 if i % 2 else 0.9)
        for i, name in enumerate(names or BASE)
    }
    return replace(vessel, dynamics=replace(vessel.dynamics, **changed))
