"""Learned rhythm: what comes again and again, and goes.

    g(t) = 1 for `lasts` in each period P, else 0; flanks ½ (1 ± tanh(s / w))
    P = (`until` − `since`) / `times`
    acts 1 (push)    X, Y = A F g towards θ, turned to the heading
    acts 2 (thrust)  F_i → F_i (1 + A g) of one motor
    acts 3 (drag)    X = A g (X_u + X_uu |u|) u

since, until [s] where it comes for the first time and for the last, after the first sample; s [s]
the time from a flank, w [s] `width`; A `size`; F [N] the scale `full`; θ [rad] `direction`,
clockwise from north; i `thruster`, in the order of the vessel file; X_u, X_uu of the vessel, u
through the water [m/s]. Valid for: that day. It explains nothing: squalls, a motor that cuts out
and begins again, weed that is caught and lost look like this. Source: Leahy et al., Astrophysical
Journal 266, 1983 (epoch folding).

When it comes is told by what a model leaves, folded with every period that a recording holds four
times: the window of the period that takes most of it.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Kind,
    Parameter,
    ResidualForce,
    Scope,
    Shown,
    Values,
    circular_parameter,
)
from sim.effects.table_parameters import FULL
from sim.effects.tables import push_scale
from sim.effects.words import FittedValues, towards
from sim.jit import jitable
from sim.state import Floats, Wrench, to_body

PUSH, THRUST, DRAG = 1.0, 2.0, 3.0

# How it is looked for; all chosen, not measured.
SHORTEST_S = 5.0  # period: less is a sea
LEAST_TIMES = 4  # that a recording holds the longest
SLIP = 0.2  # of a period, over the recording, from one that is tried to the next
BINS, FINE_BINS = 24, 192  # of a period, at first and at last
SHORTEST, LONGEST = 0.08, 0.6  # of a period, that it may last
NEAR = 25  # periods about the best, at last
STARTS = 2  # of each kind
WIDTH_S = 0.3
LEAST_ROWS = 200


@jitable
def gate(time: float, p: Any) -> float:
    """g(t)."""
    period = np.maximum((p.until - p.since) / p.times, 0.1)
    middle = p.since + 0.5 * p.lasts
    turns = np.floor((time - middle) / period + 0.5)
    off = np.abs(time - middle - turns * period)  # from the middle of the nearest
    return 0.5 + 0.5 * np.tanh((0.5 * p.lasts - off) / p.width)


def force(flow: Flow, p: Any) -> Wrench:
    """Time, heading and velocity through the water -> X, Y, N [N, N, N m]."""
    size = p.size * gate(flow.time, p)
    push = 1.0 * (p.acts == PUSH) * p.full * size
    X, Y = to_body(push * np.cos(p.direction), push * np.sin(p.direction), flow.yaw)
    damping = (flow.body.X_u + flow.body.X_uu * np.abs(flow.u)) * flow.u
    return Wrench(X + 1.0 * (p.acts == DRAG) * size * damping, Y, 0.0)


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust, time -> thrust [N]."""
    hit = 1.0 * (p.acts == THRUST) * (drive.number + 1.0 == p.thruster)
    return F * (1.0 + hit * p.size * gate(flow.time, p))


class Window(NamedTuple):
    """A window of a period: what it takes of the missing force, in squares; the period, its begin
    and how long it lasts [s]; the size found, and the direction [rad] of a push.
    """

    taken: float
    period: float
    since: float
    lasts: float
    size: float
    direction: float


