"""What all fits of a diagnosis share: one model that holds every effect, and one set of runs.

The superset model holds all effects at once, each switched off until a hypothesis asks for it.
Compiled once, it tries any effect beside any other without a new kernel: three seconds on a new
machine, then from the cache. An effect that cannot be switched off by its numbers (a lag, a sagging
battery), or that needs memory, comes beside all of these in a second one. All hypotheses are judged
on the same runs, the same whitening, the same blocks of time.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis import thresholds
from sim.effects.effect import Effect, Values
from sim.identification import IdentifySettings
from sim.identification.noise import Noise
from sim.identification.parameters import Unknowns
from sim.identification.runs import RunSet, TrialTrack
from sim.identification.search import start_points
from sim.identification.shooting import (
    FitInputs,
    build_run_set,
    coloured_runs,
    deviance_of_runs,
    noise_of_runs,
)
from sim.kernel.generator import Structure
from sim.model import Model, structure_of
from sim.prediction.segments import BLOCK_S, GUARD_S
from sim.state import Floats, Ints
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel


@dataclass(frozen=True)
class SupersetModel:
    """A vessel, and the model that holds all of `effects` switched off beside it.

    measured   names of the effects whose cause all trials measured
    """

    vessel: Vessel
    model: Model
    effects: tuple[Effect, ...]
    measured: frozenset[str] = frozenset()

    @classmethod
    def of(
        cls, vessel: Vessel, effects: Iterable[Effect], trials: Sequence[Trial] = ()
    ) -> "SupersetModel":
        """The vessel with every effect that can be switched off."""
        some = possible_beside(vessel, effects)
        added = switched_off(some)
        model = Model.of(vessel.with_effects(*added))
        measured = frozenset(e.name for e in some if _is_measured(e, trials))
        return cls(vessel, model, tuple(a.effect for a in added), measured)

    def free_names(self, effect: Effect) -> list[str]:
        """Numbers that a fit with the effect moves, as the model names them: its own, or those of
        the vessel where all trials measured what they stand for.
        """
        names = effect.fit_parameters
        if effect.measured is not None and effect.name in self.measured:
            names = effect.measured.fitted
        own = effect.fit_parameters
        return [f"{effect.name}.{key}" if key in own else key for key in names]

    def starts(self, effect: Effect, model: Model, trials: Sequence[Trial]) -> list[Values]:
        """Where a search for an effect begins, beside what a model holds: what trials measured
        needs no search.
        """
        if effect.measured is not None and effect.name in self.measured:
            return [effect.measured.values]
        return start_points(effect, model, trials)

    def with_added(self, added: Sequence[AddedEffect]) -> Model:
        """A model of the vessel with these effects, the others switched off; whether their numbers
        are the boat's or of a day, they say.
        """
        names, given = {e.name for e in self.effects}, {a.effect.name: a.effect for a in added}
        own = [a for a in added if a.effect.name not in names]
        model = self._beside(own) if own else self.model
        every = (
            replace(a, effect=given.get(a.effect.name, a.effect)) for a in model.vessel.effects
        )
        model = replace(model, vessel=replace(model.vessel, effects=tuple(every)))
        theta = model.theta.copy()
        for a in added:
            for key, value in a.values.items():
                theta[model.names.index(f"{a.effect.name}.{key}")] = value
        return replace(model, theta=theta)

    def _beside(self, own: Sequence[AddedEffect]) -> Model:
        """A model that holds these effects too, of whatever numbers; composed once for a set."""
        vessel, names = self.model.vessel.with_effects(*own), tuple(a.effect.name for a in own)
        if names not in self._composed:
            self._composed[names] = Model.of(vessel)
        return replace(self._composed[names], vessel=vessel)

    @cached_property
    def _composed(self) -> dict[tuple[str, ...], Model]:
        """Models with other effects beside all that can be switched off, by their names."""
        return {}


def possible_beside(vessel: Vessel, effects: Iterable[Effect]) -> list[Effect]:
    """Effects that the vessel has not yet and that need nothing that it lacks."""
    present = {added.effect.name for added in vessel.effects}
    return [e for e in effects if e.name not in present and not vessel.unmet_needs(e)]


def switched_off(effects: Iterable[Effect]) -> list[AddedEffect]:
    """Those of some effects that can be switched off, so."""
    neutral = [(e, neutral_values(e)) for e in effects]
    return [AddedEffect(e, values) for e, values in neutral if values is not None]


def kernels_of_a_diagnosis(vessel: Vessel, effects: Iterable[Effect]) -> list[Structure]:
    """The kernels that a diagnosis needs whatever it finds, in the order in which it needs them."""
    some = possible_beside(vessel, effects)
    off = switched_off(some)
    names = {a.effect.name for a in off}
    apart = [
        AddedEffect(e, {p.name: p.start for p in e.parameters}) for e in some if e.name not in names
    ]
    curves = [[one] for one in apart if one.effect.is_curve]
    wholes = [[*off, one] for one in apart if not one.effect.is_curve]
    return [structure_of(vessel.with_effects(*added)) for added in ([], off, *wholes, *curves)]


def _is_measured(effect: Effect, trials: Sequence[Trial]) -> bool:
    """Whether every trial measured the cause of an effect over nearly all of its usable time."""
    if effect.measured is None or not trials:
        return False
    known = [np.isfinite(getattr(t, effect.measured.column)[t.usable]) for t in trials]
    return all(
        np.mean(k.reshape(len(k), -1).all(axis=1)) > thresholds.MIN_MEASURED_SHARE for k in known
    )


def neutral_values(effect: Effect) -> Mapping[str, float] | None:
    """Parameters with which the effect does nothing; None where its numbers cannot say so.

    Still air resists a boat that moves, so wind cannot be switched off. Mixed-up plugs are few
    enough for a kernel of their own, and would slow all others down.
    """
    apart = effect.is_curve or effect.thrust_rate or effect.angle_rate or effect.rate
    if apart or effect.wiring or all(p.neutral is None for p in effect.parameters):
        return None
    return {p.name: p.start if p.neutral is None else p.neutral for p in effect.parameters}


class ResidualPlaces(NamedTuple):
    """Of each residual (N,): begin and end of its run [s], number of its trial, and of its block.

    The block of time is the one that the run begins in.
    """

    begin: Floats
    end: Floats
    trial: Ints
    block: Ints


@dataclass(frozen=True)
class FitProblem:
    """Runs of all trials with noise and starts as the reference model found them.

    vessel  as it was given; tracks: the motion that the runs start from
    """

    vessel: Vessel
    trials: tuple[Trial, ...]
    settings: IdentifySettings
    tracks: tuple[TrialTrack, ...]
    noise: tuple[Noise, ...]
    run_sets: tuple[RunSet, ...]

    @classmethod
    def of(
        cls, vessel: Vessel, trials: Sequence[Trial], unknowns: Unknowns, z: Floats,
        noise: Sequence[Noise], settings: IdentifySettings, tracks: tuple[TrialTrack, ...] = (),
    ) -> "FitProblem":  # fmt: skip
        """Runs as the model of `unknowns` at z (n,) allows them; `tracks`: default as measured."""
        tracks = tracks or tuple(FitInputs(unknowns, trials, settings).tracks())
        run_sets = tuple(
            build_run_set(track, unknowns, z, n, settings.horizons[-1], settings)
            for track, n in zip(tracks, noise, strict=True)
        )
        return cls(vessel, tuple(trials), settings, tracks, tuple(noise), run_sets)

    def run_sets_for(self, unknowns: Unknowns, z: Floats) -> tuple[RunSet, ...]:
        """The same runs for another model with numbers z (n,), all else the same."""
        if unknowns.model.kernel is self.run_sets[0].model.kernel:
            return self.run_sets
        return tuple(_with_model(runs, unknowns, z) for runs in self.run_sets)

    @property
    def is_coloured(self) -> bool:
        """Whether its residuals are under a colour."""
        return any(runs.is_coloured for runs in self.run_sets)

    def under_colour_of(self, unknowns: Unknowns, z: Floats) -> "FitProblem":
        """The same under the colour of what a model with numbers z (n,) leaves of each trial."""
        coloured = [coloured_runs(w, unknowns, z) for w in self.run_sets_for(unknowns, z)]
        pairs = zip(self.run_sets, coloured, strict=True)
        return replace(self, run_sets=tuple(replace(w, chain=c.chain) for w, c in pairs))

    def noise_of(self, unknowns: Unknowns, z: Floats) -> tuple[Noise, ...]:
        """Of each trial, as a model with numbers z (n,) leaves it."""
        return tuple(noise_of_runs(w, unknowns, z) for w in self.run_sets_for(unknowns, z))

    def deviance(self, unknowns: Unknowns, z: Floats) -> float:
        """−2 log likelihood of numbers z (n,) under the noise that they leave themselves."""
        return sum(deviance_of_runs(w, unknowns, z) for w in self.run_sets_for(unknowns, z))

    def stiffness(self, unknowns: Unknowns, z: Floats) -> float:
        """Integration steps at z (n,) over those that a boat needs: 1, or more where the hull is
        stiff (its turning damped within a few hundredths of a second, say).
        """
        found = [1.0]
        for i, trial in enumerate(self.trials):
            theta, fastest = unknowns.theta(z[None], i), np.abs(trial.nu[trial.usable]).max(axis=0)
            step = trial.dt / unknowns.model.steps_in(trial.dt, theta, fastest)
            found.append(min(trial.dt, thresholds.SHORTEST_SCREENED_STEP_S) / step)
        return max(found)

    def thinned(self, rows: int) -> "FitProblem":
        """Every so many of the runs, so that about so many rows are left."""
        step = max(round(len(self.block) / (3 * rows)), 1)
        return replace(self, run_sets=tuple(runs.subset(step) for runs in self.run_sets))

    @cached_property
    def places(self) -> ResidualPlaces:
        """Where in time each residual belongs."""
        parts = zip(*map(_places, self.run_sets), strict=True)
        begin, end, trial = (np.concatenate(part) for part in parts)
        label = trial * 1e6 + np.floor(begin / BLOCK_S)
        block = np.asarray(np.unique(label, return_inverse=True)[1], np.int64)
        return ResidualPlaces(begin, end, trial, block)

    @property
    def block(self) -> Ints:
        """Number of the block of time of each residual (N,)."""
        return self.places.block

    def fold_at(self, trial: int, time: Floats) -> Ints:
        """Times (T,) of a trial -> the fold that holds them out (T,)."""
        mine = np.flatnonzero(self.places.trial == trial)
        if len(mine) == 0:
            return np.zeros(len(time), np.int64)
        begin, block = self.places.begin[mine], self.block[mine]
        at = np.clip(np.searchsorted(begin, time, side="right") - 1, 0, len(mine) - 1)
        return np.asarray(block[at] % thresholds.FOLDS, np.int64)

    @cached_property
    def folds(self) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Residuals to fit and residuals held out, a guard between: every fourth block each."""
        begin, end, trial, block = self.places
        out = []
        for k in range(thresholds.FOLDS):
            heldout = block % thresholds.FOLDS == k
            fit = ~heldout
            for b in np.unique(block[heldout]):
                inside = block == b
                near = trial == trial[inside][0]
                first, last = begin[inside].min() - GUARD_S, end[inside].max() + GUARD_S
                fit &= ~(near & (end > first) & (begin < last))
            out.append((fit, heldout))
        return out


def nats_of(deviance: float) -> float:
    """Nats that a difference of −2 log likelihood is worth, several rows counting as one."""
    return 0.5 * deviance / thresholds.ROWS_PER_INDEPENDENT_ROW


def _with_model(runs: RunSet, unknowns: Unknowns, z: Floats) -> RunSet:
    theta = unknowns.theta(z[None], runs.source.number)[0]
    model = replace(unknowns.model, theta=theta)
    return replace(runs, model=model)


def _places(runs: RunSet) -> tuple[Floats, Floats, Ints]:
    """Begin, end, number of the trial of each residual of one trial."""
    trial, rows = runs.source.trial, runs.rows
    inside = runs.within > 0
    first, last = rows.first, np.minimum(rows.first + rows.size - 1, len(trial) - 1)
    begin, end = (
        np.repeat(np.broadcast_to(trial.time[at][:, None], inside.shape)[inside], 3)
        for at in (first, last)
    )
    return begin, end, np.full(len(begin), runs.source.number, np.int64)
