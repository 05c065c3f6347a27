"""The hull is not what the file says: drag, lift, mass, what it tows."""

import math
from collections.abc import Callable, Mapping, Sequence

from benchmarks.hidden.boats import Hull
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.scene import Push, Scene


def cubic_drag(X_uuu: float) -> Cause:
    """Wave-making: X = X_uuu u³."""
    return Cause(push=lambda s, thrusts: Push(X_uuu * s.u * s.u * s.u, 0.0, 0.0))


def drag_growth(rate: float) -> Cause:
    """Weed gathers: surge drag × (1 + rate t)."""

    def grown(h: Hull, time: float) -> Hull:
        more = 1.0 + rate * max(time, 0.0)
        return h._replace(X_u=h.X_u * more, X_uu=h.X_uu * more)

    return Cause(hull=grown)


def payload_change(factor: float, time: float) -> Cause:
    """From `time` [s] on, and within two seconds, everything weighs `factor` times as much."""

    def loaded(h: Hull, now: float) -> Hull:
        f = 1.0 + (factor - 1.0) * min(max((now - time) / 2.0, 0.0), 1.0)
        return h._replace(mass=h.mass * f, m11=h.m11 * f, m22=h.m22 * f, m33=h.m33 * f)

    return Cause(hull=loaded)


def cg_offset(x_g: float) -> Cause:
    """The centre of gravity lies `x_g` [m] ahead of the origin."""
    return Cause(hull=lambda h, time: h._replace(x_g=x_g))


def cross_damping(Y_r: float, N_v: float) -> Cause:
    """Turning pushes sideways and drifting turns: Y = Y_r r, N = N_v v."""
    return Cause(push=lambda s, thrusts: Push(0.0, Y_r * s.r, N_v * s.v))


def crossflow_drag(drag: float) -> Cause:
    """Twenty strips from bow to stern, each dragged by the water that crosses it [N s²/m²].

    What slipping or turning alone does is in Y_vv and N_rr already.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        length, Y, N = s.hull.length, 0.0, 0.0
        for i in range(20):
            x = length * ((i + 0.5) / 20.0 - 0.5)
            both, slip, turn = s.v + x * s.r, s.v, x * s.r
            crossed = abs(both) * both - abs(slip) * slip - abs(turn) * turn
            Y -= drag * crossed / 20.0
            N -= x * drag * crossed / 20.0
        return Push(0.0, Y, N)

    return Cause(push=push)


def hull_lift(Y_uv: float, Y_ur: float, N_uv: float, N_ur: float) -> Cause:
    """Skegs and demihulls lift: forces ∝ u v and u r."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        return Push(0.0, s.u * (Y_uv * s.v + Y_ur * s.r), s.u * (N_uv * s.v + N_ur * s.r))

    return Cause(push=push)


def towed_load(drag: float, x: float) -> Cause:
    """A drogue on a bridle at `x`: −drag |V| V with V of that point [N s²/m²]."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        u, v = s.u, s.v + x * s.r
        pull = -drag * math.hypot(u, v)
        return Push(pull * u, pull * v, x * pull * v)

    return Cause(push=push)


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        cubic_drag, drag_growth, payload_change, cg_offset, cross_damping, crossflow_drag,
        hull_lift, towed_load,
    )
}  # fmt: skip