def _begun(vessel: Any, acts: float, motor: float, w: Window, length: float) -> Values:
    times = max(math.floor((length - w.since) / w.period), 1)
    return {
        "acts": acts, "thruster": motor, "since": w.since, "until": w.since + times * w.period,
        "times": float(times), "lasts": w.lasts, "width": WIDTH_S, "size": w.size,
        "direction": w.direction, "full": push_scale(vessel),
    }  # fmt: skip


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """The windows that take most of a push, of each motor's thrust, and of the hull's drag."""
    found = residual()
    time = found.time - found.time[0] if len(found.time) else found.time
    length = float(time[-1]) if len(time) else 0.0
    if len(time) < LEAST_ROWS or length < LEAST_TIMES * SHORTEST_S:
        window = Window(0.0, SHORTEST_S, 0.0, 0.3 * SHORTEST_S, 0.1, 0.0)
        return [_begun(vessel, PUSH, 1.0, window, max(length, 2.0 * SHORTEST_S))]
    offset = float(found.time[0])
    thin = slice(None, None, max(int(SHORTEST_S / BINS / max(length / len(time), 1e-9)), 1))
    full, own = push_scale(vessel), vessel.dynamics
    u, body = found.nu[thin, 0], found.body[thin]
    damping = (own.X_u + own.X_uu * np.abs(u)) * u
    looks = [(PUSH, 1.0, found.force[thin] / full, np.ones(len(u)), np.zeros(1))]
    looks += [(DRAG, 1.0, *_of(body[:, :1], damping[:, None]))]
    size = body.std(axis=0) + 1e-9
    for i, drive in enumerate(vessel.thrusters):
        c = found.commands[thin, i]
        F = np.where(c > 0.0, drive.thrust[1], -drive.thrust[0]) * c
        arm = np.array([1.0, -drive.position[1]]) / size[[0, 2]]
        looks.append((THRUST, i + 1.0, *_of(body[:, [0, 2]] / size[[0, 2]], F[:, None] * arm)))
    starts: list[Values] = []
    for acts, motor, product, weight, mean in looks:
        for window in _best_windows(time[thin], product - mean * weight[:, None], weight):
            moved = window._replace(since=window.since + offset)
            starts.append(_begun(vessel, acts, motor, moved, offset + length))
    return starts


def _of(missing: Floats, basis: Floats) -> tuple[Floats, Floats, Floats]:
    """Of a missing force (T, C) and one with which it may go (T, C): product (T, 1), square (T,),
    and the share that is there all the time (1,).
    """
    product, square = np.sum(missing * basis, axis=1), np.sum(basis**2, axis=1)
    return product[:, None], square, np.array([product.sum() / max(float(square.sum()), 1e-12)])


def _best_windows(time: Floats, product: Floats, weight: Floats) -> list[Window]:
    """Those that take most, no two of one period; times (T,) from 0, products (T, C), weights."""
    length = float(time[-1])
    count = math.ceil(length / SLIP * (1.0 / SHORTEST_S - LEAST_TIMES / length))
    rates, apart = np.linspace(LEAST_TIMES / length, 1.0 / SHORTEST_S, max(count, 2), retstep=True)
    windows = sorted((_window(time, product, weight, 1.0 / f, BINS) for f in rates), reverse=True)
    chosen: list[Window] = []
    for window in windows:
        if len(chosen) < STARTS and not any(_is_like(window, w, apart) for w in chosen):
            chosen.append(window)
    near = np.linspace(-1.0, 1.0, NEAR) * apart
    return [
        max(_window(time, product, weight, 1.0 / (1.0 / w.period + df), FINE_BINS) for df in near)
        for w in chosen
    ]


def _is_like(one: Window, other: Window, apart: float) -> bool:
    """Whether it is a neighbour, of rates so far apart [1/s], or the period of one is some of the
    other's.
    """
    ratio = max(one.period, other.period) / min(one.period, other.period)
    near = abs(1.0 / one.period - 1.0 / other.period) < 1.5 * apart
    return near or abs(ratio - round(ratio)) < 0.02


def _window(time: Floats, product: Floats, weight: Floats, period: float, bins: int) -> Window:
    """The best of one period, of which so many bins are told apart."""
    at = (time / period % 1.0 * bins).astype(np.int64)
    columns = np.stack([np.bincount(at, part, bins) for part in (*product.T, weight)], axis=1)
    none = np.zeros((1, columns.shape[1]))
    sums = np.cumsum(np.concatenate([none, columns, columns]), axis=0)
    begin = np.arange(bins)[:, None]
    count = np.arange(round(SHORTEST * bins), round(LONGEST * bins) + 1)[None]
    inside = sums[begin + count] - sums[begin]  # (bins, lengths, C + 1)
    part, share = inside[..., :-1], np.maximum(inside[..., -1], 1e-12)
    whole = max(float(weight.sum()), 1e-12)
    beside = whole / np.maximum(whole - share, 0.1 * whole)  # what is always there is not counted
    taken = np.sum(part**2, axis=-1) / share * beside
    b, k = np.unravel_index(np.argmax(taken), taken.shape)
    per_weight = part[b, k] / share[b, k] * beside[b, k]
    size, angle = float(per_weight[0]), 0.0
    if len(per_weight) == 2:
        size, angle = math.hypot(*per_weight), math.atan2(per_weight[1], per_weight[0])
    step = float(period) / bins
    return Window(
        float(taken[b, k]), float(period), float(b) * step, float(count[0, k]) * step, size, angle
    )


