"""Actuator wiring: a plug in the wrong socket, or a motor that runs the wrong way round.

    c_i = s_i c_j,   j = digit i of `order`
    s_i = −1 where i is a digit of `reversed`, else 1

Actuators count from 1 as in the vessel file, thrusters first. order = 21: the first does what was
meant for the second, and the second what was meant for the first; order = 0: each its own.
reversed = 2: the second runs the wrong way round; 12: both; 0: none. Valid for: up to nine
actuators, as many digits in `order` as there are actuators. Source: ArduPilot documentation, Rover,
motor and servo configuration (checks of order and direction).
"""

from typing import NamedTuple

import numpy as np

from sim.effects.effect import Effect, Kind, Parameter, Scope

MOST = 9  # actuators: one decimal digit each


class Parameters(NamedTuple):
    order: float
    reversed: float


def wiring(commands: tuple[float, ...], place: float, p: Parameters) -> float:
    """All commands -> the one that the actuator at `place` (0, 1, …) gets [−1 … 1]."""
    digit = np.floor(p.order / 10.0 ** (len(commands) - 1 - place)) % 10.0
    source = digit - 1.0 + (digit == 0.0) * (place + 1.0)
    heard = 0.0 * place
    for i in range(len(commands)):
        heard = heard + (source == i) * commands[i]
    turned = 0.0 * p.reversed
    for k in range(MOST):
        turned = turned + (np.floor(p.reversed / 10.0**k) % 10.0 == place + 1.0)
    return heard * (1.0 - 2.0 * np.minimum(turned, 1.0))


EFFECT = Effect(
    name="actuator_wiring",
    scope=Scope.BOAT,
    wiring=wiring,
    parameters=(
        Parameter("order", "-", lower=0.0, upper=987654321.0, start=0.0, scale=1.0,
                  kind=Kind.CHOICE, neutral=0.0,
                  says="one digit per actuator: whose command it gets; 0: its own, all of them"),
        Parameter("reversed", "-", lower=0.0, upper=123456789.0, start=0.0, scale=1.0,
                  kind=Kind.CHOICE, neutral=0.0,
                  says="digits: the actuators that run the wrong way round; 0: none"),
    ),
    looks_like="turns to the wrong side, or goes astern, or turns when it should go straight on",
)  # fmt: skip
