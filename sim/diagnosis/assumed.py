"""What had to be assumed for the numbers of effects that were found, and what that costs them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sim.effects.effect import Assumption
from sim.identification.intervals import Estimate
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
    out: dict[str | None, list[Estimate]] = {}
    for e in estimates:
        out.setdefault(e.trial, []).append(e)
    return out


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
