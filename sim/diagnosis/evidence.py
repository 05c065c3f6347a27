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

from sim.comparison import bin_of
from sim.diagnosis.answer import Diagnosis, LadderStep
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis
from sim.identification import updated_vessel
from sim.model import Model
from sim.prediction import missing_force_only, vessel_commands
from sim.prediction.segments import BLOCK_S
from sim.state import Eta, Floats, Nu
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

# Of the picture; all chosen, not measured.
CHANGE_S = 0.5  # over which a change of commands is taken
ACCELERATION_S = 1.0  # over which an acceleration is taken
BINS = 10
MIN_BIN_S = 4.0  # of time in a bin
AGAINST_ITSELF = 3.0  # standard errors by which a curve points the other way than its points
CORRELATED_S = 1.0  # rows within it count as one
FULL_CIRCLE = ("heading", "phase")  # variables with bins of equal width, all the way round

Variable = Callable[[Trial, Model], Floats]


def _throttle(trial: Trial, model: Model) -> Floats:
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
    hardest = vessel_commands(model, trial)[:, :count].min(axis=1)
    return np.where(hardest < 0.0, hardest, np.nan)


def _acceleration(trial: Trial, model: Model) -> Floats:
    """Mean surge acceleration around each row: the row's own noise is in the missing force too."""
    width = max(round(ACCELERATION_S / trial.dt), 1)
    return np.asarray(np.convolve(trial.nu_dot[:, Nu.U], np.full(width, 1.0 / width), "same"))


def _change_of(variable: Variable) -> Variable:
    """Per second, over a moment before each row."""

    def change(trial: Trial, model: Model) -> Floats:
        values, back = variable(trial, model), max(round(CHANGE_S / trial.dt), 1)
        earlier = np.concatenate([np.repeat(values[:1], back), values[:-back]])
        return np.asarray((values - earlier) / (back * trial.dt))

    return change


VARIABLES: Mapping[str, Variable] = {
    "heading": lambda t, m: t.eta[:, Eta.YAW] % (2.0 * np.pi),
    "surge": lambda t, m: t.nu[:, Nu.U],
    "sway": lambda t, m: t.nu[:, Nu.V],
    "turn_rate": lambda t, m: t.nu[:, Nu.R],
    "acceleration": _acceleration,
    "throttle": _throttle,
    "astern": _astern,
    "helm": _helm,
    "throttle_change": _change_of(_throttle),
    "helm_change": _change_of(_helm),
    "voltage": lambda t, m: t.voltage,
    "time": lambda t, m: t.time,
}


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

    @property
    def contradicts(self) -> bool:
        """Whether the curve points significantly away from the points that it is to explain.

        Points are weighted by their own errors; that is their regression on the curve.
        """
        sigma = 0.25 * (self.high - self.low)
        weight = 1.0 / np.maximum(sigma, 1e-9 + 1e-3 * np.abs(self.mean)) ** 2
        size = float(np.sum(weight * self.curve**2))
        slope = float(np.sum(weight * self.curve * self.mean))
        return size > 0.0 and slope < -AGAINST_ITSELF * np.sqrt(size)


def evidence(trials: Sequence[Trial], vessels: Sequence[Vessel], effect: Effect) -> Evidence | None:
    """One vessel with the effect per trial; None where no two bins hold enough time."""
    rows = _Rows.of(trials, vessels, effect)
    against = effect.evidence_axis(rows.added[0].values) or _best_axis(rows)
    return rows.binned(against, rows.values(against))


