"""The evidence for an effect: what is missing without it, against what it depends on.

    points   mean over a bin of   missing force of the vessel without the effect
    curve    mean over a bin of   (missing force without) − (missing force with)

The axis of the force and the variable are those that the effect declares (`Effect.evidence`); for
one that declares none, those whose bins hold most of what it supplies. The vessel is that of the
ladder; only the one effect is taken out of it, and everything else stays, so that the curve is what
the effect itself supplies. Whiskers are twice the standard error over blocks of time, because rows
of one block are correlated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.comparison.where import bin_of
from sim.diagnosis.answer import Diagnosis, LadderStep
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis
from sim.identification.vessel_update import updated_vessel
from sim.model import Model
from sim.prediction.inputs import vessel_commands
from sim.prediction.missing_force import missing_force_only
from sim.state import Eta, Floats, Nu
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

SETTLE_S = 0.5  # over which a change of commands is taken
AROUND_S = 1.0  # over which an acceleration is taken

Variable = Callable[[Trial, Model], Floats]


def _mean_thrust(trial: Trial, model: Model) -> Floats:
    count = max(len(model.vessel.thrusters), 1)
    return np.asarray(vessel_commands(model, trial)[:, :count].mean(axis=1))


def _helm(trial: Trial, model: Model) -> Floats:
    """Rudder command, or port minus starboard thrusters where there is no rudder."""
    command = vessel_commands(model, trial)
    count = len(model.vessel.thrusters)
    if command.shape[1] > count:
        return np.asarray(command[:, count])
    side = -np.sign([t.position[1] for t in model.vessel.thrusters])
    return np.asarray(command @ side / max(float(np.abs(side).sum()), 1.0))


def _astern(trial: Trial, model: Model) -> Floats:
    """The hardest reversed thruster; NaN where none is."""
    count = max(len(model.vessel.thrusters), 1)
    most = vessel_commands(model, trial)[:, :count].min(axis=1)
    return np.where(most < 0.0, most, np.nan)


def _acceleration(trial: Trial) -> Floats:
    """Mean surge acceleration around each row: the row's own noise is in the missing force too."""
    wide = max(round(AROUND_S / trial.dt), 1)
    return np.asarray(np.convolve(trial.nu_dot[:, Nu.U], np.full(wide, 1.0 / wide), "same"))


def _change(values: Floats, trial: Trial) -> Floats:
    """Per second, over a moment before each row."""
    back = max(round(SETTLE_S / trial.dt), 1)
    earlier = np.concatenate([np.repeat(values[:1], back), values[:-back]])
    return np.asarray((values - earlier) / (back * trial.dt))


VARIABLES: Mapping[str, Variable] = {
    "heading": lambda t, m: t.eta[:, Eta.YAW] % (2.0 * np.pi),
    "surge": lambda t, m: t.nu[:, Nu.U],
    "sway": lambda t, m: t.nu[:, Nu.V],
    "turn_rate": lambda t, m: t.nu[:, Nu.R],
    "acceleration": lambda t, m: _acceleration(t),
    "throttle": lambda t, m: _mean_thrust(t, m),
    "astern": lambda t, m: _astern(t, m),
    "helm": lambda t, m: _helm(t, m),
    "throttle_change": lambda t, m: _change(_mean_thrust(t, m), t),
    "helm_change": lambda t, m: _change(_helm(t, m), t),
    "voltage": lambda t, m: t.voltage,
    "time": lambda t, m: t.time,
}
FULL_CIRCLE = ("heading", "phase")  # bins of equal width, all the way round
BINS = 10
FEWEST_S = 4.0  # of time in a bin
BLOCK_S = 25.0
ALIKE_S = 1.0  # rows within it are taken for one


