"""Whether a delay or a lag is there where commands answer the motion.

An autopilot in a sea steers against what the waves do: its commands tell what the boat did a moment
before. A run of several seconds is given all of its commands, also those that answered waves within
it, and noise of first order holds no waves: a delay or a lag that is not there explains part of
them. Data of a closed loop are fitted without bias where each prediction is made from what was
there before, and where the noise can be what it is (Ljung, System Identification, 2nd ed. 1999,
§13.4). So what is told by when commands act is judged once more, one step ahead:

    runs of two rows from the measured track, tied; w: innovations without their colour a, s
    nats = log L with − log L without,     log L = Σ −½ w² − log s

Each under the colour that it leaves itself (`sim.identification.innovations`), fit and colour in
turn (generalised least squares: Clarke, IFAC Symposium on Identification, Prague 1967).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, fit_effects
from sim.diagnosis.fit_problem import FitProblem
from sim.diagnosis.worth import is_at_floor
from sim.effects.effect import Effect, Role, Shown
from sim.identification.innovations import CLIP_STD
from sim.identification.runs import RunSet
from sim.state import Floats

TIMES_OFF_S = 0.3  # largest error of lags, and of velocities that come late, in a sea
SHORTEST_ROW_S = 0.1  # of finer rows some together: they tell no more, and take longer
NOT_BEFORE_MOTION = (
    "commands answer the motion, as an autopilot's do in a sea: predicted from one moment to the "
    "next it wins nothing"
)


def said_of_times(effects: Sequence[Effect], told: Sequence[str], period: float) -> str:
    """What is to be said of delays and lags beside what swings with a period [s]; "" of none.

    told  names `effect.parameter` of those that predictions one step ahead have told. Of delays
          all twelve that were known lay in their interval, of lags four of nine, and of velocities
          that come late, which are not told so, two of four (light_and_days.md).
    """
    timed = [
        e for e in effects
        if Shown.COMMANDS in e.shown_by and any(p.unit == "s" for p in e.parameters)
    ]  # fmt: skip
    here = [e.name for e in timed if set(told) & set(times_of([e]))]
    lags = [e.name for e in timed if any(p.role is Role.TIME_CONSTANT for p in e.parameters)]
    doubted = [e.name for e in timed if e.name not in here or e.name in lags]
    swings, parts = f"what is left swings as in a sea (some {period:.1f} s)", []
    if here:
        parts.append(
            f"{swings} and commands answer it: the time of {' and '.join(here)} is the one that "
            "predicts from one moment to the next"
        )
    if doubted:
        parts.append(
            f"{'there' if here else f'{swings}, and there'} times that were known were found up "
            f"to {TIMES_OFF_S} s wrong: take that of {' and '.join(doubted)} with more doubt than "
            "its interval says"
        )
    return "; ".join(parts)


def acts_before_motion(before: Fit, after: Fit) -> bool:
    """Whether what a fit adds to another, told by when commands act, is no answer to the motion.

    Where no more is left than noise nothing shakes the boat that commands could answer.
    """
    if is_at_floor(after.noise_share):
        return True
    return nats_one_step(before, after) > thresholds.MIN_NATS_ONE_STEP


def times_of(effects: Iterable[Effect]) -> list[str]:
    """Names `effect.parameter` of the delays and lags [s] of when commands act.

    None of velocities that come late: so do the starts of the runs that would tell it.
    """
    return [
        f"{effect.name}.{p.name}"
        for effect in effects
        if Shown.COMMANDS in effect.shown_by and Shown.VELOCITY not in effect.shown_by
        for p in effect.parameters
        if p.unit == "s"
    ]


def with_times_one_step(fit: Fit) -> Fit:
    """The same effects with delays and lags as predictions one step ahead have them.

    They are held there, with their intervals of those predictions; all else is fitted beside.
    """
    times, close = times_of(a.effect for a in fit.added), _under_own_colour(fit, _one_step(fit))
    found = {e.name: e for numbers in close.estimates()[1].values() for e in numbers}
    told = tuple(found[name] for name in times)
    each = tuple(
        replace(u, start=found[u.name].value) if u.name in times else u for u in fit.unknowns.each
    )
    held = np.array([u.name in times for u in each])
    unknowns = replace(fit.unknowns, each=each).fixed(held)
    beside = fit_effects(fit.added, unknowns, fit.problem, np.where(held, unknowns.start, fit.z))
    return replace(beside, told=told)


def nats_one_step(before: Fit, after: Fit) -> float:
    """Nats that a fit wins over another one step ahead, each under its own colour."""
    problem = _one_step(after)
    lost, won = (_log_likelihood(fit, problem).sum() for fit in (before, after))
    return float(won - lost) / thresholds.ROWS_PER_INDEPENDENT_ROW


def _one_step(fit: Fit) -> FitProblem:
    """The shortest runs that there are, row by row: within a mean commands answer the motion too.

    Under the noise that the fit leaves in them.
    """
    old = fit.problem
    row = max(min(trial.dt for trial in old.trials), SHORTEST_ROW_S)
    settings = replace(old.settings, horizons=(row,), average=row)
    problem = FitProblem.of(
        old.vessel, old.trials, fit.unknowns, fit.z, fit.noise, settings, old.tracks
    )
    return replace(fit, problem=problem).renewed_problem


def _log_likelihood(fit: Fit, problem: FitProblem) -> Floats:
    """Of each residual (N,), from where a fit ended."""
    own = _under_own_colour(fit, problem)
    residual = np.clip(own.residual, -CLIP_STD, CLIP_STD)
    scale = [np.tile(scale, means) for scale, means in map(_scale_and_means, own.problem.run_sets)]
    return np.asarray(-0.5 * residual**2 - np.log(np.concatenate(scale)))


def _under_own_colour(fit: Fit, problem: FitProblem) -> Fit:
    """From where a fit ended, fit and colour in turn; last comes the colour."""
    now = problem
    for _ in range(thresholds.COLOUR_ROUNDS):
        fit = fit_effects(fit.added, fit.unknowns, now, fit.z)
        now = problem.under_colour_of(fit.unknowns, fit.z)
    last = replace(fit, problem=now)
    return replace(last, residual=last.at(fit.z[None])[0])


def _scale_and_means(runs: RunSet) -> tuple[Floats, int]:
    """s (3,) of the colour of a trial, and how many means it has."""
    colour = None if runs.chain is None else runs.chain.colour
    return np.ones(3) if colour is None else colour.scale, int(runs.within.sum())
