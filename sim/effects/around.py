"""A table over the distance from a place: its value, its knots, and the picture around it."""

from typing import Any

import numpy as np

from sim.effects.tables import KNOTS, along, between_nine, knot_shares
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Floats

VALUES_AT = [f"f{k}" for k in range(KNOTS)]
FINE = 25  # places along either side of the picture


@jitable
def at_distance(d: float, p: Any) -> float:
    """Value of the table at a distance from the place [m]."""
    return between_nine(
        along(d, 0.0, p.reach),
        p.at1, p.at2, p.at3, p.at4, p.at5, p.at6, p.at7,
        p.f0, p.f1, p.f2, p.f3, p.f4, p.f5, p.f6, p.f7, p.f8,
    )  # fmt: skip


def at_knots(p: FittedValues, scale: float) -> tuple[Floats, Floats, Floats]:
    """Distances (K,) [m], values there and half of their intervals (K,), `scale` for a one."""
    ends = np.array([p.ci95.get(key, (0.0, 0.0)) for key in VALUES_AT])
    values = scale * np.array([p[key] for key in VALUES_AT])
    return p["reach"] * knot_shares(p), values, 0.5 * scale * (ends[:, 1] - ends[:, 0])


def around(p: FittedValues, scale: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Ways north and east of the place (n,) [m], as far as the table reaches, the value there and
    half of its interval (n,).
    """
    away = np.linspace(-p["reach"], p["reach"], FINE)
    n, e = (x.ravel() for x in np.meshgrid(away, away, indexing="ij"))
    near = np.hypot(n, e) <= p["reach"]
    n, e = n[near], e[near]
    at, values, interval = at_knots(p, scale)
    d = np.hypot(n, e)
    return n, e, np.interp(d, at, values), np.interp(d, at, interval)
