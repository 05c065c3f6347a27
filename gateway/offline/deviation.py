"""A compass that deviates, as the gyro tells it: kept from fighting the gyro in turns.

    reported ψ' = ψ + d(ψ'),    d = Σ_k b_k sin kψ' + c_k cos kψ',    k = 1, 2

A heading that turns by another rate than the gyro's is no motion that a smoother holds possible: it
would follow the gyro, degrees off what was reported, and gates would refuse the compass. So what
the gyro surely tells of a deviation (`gateway.ingest.agreement`) is taken out of the headings
before the two are combined, and put back into what comes out: the heading is the one that was
reported, the yaw rate the gyro's, and the deviation stays for an effect of the catalogue to
explain.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from gateway.estimation import MeasurementKind
from gateway.estimation.events import Events
from gateway.estimation.smoother import SmoothedMotion
from sim.body import Report, with_heading_off
from sim.state import Eta, Floats, Nu

ROUNDS = 4  # of the heading that is reported where the true one is known: each gains a digit
Deviation = tuple[float, ...]  # b_1, c_1, b_2, c_2 [rad]; empty: none


def deviation_at(heading: Floats, deviation: Deviation) -> Floats:
    """What a compass that shows these headings (T,) [rad] is off by: (T,) [rad]."""
    b, c, b2, c2 = deviation
    return np.asarray(
        b * np.sin(heading) + c * np.cos(heading)
        + b2 * np.sin(2.0 * heading) + c2 * np.cos(2.0 * heading)
    )  # fmt: skip


def without_deviation(events: Events, deviation: Deviation) -> Events:
    """Events with the headings that a compass without deviation had shown."""
    if not deviation:
        return events
    z, yaw = events.z.copy(), events.kind == MeasurementKind.YAW
    z[yaw, 0] -= deviation_at(z[yaw, 0], deviation)
    return replace(events, z=z)


def with_deviation(motion: SmoothedMotion, deviation: Deviation) -> SmoothedMotion:
    """Motion as a compass that deviates shows it: heading, and what is ahead of it and abeam."""
    if not deviation:
        return motion
    true = motion.eta[:, Eta.YAW]
    shown = true
    for _ in range(ROUNDS):
        shown = true + deviation_at(shown, deviation)
    b, c, b2, c2 = deviation
    turned = deviation_at(shown, (-c, b, -2.0 * c2, 2.0 * b2))  # dd/dψ'
    error: Any = shown - true  # the laws of single numbers hold for columns of them too
    rate: Any = motion.nu[:, Nu.R] * turned / (1.0 - turned)
    report: Any = with_heading_off(
        Report(*motion.eta.T, *motion.nu.T, *motion.nu_dot.T), error, rate
    )
    columns: Floats = np.stack(report, axis=1)
    cosine, sine = np.cos(error), np.sin(error)
    turn = np.zeros((len(true), 9, 9))
    turn[:] = np.eye(9)
    for i in (3, 6):  # (u, v) and their rates are turned by minus the deviation
        turn[:, i, i], turn[:, i, i + 1] = cosine, sine
        turn[:, i + 1, i], turn[:, i + 1, i + 1] = -sine, cosine
    covariance = turn @ motion.covariance @ turn.swapaxes(1, 2)
    return replace(
        motion, eta=columns[:, :3], nu=columns[:, 3:6], nu_dot=columns[:, 6:], covariance=covariance
    )
