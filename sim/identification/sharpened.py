"""Commands that can be shifted by part of a row without becoming rounder.

    c'_k = c_k − κ (c_{k+1} − 2 c_k + c_{k−1}),     κ = ½ f (1 − f)

A shift by the share f of a row takes f of one mean and 1 − f of its neighbour: it spreads each
change by √(f (1 − f)) rows. Taken for the boat's own sluggishness that makes a hull turn in a
third of a per cent too quickly. κ takes the second moment of that spread out again.
"""

from dataclasses import replace

import numpy as np

from sim.model import InputTable


def spread_by(shift: float, dt: float) -> float:
    """κ of a shift [s]."""
    share = shift / dt % 1.0
    return 0.5 * share * (1.0 - share)


def sharpened(inputs: InputTable, kappa: float) -> InputTable:
    """The same inputs with commands that make up for the spread."""
    commands = np.diff(inputs.total, axis=1)
    bend = np.zeros_like(commands)
    bend[:, 1:-1] = commands[:, 2:] - 2.0 * commands[:, 1:-1] + commands[:, :-2]
    total = np.zeros_like(inputs.total)
    np.cumsum(commands - kappa * bend, axis=1, out=total[:, 1:])
    return replace(inputs, total=total)
