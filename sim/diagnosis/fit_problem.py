"""One vessel that holds every effect at once, each switched off until a hypothesis asks for it.

Compiled once, this wide model tries any effect beside any other without a new kernel: three
seconds on a new machine, then from the cache. An effect that cannot be switched off by its numbers
(a lag, a sagging battery), or that needs memory, comes beside all of these in a second one.

What all hypotheses are judged on: the same runs, the same whitening, the same blocks of time.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.effects.effect import Effect
from sim.identification.noise import Noise
from sim.identification.parameters import Unknowns
from sim.identification.runs import RunSet, TrialTrack
from sim.identification.settings import IdentifySettings
from sim.identification.shooting import FitInputs, build_run_set
from sim.model import Model
from sim.prediction.free_runs import memory_at
from sim.prediction.segments import GUARD_S
from sim.state import Floats, Ints
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel


@dataclass(frozen=True)
class SupersetModel:
    """A vessel, and the model that holds all `within` switched off beside it."""

    vessel: Vessel
    model: Model
    within: tuple[Effect, ...]

    @classmethod
    def of(cls, vessel: Vessel, effects: Iterable[Effect]) -> "SupersetModel":
        """The vessel with every effect that can be switched off."""
        there = {added.effect.name for added in vessel.effects}
        within = tuple(
            e for e in effects
            if e.name not in there and neutral(e) is not None and not vessel.unmet_needs(e)
        )  # fmt: skip
        added = [AddedEffect(e, neutral(e) or {}) for e in within]
        return cls(vessel, Model.of(vessel.with_effects(*added)), within)

    def with_added(self, added: Sequence[AddedEffect]) -> Model:
        """A model of the vessel with these effects, the others switched off."""
        names = {e.name for e in self.within}
        own = [a for a in added if a.effect.name not in names]
        model = Model.of(self.model.vessel.with_effects(*own)) if own else self.model
        values = {f"{a.effect.name}.{key}": v for a in added for key, v in a.values.items()}
        return replace(model, theta=_set(model, values))


def neutral(effect: Effect) -> Mapping[str, float] | None:
    """Parameters with which the effect does nothing; None where its numbers cannot say so.

    Still air resists a boat that moves, so wind cannot be switched off. Mixed-up plugs are few
    enough for a kernel of their own, and would slow all others down.
    """
    states = effect.thrust_rate or effect.angle_rate or effect.rate
    if states or effect.wiring or all(p.neutral is None for p in effect.parameters):
        return None
    return {p.name: p.start if p.neutral is None else p.neutral for p in effect.parameters}


def _set(model: Model, values: Mapping[str, float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    theta = model.theta.copy()
    for name, value in values.items():
        theta[model.names.index(name)] = value
    return theta


FOLDS = 4
SCREENED = 25.0  # s, blocks of a quick look


@dataclass(frozen=True)
class FitProblem:
    """Runs of all trials with noise and starts as the reference model found them.

    vessel  as it was given
    block   (N,) number of the block of time of each residual
    begin, end (N,) [s] of the run that it belongs to; voyage (N,)
    """

    vessel: Vessel
    trials: tuple[Trial, ...]
    settings: IdentifySettings
    voyages: tuple[TrialTrack, ...]
    noise: tuple[Noise, ...]
    windows: tuple[RunSet, ...]
    block: Ints
    begin: Floats
    end: Floats
    voyage: Ints

    @classmethod
    def of(
        cls,
        vessel: Vessel,
        trials: Sequence[Trial],
        unknowns: Unknowns,
        z: Floats,
        noise: Sequence[Noise],
        settings: IdentifySettings,
        block: float,
        voyages: tuple[TrialTrack, ...] | None = None,
    ) -> "FitProblem":
        """Runs as the model of `unknowns` at z (n,) allows them; blocks of so many seconds.

        `voyages`: the motion that runs start from, where it is not the measured one.
        """
        if voyages is None:
            voyages = tuple(FitInputs(unknowns, trials, settings).tracks())
        windows = tuple(
            build_run_set(v, unknowns, z, n, settings.horizons[-1], settings)
            for v, n in zip(voyages, noise, strict=True)
        )
        return _laid_out(vessel, tuple(trials), settings, voyages, tuple(noise), windows, block)

    def seen_by(self, unknowns: Unknowns, z: Floats) -> tuple[RunSet, ...]:
        """The same windows for another model: its own kernel and memory, all else the same."""
        if unknowns.model.kernel is self.windows[0].model.kernel:
            return self.windows
        return tuple(_for(w, unknowns, z) for w in self.windows)

    def thinned(self, rows: int) -> "FitProblem":
        """Every so many of the runs, so that about so many rows are left."""
        step = max(round(len(self.block) / (3 * rows)), 1)
        windows = tuple(_every(w, step) for w in self.windows)
        return _laid_out(
            self.vessel, self.trials, self.settings, self.voyages, self.noise, windows, SCREENED
        )

    def fold_at(self, trial: int, time: Floats) -> Ints:
        """Times (T,) of a trial -> the fold that holds them out (T,)."""
        mine = np.flatnonzero(self.voyage == trial)
        if len(mine) == 0:
            return np.zeros(len(time), np.int64)
        begin, block = self.begin[mine], self.block[mine]
        at = np.clip(np.searchsorted(begin, time, side="right") - 1, 0, len(mine) - 1)
        return np.asarray(block[at] % FOLDS, np.int64)

    def folds(self) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Residuals to fit and residuals to judge by, a guard between: every fourth block each."""
        out = []
        for k in range(FOLDS):
            judge = self.block % FOLDS == k
            fit = ~judge
            for b in np.unique(self.block[judge]):
                inside = self.block == b
                near = self.voyage == self.voyage[inside][0]
                first, last = self.begin[inside].min() - GUARD_S, self.end[inside].max() + GUARD_S
                fit &= ~(near & (self.end > first) & (self.begin < last))
            out.append((fit, judge))
        return out


