"""The numbers of a fit with their intervals, and the vessel that they make."""

from collections.abc import Mapping, Sequence

from sim.diagnosis.events import interval
from sim.diagnosis.fit import Fit
from sim.effects.effect import Kind
from sim.identification.applied import applied
from sim.identification.estimate import NUISANCE, Estimate, estimates_of
from sim.identification.intervals import spread_of
from sim.identification.shooting import Shot
from sim.vessel import Vessel


def estimates_in(
    fit: Fit, trials: Sequence[str]
) -> tuple[tuple[Estimate, ...], Mapping[str, tuple[Estimate, ...]]]:
    """Base numbers, and those of each effect; a choice has no interval."""
    ground = fit.ground
    shot = Shot(
        fit.z, fit.residual, fit.slope, fit.weight, ground.begin, ground.voyage, ground.noise,
        ground.voyages,
    )  # fmt: skip
    spread = spread_of(fit.unknowns, shot, ground.settings.block)
    every = estimates_of(fit.unknowns, fit.z, spread, trials)
    base = tuple(e for e in every if "." not in e.name and e.name not in NUISANCE)
    of = {name: tuple(e for e in every if e.name.startswith(f"{name}.")) for name in fit.names}
    for name in fit.names:
        of[name] = (*of[name], *_held(fit, name, {e.name for e in of[name]}))
    return base, of


def _held(fit: Fit, effect: str, there: set[str]) -> list[Estimate]:
    """Numbers that have no slope: moments of events, and what was chosen among some."""
    known = {p.name: p for a in fit.added if a.effect.name == effect for p in a.effect.parameters}
    out = []
    for key, value in fit.values(effect).items():
        name = f"{effect}.{key}"
        if name not in there:
            event = known[key].kind is Kind.MOMENT
            ends = interval(fit, name) if event else (value, value)
            out.append(Estimate(name, known[key].unit, value, value, ends, True))
    return out


def vessel_of(fit: Fit, trial: int = 0) -> Vessel:
    """The vessel with the effects and numbers of a fit, as on one trial."""
    theta, model = fit.unknowns.theta(fit.z[None], trial)[0], fit.unknowns.model
    vessel = fit.ground.vessel
    own = {u.name for u in fit.unknowns.each if u.name in model.names}
    own -= {f"{a.effect.name}.{key}" for a in fit.added for key in a.values}
    changed = {name: float(theta[model.names.index(name)]) for name in own}
    return applied(vessel, changed).with_effects(*fit.found(trial))
