"""Shooting beside instrumental variables: two ways to the same numbers, with other weaknesses.

Shooting trusts the model over seconds, instruments trust it for what it is told only. Where their
intervals lie apart, something is in the data that the model lacks, and neither number holds. Nine
comparisons are made: intervals are widened so that all nine hold in 95 of 100 cases (Bonferroni).
"""

from collections.abc import Sequence

from scipy.stats import norm

from sim.diagnosis.segments import NoUsableTimeError
from sim.identification.estimate import Estimate
from sim.identification.instrumental import instrumental
from sim.identification.settings import BASE
from sim.model import Model
from sim.trial import Trial

WIDER = float(norm.ppf(1.0 - 0.025 / len(BASE)) / norm.ppf(0.975))
SMALLEST = 0.03  # of the value: below it both are good enough
LOOK = {
    "m": "how late and how slowly the motors answer (thruster_lag, command_delay)",
    "X": "thrust against command, wind and current",
    "Y": "current, heading offset and what pushes sideways",
    "N": "thrust that is not the same on both sides, and moments of wind",
}


def disagreements(
    trials: Sequence[Trial], model: Model, estimates: Sequence[Estimate]
) -> tuple[str, ...]:
    """A sentence for each base parameter whose two intervals lie apart; none where all agree.

    `model` holds the numbers found. Vessels with effects are not compared: their forces are not
    linear in the nine.
    """
    told = {e.name: e for e in estimates if e.name in BASE and e.identifiable}
    if model.vessel.effects or len(estimates) != len(BASE) or not told:
        return ()
    try:
        other = instrumental(trials, model)
    except NoUsableTimeError:
        return ()
    out = []
    for i, name in enumerate(BASE):
        if name not in told:
            continue
        e, low, high = told[name], float(other.low[i]), float(other.high[i])
        reach = WIDER * 0.5 * (e.ci95[1] - e.ci95[0] + high - low)
        if abs(e.value - other.value[i]) > max(reach, SMALLEST * abs(e.value)):
            out.append(
                f"{name}: instrumental variables say {low:.4g} … {high:.4g} {e.unit}, which lies "
                f"outside {e.ci95[0]:.4g} … {e.ci95[1]:.4g}: look at {LOOK[name[0]]}"
            )
    return tuple(out)