@dataclass(frozen=True)
class Evidence:
    """One effect: missing force without it in bins of what it depends on, and its own curve.

    axis    0 X [N], 1 Y [N], 2 N [N m], 3 along the effect's direction over the ground [N]
    start, end           (n,) edges of the bins, SI
    at                   (n,) mean of the variable in each
    mean, low, high      (n,) missing force without the effect
    curve                (n,) what the effect supplies
    """

    effect: str
    axis: int
    by: str
    start: Floats
    end: Floats
    at: Floats
    mean: Floats
    low: Floats
    high: Floats
    curve: Floats

    @property
    def explained_share(self) -> float:
        """Share of the variation of the points about zero that the curve takes away."""
        total = float(np.sum(self.mean**2))
        left = float(np.sum((self.mean - self.curve) ** 2))
        return max(1.0 - left / total, 0.0) if total > 0.0 else 0.0


@dataclass(frozen=True)
class _Rows:
    """All usable rows: missing without (T, 4), supplied (T, 4), block (T,), seconds of one row."""

    missing: Floats
    supplied: Floats
    block: Floats
    seconds: float


def evidence(trials: Sequence[Trial], vessels: Sequence[Vessel], effect: Effect) -> Evidence | None:
    """One vessel with the effect per trial; None where no bin holds enough time."""
    rows = _rows(trials, vessels, effect)
    drawn = effect.evidence or _telling(trials, vessels, effect, rows)
    value = _values(trials, vessels, effect, drawn)
    return _binned(effect, int(drawn.axis), drawn.by, value, rows)


