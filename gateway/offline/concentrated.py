"""Where a model that is as good as data can tell errs by much in little of the time."""

from collections.abc import Sequence

from sim.comparison.compare import compare
from sim.diagnosis.answer import Diagnosis, Verdict
from sim.model import Model
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import NoUsableTimeError
from sim.trial import Trial

# Of eleven exact files of a stranger's none had a range with more than three times its share of the
# time; a motor that gives nothing astern at part throttle had 41 % in 3 %.
MIN_CONCENTRATED, MIN_DENSITY = 0.25, 6.0  # share of the squared error; that over the time's
MAX_RECORDINGS_LOOKED_AT = 3


def concentrated_error(d: Diagnosis, trials: Sequence[Trial]) -> list[str]:
    """Where a model that is as good as these data can tell errs by much in little of the time.

    Errors of the measured velocities come and go; what errs astern alone is of the boat.
    """
    if d.verdict is not Verdict.ADEQUATE:
        return []
    out = []
    for trial in trials[:MAX_RECORDINGS_LOOKED_AT]:
        try:
            (found,) = compare(trial, [Model.of(d.vessel)])
        except (NoUsableTimeError, DivergedError):
            continue
        for one in found.worst():
            if one.share > MIN_CONCENTRATED and one.share > MIN_DENSITY * one.time_share:
                out.append(f"{trial.name}: what is left is not spread as noise is: {one.sentence}")
                break
    return out