def _laid_out(
    vessel: Vessel,
    trials: tuple[Trial, ...],
    settings: IdentifySettings,
    voyages: tuple[TrialTrack, ...],
    noise: tuple[Noise, ...],
    windows: tuple[RunSet, ...],
    block: float,
) -> FitProblem:
    begin, end, voyage = (np.concatenate(part) for part in zip(*map(_places, windows), strict=True))
    return FitProblem(
        vessel,
        trials,
        settings,
        voyages,
        noise,
        windows,
        numbered(begin, voyage, block),
        begin,
        end,
        voyage,
    )


def _every(window: RunSet, step: int) -> RunSet:
    """Every so many of its runs."""
    return replace(
        window, rows=window.rows.every(step), within=window.within[::step],
        memory=window.memory[::step], basis=window.basis[::step],
        whitener=None if window.whitener is None else window.whitener[::step],
    )  # fmt: skip


def _for(window: RunSet, unknowns: Unknowns, z: Floats) -> RunSet:
    number, trial = window.source.number, window.source.trial
    model = replace(unknowns.model, theta=unknowns.theta(z[None], number)[0])
    return replace(window, model=model, memory=memory_at(model, trial, window.rows.first))


def _places(window: RunSet) -> tuple[Floats, Floats, Ints]:
    trial, rows = window.source.trial, window.rows
    shape = (len(rows.first), window.within.shape[1])
    inside = window.within > 0
    begin = np.broadcast_to(trial.time[rows.first][:, None], shape)[inside]
    last = np.minimum(rows.first + rows.size - 1, len(trial) - 1)
    end = np.broadcast_to(trial.time[last][:, None], shape)[inside]
    return (
        np.repeat(begin, 3), np.repeat(end, 3),
        np.full(3 * len(begin), window.source.number, np.int64),
    )  # fmt: skip


def numbered(begin: Floats, voyage: Ints, length: float) -> Ints:
    """Number of the block of time that each residual's run begins in: (N,)."""
    label = voyage * 1e6 + np.floor(begin / length)
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64)
