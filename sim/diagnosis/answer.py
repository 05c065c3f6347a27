"""What a diagnosis answers: verdict, ladder, ranking, refusals, and the better vessel.

Also what had to be assumed for the numbers of effects that were found, and what that costs them.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit
from sim.diagnosis.heldout import HeldOutScore, HeldOutScorer, Ranking
from sim.diagnosis.next_experiment import Refusal, SuggestedManoeuvre
from sim.diagnosis.residual_terms import Dependence
from sim.effects.effect import Assumption
from sim.effects.tables import Formula
from sim.effects.words import FittedValues
from sim.identification.intervals import Estimate
from sim.state import Floats
from sim.trial import data_frame
from sim.vessel import AddedEffect, Vessel

Parameters = Mapping[str, tuple[Estimate, ...]]
DOUBT = "holds for what was assumed; its interval allows for that being off"


@dataclass(frozen=True)
class AssumedNumbers:
    """An effect that was found, on one recording (None: on all), with what was assumed for it."""

    effect: str
    trial: str | None
    assumption: Assumption

    @property
    def description(self) -> str:
        """In words."""
        where = "" if self.trial is None else f" on {self.trial}"
        return f"{self.effect}{where}: {self.assumption.description}"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "effect": self.effect, "recording": self.trial, **self.assumption.numbers,
            "says": self.description,
        }  # fmt: skip


def assumed_numbers(vessel: Vessel, found: Parameters) -> tuple[AssumedNumbers, ...]:
    """Of effects of the vessel and their estimates by name: those that rest on an assumption."""
    return tuple(
        AssumedNumbers(added.effect.name, trial, assumption)
        for added in vessel.effects
        if added.effect.assumption is not None
        for trial, estimates in _by_trial(found.get(added.effect.name, ())).items()
        if (assumption := _assumption(vessel, added, estimates)) is not None
    )


def with_assumed_intervals(found: Parameters, assumed: Sequence[AssumedNumbers]) -> Parameters:
    """The estimates, as uncertain as they are with what was assumed."""
    wider = {
        (one.effect, f"{one.effect}.{key}", one.trial): ci95
        for one in assumed
        for key, ci95 in one.assumption.ci95.items()
    }
    return {
        effect: tuple(_widened(e, wider.get((effect, e.name, e.trial))) for e in estimates)
        for effect, estimates in found.items()
    }


def _by_trial(estimates: Sequence[Estimate]) -> dict[str | None, list[Estimate]]:
    """Those of each recording, with those that are of all; these alone where there are no others.

    A wind is of a day, and how it turns the boat is hers: both are one effect on one recording.
    """
    out: dict[str | None, list[Estimate]] = {}
    for e in estimates:
        out.setdefault(e.trial, []).append(e)
    shared = out.get(None, [])
    if len(out) == 1:
        return out
    return {trial: [*shared, *own] for trial, own in out.items() if trial is not None}


def _assumption(
    vessel: Vessel, added: AddedEffect, estimates: Sequence[Estimate]
) -> Assumption | None:
    """Of one effect with its estimates on one recording."""
    assert added.effect.assumption is not None
    values = {e.name.rpartition(".")[2]: e.value for e in estimates}
    ci95 = {e.name.rpartition(".")[2]: e.ci95 for e in estimates}
    return added.effect.assumption(vessel, {**added.values, **values}, ci95)


def _widened(e: Estimate, ci95: tuple[float, float] | None) -> Estimate:
    if ci95 is None:
        return e
    return replace(e, ci95=ci95, doubt="; ".join(filter(None, (e.doubt, DOUBT))))


ROUNDING = 1e-12  # of a sum of probabilities
MOST = 0.5  # a share that is more is most of a thing


class Verdict(StrEnum):
    """The four answers there are."""

    ADEQUATE = "adequate"
    EXPLAINED = "explained"
    CONFOUNDED = "confounded"
    UNKNOWN = "unknown"

    def in_words(self, unexplained: float) -> str:
        """What it means, beside a share of the squared error above the noise that is left."""
        if self is Verdict.EXPLAINED and unexplained >= thresholds.MIN_UNEXPLAINED_TOLD:
            left = f"{100.0 * unexplained:.0f} %"
            if unexplained > MOST:
                return f"found a part of what is missing: {left} of it is left"
            return f"found most of what is missing, but not the last {left}"
        return {
            Verdict.ADEQUATE: "nothing is missing that these data could tell",
            Verdict.EXPLAINED: "found what is missing",
            Verdict.CONFOUNDED: "more than one effect explains it equally well here",
            Verdict.UNKNOWN: "something is missing that the catalogue does not hold",
        }[self]


class StepBase(StrEnum):
    """The base numbers of a step of the ladder."""

    PLAIN = "plain"  # as the vessel was given
    REFITTED = "refitted"
    KEPT = "kept"  # as given: fitted they predict unseen time no better


@dataclass(frozen=True)
class LadderStep:
    """One step of the ladder: effects, held-out error, numbers with intervals.

    vessel  the whole vessel of this step
    new     how many of the effects were not in the step below
    assumed what had to be assumed for its numbers
    left_out  error on each recording by the fit without it; None of fewer than three recordings
    """

    effects: tuple[str, ...]
    base: StepBase
    heldout: HeldOutScore
    base_parameters: tuple[Estimate, ...]
    parameters: Mapping[str, tuple[Estimate, ...]]
    vessel: Vessel
    assumed: tuple[AssumedNumbers, ...] = ()
    new: int = 1
    left_out: HeldOutScore | None = None

    @classmethod
    def of(cls, fit: Fit, scorer: HeldOutScorer) -> "LadderStep":
        """A fit, with its error on held-out time."""
        (base, found), vessel = fit.estimates(), fit.vessel()
        assumed = assumed_numbers(vessel, found)
        found = with_assumed_intervals(found, assumed)
        error = scorer.score_fit(fit)
        return cls(fit.names, StepBase.REFITTED, error, base, found, vessel, assumed)

    def with_left_out(self, fit: Fit, scorer: HeldOutScorer) -> "LadderStep":
        """The same with the error on recordings that were left out, of the fit that it is of."""
        return replace(self, left_out=scorer.score_recordings(fit))

    def to_dict(self) -> dict[str, Any]:
        """For JSON; without an interval, or recordings left out, where there are none."""
        out: dict[str, Any] = {
            "effects": list(self.effects), "base": str(self.base),
            "heldout_nrmse": self.heldout.nrmse,
            "base_parameters": {e.name: _number(e) for e in self.base_parameters},
            "parameters": {
                effect: {e.name.rpartition(".")[2]: _number(e) for e in numbers}
                for effect, numbers in self.parameters.items()
            },
        }  # fmt: skip
        effects = (added.effect for added in self.vessel.effects)
        if alike := [e.name for e in effects if e.is_alike and e.name in self.effects]:
            out["alike"] = alike
        if self.heldout.ci95:
            out["ci95"] = list(self.heldout.ci95)
        if self.left_out:
            out["left_out_nrmse"] = self.left_out.nrmse
        return out


def recordings_of(step: LadderStep, effect: str) -> tuple[str, ...]:
    """Recordings that have numbers of their own of an effect; none where it is alike on all."""
    trials = (e.trial for e in step.parameters.get(effect, ()))
    return tuple(dict.fromkeys(trial for trial in trials if trial is not None))


def fitted_values(
    step: LadderStep, effect: str, start_time_ns: int = 0, recording: str | None = None
) -> FittedValues:
    """Numbers of one effect of a step with their intervals, as on a recording: None: the first.

    start_time_ns  UTC of the first sample, for moments by the clock; 0: not known
    """
    added = next(a for a in step.vessel.effects if a.effect.name == effect)
    recording = recording or next(iter(recordings_of(step, effect)), None)
    own = [e for e in step.parameters.get(effect, ()) if e.trial in (None, recording)]
    values = {e.name.rpartition(".")[2]: e.value for e in own}
    intervals = {e.name.rpartition(".")[2]: e.ci95 for e in own}
    return FittedValues({**added.values, **values}, intervals, start_time_ns)


def falling(steps: Sequence[LadderStep]) -> tuple[LadderStep, ...]:
    """The ladder without those effects' steps, but the last, that do not lower the error.

    An effect may earn its place only beside one that came after it. The first two are the vessel
    as it was given and its base.
    """
    out, last = list(steps[:2]), steps[-1]
    for step in steps[2:]:
        between = last.heldout.nrmse < step.heldout.nrmse < out[-1].heldout.nrmse
        if step is last or between:
            out.append(replace(step, new=len(step.effects) - len(out[-1].effects)))
    return tuple(out)


@dataclass(frozen=True)
class Candidate:
    """One effect of the catalogue beside the bare base.

    alike       correlation of what it explains with what the first of the ranking explains
    general_of  the simpler effect that it can stand in for
    doubted     it would help and is not believed: it has no probability
    """

    effect: str
    probability: float
    heldout_nrmse: float
    confounded_with: tuple[str, ...]
    alike: float = 1.0
    general_of: str = ""
    doubted: bool = False

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        shown = vars(self) | {"confounded_with": list(self.confounded_with)}
        hidden = {"general_of", *(() if self.doubted else ("doubted",))}
        return {key: value for key, value in shown.items() if key not in hidden}


def candidates_of(
    ranking: Ranking, alone: Sequence[LadderStep], rivals: Sequence[str]
) -> tuple[Candidate, ...]:
    """A ranking as it is told; `alone` has the step of each, `rivals` explain as well as the best.

    Alike are effects that take away the same of the held-out residual.
    """
    if not ranking.finalists:
        return ()
    tied = {*rivals, ranking.best.name} if rivals else set()
    before = ranking.reference.heldout_residual
    explained = [before - row.fit.heldout_residual for row in ranking.finalists]
    return tuple(
        Candidate(
            r.name, r.probability, step.heldout.nrmse,
            tuple(sorted(tied - {r.name})) if r.name in tied else (),
            _correlation(one, explained[0]), r.effect.general_of,
        )
        for r, step, one in zip(ranking.finalists, alone, explained, strict=True)
    )  # fmt: skip


def among_believed(rows: Sequence[Candidate], doubted: Collection[str]) -> tuple[Candidate, ...]:
    """A ranking whose probabilities are among what is believed, and the base alone.

    That of a change that is none belongs to the steady effect that it stood in for; that of others
    which are not believed is shared out among all, in proportion.
    """
    names = {row.effect for row in rows} - set(doubted)
    chance = {row.effect: row.probability if row.effect in names else 0.0 for row in rows}
    for row in rows:
        if row.effect not in names and row.general_of in names:
            chance[row.general_of] += row.probability
    none = 1.0 - sum(row.probability for row in rows)  # that of the base alone
    left = sum(chance.values()) + (none if none > ROUNDING else 0.0)
    return tuple(
        replace(row, probability=chance[row.effect] / left if left else 0.0,
                doubted=row.effect not in names)
        for row in rows
    )  # fmt: skip


def with_general_in(rows: Sequence[Candidate], chosen: Collection[str]) -> tuple[Candidate, ...]:
    """A ranking in which effects that were chosen hold the probability of more general ones: a
    current that varies can always be a steady one, and was not clearly better.
    """
    held = {row.effect for row in rows} & set(chosen)
    chance = {row.effect: row.probability for row in rows}
    for row in rows:
        if row.general_of in held:
            chance[row.general_of] += chance[row.effect]
            chance[row.effect] = 0.0
    return tuple(replace(row, probability=min(chance[row.effect], 1.0)) for row in rows)


def _correlation(one: Floats, other: Floats) -> float:
    size = float(np.sqrt(np.sum(one**2) * np.sum(other**2)))
    return float(np.sum(one * other)) / size if size > 0.0 else 0.0


@dataclass(frozen=True)
class ScoredFormula:
    """A short law that predicts unseen time as well as a curve, with its error there."""

    formula: Formula
    nrmse: float

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "form": self.formula.form, "text": self.formula.text, "heldout_nrmse": self.nrmse,
            "numbers": dict(self.formula.numbers), "table": dict(self.formula.values),
        }  # fmt: skip


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    noise_floor    nrmse of noise alone at most: by what the recordings state, or what is left by
                   the best step of the ladder or the curve, where that is less
    alternatives   what was not chosen, each with its own fitted numbers: every effect of the
                   ranking alone beside the base, and the rivals of later steps beside the earlier
    noise_share    standard deviation of what is left in u, v, r over that of the measured
                   velocities as the recordings state it
    curve          where something unknown is missing: the vessel with the curve, map or history
                   that predicts unseen time best; None where none does
    formula        a short law that does as well as the curve; None where none does
    start_time_ns  UTC of the first sample; 0: not known, or of several recordings
    prior          relative standard deviation that the base numbers as given were taken to have
    """

    verdict: Verdict
    summary: str
    base_changed: bool
    effects: tuple[str, ...]
    ladder: tuple[LadderStep, ...]
    ranking: tuple[Candidate, ...]
    unexplained: float
    depends_on: tuple[Dependence, ...]
    refused: tuple[Refusal, ...]
    noise_floor: float
    noise_share: tuple[float, float, float]
    prior: float
    suggested: tuple[SuggestedManoeuvre, ...] = ()
    alternatives: tuple[LadderStep, ...] = ()
    curve: LadderStep | None = None
    formula: ScoredFormula | None = None
    start_time_ns: int = 0

    @property
    def best(self) -> LadderStep:
        """What predicts unseen time best: the curve where there is one, else the last step."""
        return self.curve or self.ladder[-1]

    @property
    def curve_stands_alone(self) -> bool:
        """Whether the curve does without the effects of the last step: these only come near."""
        return self.curve is not None and not set(self.effects) <= set(self.curve.effects)

    @property
    def base_may_hold(self) -> bool:
        """Whether the numbers as given err so little, and nothing else was found, that others may
        do better by errors of the measured velocities that last: an exact file is no better known.
        """
        most = thresholds.MAX_FLOORS_OF_GIVEN * self.noise_floor
        return self.verdict is Verdict.ADEQUATE and self.ladder[0].heldout.nrmse <= most

    @property
    def vessel(self) -> Vessel:
        """The best model found."""
        return self.best.vessel

    @property
    def told_ranking(self) -> tuple[Candidate, ...]:
        """The ranking as it is told: probabilities are among what is believed, and where something
        was found among what lowers the error on unseen time too. That of what can always stand in
        for what was found is counted there.
        """
        doubted = {refusal.effect for refusal in self.refused if refusal.doubted}
        if self.effects:
            least = min(self.ladder[i].heldout.nrmse for i in (0, 1))
            rest = (row for row in self.ranking if row.effect not in self.effects)
            doubted |= {row.effect for row in rest if row.heldout_nrmse >= least}
        return with_general_in(among_believed(self.ranking, doubted), self.effects)

    @property
    def next_manoeuvre(self) -> str | None:
        """The best of those suggested, in words."""
        return self.suggested[0].description if self.suggested else None

    def to_pandas(self) -> Any:
        """One row per step of the ladder, then per alternative: effects, error, interval."""
        kinds = (("ladder", self.ladder), ("alternative", self.alternatives))
        return data_frame([
            {"kind": kind, "effects": ", ".join(step.effects), "base": str(step.base),
             "heldout_nrmse": step.heldout.nrmse,
             "low": step.heldout.ci95[0] if step.heldout.ci95 else None,
             "high": step.heldout.ci95[1] if step.heldout.ci95 else None}
            for kind, steps in kinds
            for step in steps
        ])  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """What `shadow diagnose --json` prints."""
        return {
            "verdict": str(self.verdict), "summary": self.summary,
            "prior": self.prior, "base_changed": self.base_changed, "effects": list(self.effects),
            "ladder": [step.to_dict() for step in self.ladder],
            "alternatives": [step.to_dict() for step in self.alternatives],
            "ranking": [row.to_dict() for row in self.told_ranking],
            "unexplained": self.unexplained,
            "depends_on": [
                {"on": d.on, "share": d.share, "says": d.description} for d in self.depends_on
            ],
            "refused": [
                {"effect": r.effect, "because": r.reason} | ({"doubted": True} if r.doubted else {})
                for r in self.refused
            ],
            "next_manoeuvre": self.next_manoeuvre,
            "suggested": [
                {"manoeuvre": s.manoeuvre.name, "seconds": s.seconds, "nats": s.nats}
                for s in self.suggested
            ],
            "noise_floor_nrmse": self.noise_floor,
            "assumed": [each.to_dict() for each in self.ladder[-1].assumed],
            "noise_share": list(self.noise_share),
            "curve": None if self.curve is None else self.curve.to_dict(),
            "formula": None if self.formula is None else self.formula.to_dict(),
            "vessel": self.vessel.name,
        }  # fmt: skip


def _number(e: Estimate) -> dict[str, Any]:
    return {"value": e.value, "ci95": list(e.ci95), "unit": e.unit} | (
        {"doubt": e.doubt} if e.doubt else {}
    )