def _rows(trials: Sequence[Trial], vessels: Sequence[Vessel], effect: Effect) -> _Rows:
    missing, supplied, block = [], [], []
    for k, (trial, vessel) in enumerate(zip(trials, vessels, strict=True)):
        with_it, without = Model.of(vessel), Model.of(_without(vessel, effect))
        left = _all_axes(missing_force_only(trial, with_it), trial, vessel, effect)
        lack = _all_axes(missing_force_only(trial, without), trial, vessel, effect)
        missing.append(lack[trial.usable])
        supplied.append((lack - left)[trial.usable])
        block.append(1e6 * k + trial.time[trial.usable] // BLOCK_S)
    return _Rows(np.concatenate(missing), np.concatenate(supplied), np.concatenate(block),
                 trials[0].dt)  # fmt: skip


def _without(vessel: Vessel, effect: Effect) -> Vessel:
    return replace(vessel, effects=tuple(a for a in vessel.effects if a.effect.name != effect.name))


def _added(vessel: Vessel, effect: Effect) -> AddedEffect:
    return next(a for a in vessel.effects if a.effect.name == effect.name)


def _all_axes(force: Floats, trial: Trial, vessel: Vessel, effect: Effect) -> Floats:
    """X, Y, N (T, 3) -> with the force along the effect's direction beside them (T, 4)."""
    direction = _added(vessel, effect).values.get("direction", 0.0)
    off = direction - trial.eta[:, Eta.YAW]
    along = force[:, 0] * np.cos(off) + force[:, 1] * np.sin(off)
    return np.column_stack([force, along])


def _values(
    trials: Sequence[Trial], vessels: Sequence[Vessel], effect: Effect, drawn: EvidenceAxis
) -> Floats:
    """What the effect depends on, on all usable rows (T,)."""
    return np.concatenate([
        _variable(t, v, effect, drawn)[t.usable] for t, v in zip(trials, vessels, strict=True)
    ])  # fmt: skip


def _variable(trial: Trial, vessel: Vessel, effect: Effect, drawn: EvidenceAxis) -> Floats:
    if drawn.variable is not None:
        north, east = trial.eta[:, Eta.NORTH], trial.eta[:, Eta.EAST]
        return drawn.variable(trial.time, north, east, _added(vessel, effect).values)
    return VARIABLES[drawn.by](trial, Model.of(_without(vessel, effect)))


def _telling(
    trials: Sequence[Trial], vessels: Sequence[Vessel], effect: Effect, rows: _Rows
) -> EvidenceAxis:
    """For an effect that declares none: where bins hold most of what it supplies."""
    best, found = -1.0, EvidenceAxis(ForceAxis.SURGE, "surge")
    noise = np.std(rows.missing - rows.supplied, axis=0) + 1e-9
    for by in VARIABLES:
        value = _values(trials, vessels, effect, EvidenceAxis(ForceAxis.SURGE, by))
        for axis in (ForceAxis.SURGE, ForceAxis.SWAY, ForceAxis.YAW):
            one = _binned(effect, axis, by, value, rows)
            told = 0.0 if one is None else float(np.var(one.curve)) / float(noise[axis]) ** 2
            if told > best * 1.001:
                best, found = told, EvidenceAxis(axis, by)
    return found


def _binned(effect: Effect, axis: int, by: str, value: Floats, rows: _Rows) -> Evidence | None:
    known = np.isfinite(value) & np.isfinite(rows.missing[:, axis])
    if not known.any():
        return None
    edges = _edges(value[known], by)
    place = np.where(known, bin_of(value, edges), -1)
    kept = [k for k in range(len(edges) - 1) if (place == k).sum() * rows.seconds >= FEWEST_S]
    if len(kept) < 2:
        return None
    each = [
        _mean(rows.missing[place == k, axis], rows.block[place == k], rows.seconds) for k in kept
    ]
    mean, half = np.array(each).T
    curve = np.array([rows.supplied[place == k, axis].mean() for k in kept])
    at = np.array([value[place == k].mean() for k in kept])
    bins = np.array(kept)
    return Evidence(effect.name, axis, by, edges[bins], edges[bins + 1], at, mean, mean - half,
                    mean + half, curve)  # fmt: skip


def _edges(value: Floats, by: str) -> Floats:
    """Equal bins all around, else equally filled ones; a value held for long is met once."""
    if by in FULL_CIRCLE:
        return np.linspace(0.0, 2.0 * np.pi, BINS + 1)
    edges = np.unique(np.quantile(value, np.linspace(0.0, 1.0, BINS + 1)))
    return edges if len(edges) > 1 else np.array([edges[0] - 0.5, edges[0] + 0.5])


def _mean(force: Floats, block: Floats, seconds: float) -> tuple[float, float]:
    """Mean, and twice its standard error: over blocks, and no less than rows of one second tell."""
    least = float(force.var()) / max(len(force) * seconds / ALIKE_S, 1.0)
    _, number = np.unique(block, return_inverse=True)
    count = np.bincount(number).astype(float)
    off = np.bincount(number, force) / count - force.mean()
    many = max(len(count) - 1, 1)
    spread = float(np.sum((count / count.sum() * off) ** 2)) * len(count) / many
    return float(force.mean()), 2.0 * float(np.sqrt(max(spread, least)))


def evidence_of(diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Evidence]:
    """For each effect that was found, from the best vessel with the numbers of each recording."""
    best = diagnosis.ladder[-1]
    found = [evidence_on(best, name, trials) for name in best.effects]
    return [one for one in found if one is not None]


def evidence_of_rivals(diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Evidence]:
    """For what these data cannot tell from the effects found, with its own fitted numbers."""
    found = [evidence_on(step, step.effects[-1], trials) for step in rivals(diagnosis)]
    return [one for one in found if one is not None]


def rivals(diagnosis: Diagnosis) -> list[LadderStep]:
    """The alternatives that do as well as what was chosen, each effect once."""
    tied = {row.effect for row in diagnosis.ranking if row.confounded_with}
    out = {
        step.effects[-1]: step for step in diagnosis.alternatives
        if len(step.effects) > 1 or step.effects[-1] in tied
    }  # fmt: skip
    return [step for effect, step in out.items() if effect not in diagnosis.effects]


def evidence_on(step: LadderStep, effect: str, trials: Sequence[Trial]) -> Evidence | None:
    """For one effect of a step's vessel; None where there is too little time to show it."""
    vessels = [_vessel_on(step, trial, trials[0]) for trial in trials]
    added = next(a.effect for a in step.vessel.effects if a.effect.name == effect)
    return evidence(trials, vessels, added)


def _vessel_on(step: LadderStep, trial: Trial, first: Trial) -> Vessel:
    """The vessel of a step with the values fitted for one recording alone."""
    if trial is first:
        return step.vessel
    own = {
        e.name: e.value for numbers in step.parameters.values() for e in numbers
        if e.trial == trial.name
    }  # fmt: skip
    return updated_vessel(step.vessel, own)
