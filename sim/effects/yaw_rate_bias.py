"""Yaw-rate bias: the gyro reads a constant rate too much.

    reported r = r + bias        bias [rad/s]

Valid for: hours of a MEMS gyro in even temperature; heading is not touched: what the gyro reads too
much its sum turns beyond the heading. Source: Groves, Principles of GNSS, Inertial and Multisensor
Integrated Navigation Systems, 2nd ed. 2013, §4.4.1.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.body import Report
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Values
from sim.effects.words import DEG, FittedValues
from sim.state import Eta, Nu

PLAIN = 0.01  # rad/s: of less an estimate of the heading may have taken a part
LEAST_SHARE = 0.3  # of a bias that the heading has to show


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a biased gyro reports it."""
    return Report(
        report.north,
        report.east,
        report.yaw,
        report.u,
        report.v,
        report.r + p.bias,
        report.u_dot,
        report.v_dot,
        report.r_dot,
    )


def disbelieved(values: Values, trials: Sequence[Any]) -> str:
    """Why a bias cannot be true of these trials: the heading goes with the gyro."""
    bias = values["bias"]
    if abs(bias) < PLAIN or any(beyond_heading(t) / bias > LEAST_SHARE for t in trials):
        return ""
    apart = max((beyond_heading(t) for t in trials), key=abs, default=0.0)
    return (
        f"a bias of {DEG * bias:.1f} °/s would turn the gyro's sum away from the heading, and the "
        f"two part by {round(DEG * apart, 1) + 0.0:.1f} °/s"
    )


def beyond_heading(trial: Any) -> float:
    """By how much the yaw rate turns faster than the heading, over usable time [rad/s]."""
    usable = np.asarray(trial.usable, bool)
    both = usable[1:] & usable[:-1]
    r, turned = trial.nu[:, Nu.R], np.diff(np.unwrap(trial.eta[:, Eta.YAW]))
    steps = (0.5 * (r[1:] + r[:-1]) * trial.dt - turned)[both]
    return float(steps.mean() / trial.dt) if len(steps) else 0.0


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "the gyro reads " + p.size(
        "bias", "°/s", DEG, after=" too fast to " + p.side("bias", "starboard", "port")
    )


EFFECT = Effect(
    name="yaw_rate_bias",
    scope=Scope.VOYAGE,
    observe=observe,
    parameters=(
        Parameter(
            "bias", "rad/s", lower=-0.3, upper=0.3, start=0.0, scale=0.003, neutral=0.0, sided=True
        ),
    ),
    looks_like="a turn rate that is off by the same amount always, at rest too, while the heading "
    "does not follow",
    evidence=EvidenceAxis(ForceAxis.YAW, "time"),
    disbelieved=disbelieved,
    in_words=in_words,
)