@dataclass(frozen=True)
class _Rows:
    """All usable rows: missing without the effect (T, 4), supplied by it (T, 4), block (T,).

    The fourth axis is along the effect's direction over the ground. models: without the effect
    """

    effect: Effect
    trials: Sequence[Trial]
    models: Sequence[Model]
    added: Sequence[AddedEffect]
    missing: Floats
    supplied: Floats
    block: Floats

    @classmethod
    def of(cls, trials: Sequence[Trial], vessels: Sequence[Vessel], effect: Effect) -> "_Rows":
        models, every, missing, supplied, block = [], [], [], [], []
        for k, (trial, vessel) in enumerate(zip(trials, vessels, strict=True)):
            others = tuple(a for a in vessel.effects if a.effect.name != effect.name)
            added = next(a for a in vessel.effects if a.effect.name == effect.name)
            without = Model.of(replace(vessel, effects=others))
            lack, left = (
                _with_direction(missing_force_only(trial, model), trial, added)
                for model in (without, Model.of(vessel))
            )
            models.append(without)
            every.append(added)
            missing.append(lack[trial.usable])
            supplied.append((lack - left)[trial.usable])
            block.append(1e6 * k + trial.time[trial.usable] // BLOCK_S)
        parts = (np.concatenate(part) for part in (missing, supplied, block))
        return cls(effect, trials, models, every, *parts)

    def values(self, against: EvidenceAxis) -> Floats:
        """What the effect depends on (T,)."""
        out = []
        for trial, model, added in zip(self.trials, self.models, self.added, strict=True):
            if against.variable is not None:
                north, east = trial.eta[:, Eta.NORTH], trial.eta[:, Eta.EAST]
                value = against.variable(trial.time, north, east, added.values)
            else:
                value = VARIABLES[against.by](trial, model)
            out.append(value[trial.usable])
        return np.concatenate(out)

    def binned(self, against: EvidenceAxis, value: Floats) -> Evidence | None:
        """Evidence on one axis against the values of one variable (T,)."""
        i, dt = int(against.axis), self.trials[0].dt
        known = np.isfinite(value) & np.isfinite(self.missing[:, i])
        if not known.any():
            return None
        edges = _edges(value[known], against.by)
        number = np.where(known, bin_of(value, edges), -1)
        kept = [k for k in range(len(edges) - 1) if (number == k).sum() * dt >= MIN_BIN_S]
        if len(kept) < 2:
            return None
        rows = [number == k for k in kept]
        mean, half = np.array([_mean(self.missing[r, i], self.block[r], dt) for r in rows]).T
        at = np.array([value[r].mean() for r in rows])
        curve = np.array([self.supplied[r, i].mean() for r in rows])
        bins = np.array(kept)
        return Evidence(self.effect.name, i, against.by, edges[bins], edges[bins + 1], at, mean,
                        mean - half, mean + half, curve)  # fmt: skip


def _with_direction(force: Floats, trial: Trial, added: AddedEffect) -> Floats:
    """X, Y, N (T, 3) -> with the force along the effect's direction beside them (T, 4)."""
    off = added.values.get("direction", 0.0) - trial.eta[:, Eta.YAW]
    along = force[:, 0] * np.cos(off) + force[:, 1] * np.sin(off)
    return np.column_stack([force, along])


def _best_axis(rows: _Rows) -> EvidenceAxis:
    """For an effect that declares none: where bins hold most of what it supplies."""
    most, best = -1.0, EvidenceAxis(ForceAxis.SURGE, "surge")
    noise = np.std(rows.missing - rows.supplied, axis=0) + 1e-9
    for by in VARIABLES:
        value = rows.values(EvidenceAxis(ForceAxis.SURGE, by))
        for axis in (ForceAxis.SURGE, ForceAxis.SWAY, ForceAxis.YAW):
            found = rows.binned(EvidenceAxis(axis, by), value)
            share = 0.0 if found is None else float(np.var(found.curve)) / float(noise[axis]) ** 2
            if share > most * 1.001:
                most, best = share, EvidenceAxis(axis, by)
    return best


def _edges(value: Floats, by: str) -> Floats:
    """Equal bins all around, else equally filled ones; a value held for long is met once."""
    if by in FULL_CIRCLE:
        return np.linspace(0.0, 2.0 * np.pi, BINS + 1)
    edges = np.unique(np.quantile(value, np.linspace(0.0, 1.0, BINS + 1)))
    return edges if len(edges) > 1 else np.array([edges[0] - 0.5, edges[0] + 0.5])


def _mean(force: Floats, block: Floats, dt: float) -> tuple[float, float]:
    """Mean, and twice its standard error: over blocks, and no less than rows of one second tell."""
    least = float(force.var()) / max(len(force) * dt / CORRELATED_S, 1.0)
    _, number = np.unique(block, return_inverse=True)
    count = np.bincount(number).astype(float)
    off = np.bincount(number, force) / count - force.mean()
    spread = float(np.sum((count / count.sum() * off) ** 2)) * len(count) / max(len(count) - 1, 1)
    return float(force.mean()), 2.0 * float(np.sqrt(max(spread, least)))


def evidence_of(diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Evidence]:
    """For each effect that was found, from the best vessel with the numbers of each recording, and
    for the curve of what none of them explains.
    """
    best, curve = diagnosis.ladder[-1], diagnosis.curve
    found = [evidence_on(best, name, trials) for name in best.effects]
    if curve is not None:
        found.append(evidence_on(curve, curve.effects[-1], trials))
    return [one for one in found if one is not None]


def evidence_of_rivals(diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Evidence]:
    """For what these data cannot tell from the effects found, with its own fitted numbers."""
    found = [evidence_on(step, step.effects[-1], trials) for step in rivals(diagnosis)]
    return [one for one in found if one is not None]


def rivals(diagnosis: Diagnosis) -> list[LadderStep]:
    """The alternatives that do as well as what was chosen, each effect once.

    Where the first of the ranking was not chosen in the end, its own rivals are none.
    """
    found = {*diagnosis.effects}
    tied = {row.effect for row in diagnosis.ranking if found.intersection(row.confounded_with)}
    out = {
        step.effects[-1]: step for step in diagnosis.alternatives
        if len(step.effects) > 1 or step.effects[-1] in tied
    }  # fmt: skip
    return [step for effect, step in out.items() if effect not in diagnosis.effects]


def evidence_on(step: LadderStep, effect: str, trials: Sequence[Trial]) -> Evidence | None:
    """For one effect of a step's vessel; None where there is too little time to show it, and for
    one that is a map: nothing that it supplies depends on one variable.
    """
    added = next(a.effect for a in step.vessel.effects if a.effect.name == effect)
    if added.over_map is not None:
        return None
    return evidence(trials, [_vessel_on(step, trial, trials[0]) for trial in trials], added)


def _vessel_on(step: LadderStep, trial: Trial, first: Trial) -> Vessel:
    """The vessel of a step with the values fitted for one recording alone."""
    if trial is first:
        return step.vessel
    own = {
        e.name: e.value for numbers in step.parameters.values() for e in numbers
        if e.trial == trial.name
    }  # fmt: skip
    return updated_vessel(step.vessel, own)
