"""The filter's loop over events in order of receipt: the one that runs live and in replay."""

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.history import COUNT, REFUSED_RUN, History, insert, place, restart
from gateway.estimation.names import KINDS, Flag
from gateway.estimation.settings import Model
from gateway.estimation.step import valid
from gateway.estimation.uncertainty import add_heading_error, heading_slope
from gateway.estimation.update import Work, new_work
from gateway.jit import compiled
from sim.state import Floats, Ints
from sim.trial import MOTION

LATE, REFUSED, RESTART = int(Flag.LATE), int(Flag.REFUSED), int(Flag.RESTART)


@compiled
def admit(history: History, time: float, kind: int, model: Model) -> tuple[int, int]:
    """Decides about an event by its time -> its number among the kept (−1: refused), flags."""
    if not np.isfinite(time) or kind < 0 or kind >= KINDS:
        return -1, REFUSED
    count = history.counts[COUNT]
    newest = history.time[(count - 1) % len(history.time)]
    step = time - newest if np.isfinite(newest) else 0.0
    if np.abs(step) > model.gap:
        restart(history, model)
        return 1, RESTART
    number = place(history, time, kind) if -step <= model.max_late else -1
    if number > 0:
        history.counts[REFUSED_RUN] = 0
        return number, LATE if step < 0.0 else 0
    history.counts[REFUSED_RUN] += 1
    if history.counts[REFUSED_RUN] >= model.refused_run:
        restart(history, model)
        return 1, RESTART
    return -1, REFUSED


@compiled
def report(history: History, model: Model, motion: Floats, std: Floats, covariance: Floats) -> int:
    """The newest state into motion (9,), std (9,), covariance (9, 9) or (0, 0); Flag.VALID or 0."""
    here = (history.counts[COUNT] - 1) % len(history.time)
    x, P = history.x[here], history.P[here]
    for i in range(MOTION):
        motion[i] = x[i]
        std[i] = np.sqrt(P[i, i] + (model.heading_sigma * heading_slope(i, x)) ** 2)
    if len(covariance):
        covariance[:] = P[:MOTION, :MOTION]
        add_heading_error(x, model.heading_sigma, covariance)
    return valid(history.book[here])


@compiled
def one(
    history: History, time: float, kind: int, z: Floats, std: Floats, model: Model, work: Work
) -> tuple[float, int, int]:
    """One event as received -> NIS, components used, flags."""
    number, flags = admit(history, time, kind, model)
    if number < 0:
        return 0.0, 0, flags
    nis, used, outcome = insert(history, number, time, kind, z, std, model, work)
    return nis, used, flags | outcome


@compiled
def run(
    history: History,
    time: Floats,
    kind: Ints,
    z: Floats,
    std: Floats,
    model: Model,
    out_time: Floats,
    out_motion: Floats,
    out_std: Floats,
    out_covariance: Floats,
    out_nis: Floats,
    out_used: NDArray[np.int8],
    out_flags: NDArray[np.uint8],
) -> None:
    """K events through the filter, in place; one row of output per event."""
    work = new_work()
    for k in range(len(time)):
        nis, used, flags = one(history, time[k], kind[k], z[k], std[k], model, work)
        flags |= report(history, model, out_motion[k], out_std[k], out_covariance[k])
        out_time[k] = history.time[(history.counts[COUNT] - 1) % len(history.time)]
        out_nis[k], out_used[k], out_flags[k] = nis, used, flags