def mismatch(vessel: Any, values: Values) -> str:
    """Why it is no rhythm of that vessel; empty where it is."""
    count = len(vessel.thrusters)
    if values["acts"] == THRUST and values["thruster"] > count:
        return f"thruster = {values['thruster']:g}: the vessel has {count}"
    if not values["until"] > values["since"]:
        return "until must be later than since"
    return ""


def phase_at(time: Floats, north: Floats, east: Floats, p: Values) -> Floats:
    """Times (T,) [s] -> how far the period has gone there (T,) [rad, 0 … 2π]."""
    period = (p["until"] - p["since"]) / p["times"]
    return np.asarray(2.0 * np.pi * ((time - p["since"]) / period % 1.0))


def evidence_axis(values: Values) -> EvidenceAxis:
    """The missing force along a push, else ahead, over the period."""
    axis = ForceAxis.ALONG if values["acts"] == PUSH else ForceAxis.SURGE
    return EvidenceAxis(axis, "phase", phase_at)


def in_words(p: FittedValues) -> str:
    """What comes, how often, for how long and how much."""
    period = (p["until"] - p["since"]) / p["times"]
    when = f"every {period:.3g} s, for {p['lasts']:.2g} s"
    if p["acts"] == PUSH:
        push = p.size("size", "N", p["full"])
        way = towards(p["direction"] + (math.pi if p["size"] < 0.0 else 0.0))
        return f"a push over the ground that comes and goes {when}: {push} towards {way}"
    percent = f"{p.size('size', '%', 100.0)} {'less' if p['size'] < 0.0 else 'more'}"
    what = f"thrust of thruster {p['thruster']:.0f}" if p["acts"] == THRUST else "drag"
    return f"a {what} that changes and comes back {when}: {percent}"


EFFECT = Effect(
    name="learned_rhythm",
    scope=Scope.VOYAGE,
    force=force,
    thrust=thrust,
    parameters=(
        Parameter(
            "acts", "1", lower=1.0, upper=3.0, start=1.0, kind=Kind.CHOICE,
            description="1 a push, 2 a motor's thrust, 3 drag",
        ),
        Parameter(
            "thruster", "1", lower=1.0, upper=16.0, start=1.0, kind=Kind.CHOICE,
            description="1, 2, … in the order of the vessel file",
        ),
        Parameter("since", "s", lower=-1e5, upper=1e5, start=0.0, scale=0.3,
                  description="comes for the first time, after the first sample"),
        Parameter("until", "s", lower=-1e5, upper=1e5, start=60.0, scale=0.3,
                  description="comes for the last time"),
        Parameter("times", "1", lower=1.0, upper=1e5, start=6.0, kind=Kind.FIXED,
                  description="periods between the two"),
        Parameter("lasts", "s", lower=0.1, upper=1e4, start=3.0, scale=0.3),
        Parameter("width", "s", lower=0.05, upper=60.0, start=WIDTH_S, kind=Kind.FIXED,
                  description="of its flanks"),
        Parameter("size", "1", lower=-20.0, upper=20.0, start=0.0, scale=0.1, neutral=0.0,
                  description="share of the scale, of the thrust or of the drag"),
        circular_parameter("direction", "of a push, clockwise from north", sided=True),
        FULL,
    ),
    looks_like="comes and goes, always after the same time",
    shown_by=(Shown.CHANGE,),
    evidence=evidence_axis,
    search=search,
    mismatch=mismatch,
    in_words=in_words,
    example={
        "acts": 2.0, "thruster": 1.0, "since": 3.0, "until": 123.0, "times": 12.0, "lasts": 3.0,
        "width": WIDTH_S, "size": -1.0, "direction": 0.0, "full": 100.0,
    },
    pattern="thruster_fault",
    acts_when={"force": {"acts": (PUSH, DRAG)}, "thrust": {"acts": (THRUST,)}},
)  # fmt: skip
