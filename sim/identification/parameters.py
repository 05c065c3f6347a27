"""The numbers that are looked for: by name, with bounds, scale and prior, and back into a model.

A number that holds on one voyage only (a current, a fault) is looked for once per trial. A speed
or force with a direction is looked for by its north and east parts: around zero a direction means
nothing, and a search would not find its way. A knot of a thrust curve is looked for as its share of
the next knot outward, from 0 to 1: so a curve never falls.

Three numbers of no interest are looked for along: how much later than the other streams commands
and velocities are, and how much rounder the motion is than the model's, because commands are held
from message to message and a smoother cannot follow a corner. 20 ms look like a cause otherwise,
and what is rounded costs the inertia one per cent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.effects.effect import Parameter, Scope
from sim.identification.settings import IdentifySettings
from sim.model import Model
from sim.state import Floats
from sim.vessel import KNOT_PREFIX, next_knot

OFFSETS = ("command_offset", "velocity_offset")  # s later than the other streams
OFFSET_STD, OFFSET_LIMIT = 0.03, 0.06
ROUNDING = "rounding"  # s², by which the motion's second derivative is added to it
ROUNDING_STD, ROUNDING_LIMIT = 0.001, 0.004
NUDGE = 1e-5  # of the scale: a coarse step would pass curvature off for information
ASSUMED = 3.0  # sizes that a number of a first vessel file may be off by
HELD = 1e-4  # of the scale
MASSES = ("m11", "m22", "m33")
STEEPEST = 1.5  # rad, that a blade or motor turns
UNITS = {
    "m11": "kg", "m22": "kg", "m33": "kg m²", "X_u": "N s/m", "X_uu": "N s²/m²", "Y_v": "N s/m",
    "Y_vv": "N s²/m²", "N_r": "N m s", "N_rr": "N m s²", "x_g": "m", "Y_r": "N s", "N_v": "N s",
    "Y_uv": "N s²/m²", "Y_ur": "N s²/m", "N_uv": "N s²/m", "N_ur": "N s²", "ahead": "N",
    "astern": "N", "exponent": "1", "x": "m", "y": "m", "azimuth": "rad", "angle_low": "rad",
    "angle_high": "rad", "area": "m²", "aspect": "1", "length": "m", "beam": "m", "mass": "kg",
    "area_front": "m²", "area_side": "m²", "antenna_x": "m", "antenna_y": "m",
}  # fmt: skip


class UnknownNameError(ValueError):
    """A parameter that the vessel does not have."""


@dataclass(frozen=True)
class Unknown:
    """One number: where it starts, how far it may go, how large a change matters.

    prior   standard deviation of what is known beforehand
    assumed nobody said so: the prior is there to keep what the data do not tell, and is no evidence
    trial   the only trial that it belongs to; None: all
    polar   it is the magnitude (0) or the direction (1) of a pair with the unknown beside it
    inward  it is looked for as its share of the number of this name
    direction  the parameter of the same effect that is the angle of this magnitude
    """

    name: str
    unit: str
    start: float
    lower: float
    upper: float
    scale: float
    step: float
    prior: float = np.inf
    assumed: bool = False
    trial: int | None = None
    polar: int | None = None
    inward: str | None = None
    direction: str = ""

    @property
    def size(self) -> float:
        """A change so large that it says nothing was known."""
        return self.prior / ASSUMED if self.assumed else self.prior


@dataclass(frozen=True)
class Unknowns:
    """All of them, as one vector z (n,); `model` gives what is not looked for."""

    model: Model
    each: tuple[Unknown, ...]

    def __len__(self) -> int:
        return len(self.each)

    def column(self, name: str) -> int | None:
        """Where a name stands in z."""
        names = [u.name for u in self.each]
        return names.index(name) if name in names else None

    def of_trial(self, trial: int) -> list[int]:
        """Columns of z that act on a trial."""
        return [i for i, u in enumerate(self.each) if u.trial in (None, trial)]

    @property
    def start(self) -> Floats:
        """z (n,) of the vessel as it is."""
        return self.solved(np.array([u.start for u in self.each]))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Limits (n,), (n,) of z."""
        lower = np.array([u.lower if u.polar is None else -u.upper for u in self.each])
        return lower, np.array([u.upper for u in self.each])

    def named(self, z: Floats) -> Floats:
        """z (..., n) -> the numbers by their names (..., n)."""
        out = np.array(z, dtype=float)
        for i in self._pairs():
            out[..., i] = np.hypot(z[..., i], z[..., i + 1])
            out[..., i + 1] = np.arctan2(z[..., i + 1], z[..., i])
        for i in self._from_outside:
            out[..., i] *= self._outer(i, out)
        return out

    def solved(self, values: Floats) -> Floats:
        """The numbers by their names (n,) -> z (n,)."""
        z = np.array(values, dtype=float)
        for i in self._pairs():
            z[i] = values[i] * np.cos(values[i + 1])
            z[i + 1] = values[i] * np.sin(values[i + 1])
        for i in self._from_outside:
            outer = float(self._outer(i, values))
            z[i] = values[i] / outer if outer != 0.0 else 0.5
        return z

    def theta(self, z: Floats, trial: int) -> Floats:
        """z (K, n) -> the model's parameters (K, P) on a trial."""
        theta = np.tile(self.model.theta, (len(z), 1))
        values = self.named(z)
        for i in self.of_trial(trial):
            if self.each[i].name in self.model.names:
                theta[:, self.model.names.index(self.each[i].name)] = values[:, i]
        return theta

    def offset(self, z: Floats, name: str) -> Floats:
        """z (K, n) -> one of `OFFSETS` (K,) [s]; zero where it is not looked for."""
        i = self.column(name)
        return np.zeros(len(z)) if i is None else np.asarray(z[:, i])

    @property
    def evidence(self) -> Floats:
        """Information (n, n) of what is known beforehand, without what is only assumed."""
        return np.diag([0.0 if u.assumed else u.prior**-2.0 for u in self.each])

    @property
    def assumptions(self) -> Floats:
        """Information (n, n) of what is only assumed."""
        return np.diag([u.prior**-2.0 if u.assumed else 0.0 for u in self.each])

    def held(self, which: NDArray[np.bool_]) -> "Unknowns":
        """The same with some of them (n,) held where they start."""
        return replace(
            self,
            each=tuple(
                replace(u, prior=HELD * u.scale) if hold else u
                for u, hold in zip(self.each, which, strict=True)
            ),
        )

    def prior(self, z: Floats) -> Floats:
        """z (..., n) -> residuals of the priors (..., n); zero where nothing is known."""
        return (z - self.start) / np.array([u.prior for u in self.each])

    def _outer(self, i: int, values: Floats) -> Floats:
        """The number (...) that unknown i is a share of."""
        name = str(self.each[i].inward)
        at = self.column(name)
        if at is not None:
            return np.asarray(values[..., at])
        known = dict(zip(self.model.names, self.model.theta.tolist(), strict=True))
        return np.full(values.shape[:-1], known.get(name, -1.0 if name.endswith(".-full") else 1.0))

    @cached_property
    def _from_outside(self) -> list[int]:
        """Shares of others, those first that others are shares of."""
        of = [i for i, u in enumerate(self.each) if u.inward is not None]
        return sorted(of, key=lambda i: -abs(int(self.each[i].name.rpartition(KNOT_PREFIX)[2])))

    def _pairs(self) -> list[int]:
        return [i for i, u in enumerate(self.each) if u.polar == 0]


def unknowns_of(model: Model, trials: int, settings: IdentifySettings) -> Unknowns:
    """What the settings ask for; UnknownNameError where the vessel has no such number."""
    names = _chosen(model, settings)
    limits = _effect_parameters(model)
    each: list[Unknown] = []
    for name in names:
        scope, parameter = limits.get(name, (Scope.BOAT, None))
        start = float(model.theta[model.names.index(name)])
        if name.rpartition(".")[2].startswith(KNOT_PREFIX):
            one = _knot(model, name, start)
        else:
            one = _base(model, name, start) if parameter is None else _of(name, start, parameter)
        prior = settings.priors.get(name)
        one = (
            one
            if prior is None
            else replace(one, prior=prior * max(abs(start), 1e-9), assumed=False)
        )
        where = range(trials) if scope is Scope.VOYAGE else [None]
        each += [replace(one, trial=trial) for trial in where]
    if settings.offsets:
        each += [
            Unknown(name, "s", 0.0, -OFFSET_LIMIT, OFFSET_LIMIT, OFFSET_STD, 2e-3, OFFSET_STD)
            for name in OFFSETS
        ]
        each.append(
            Unknown(
                ROUNDING, "s²", 0.0, -ROUNDING_LIMIT, ROUNDING_LIMIT, ROUNDING_STD, 1e-4,
                ROUNDING_STD,
            )
        )  # fmt: skip
    return Unknowns(model, _paired(sorted(each, key=lambda u: -1 if u.trial is None else u.trial)))


def _chosen(model: Model, settings: IdentifySettings) -> list[str]:
    """Names in the order of the model; `effect.*` stands for all that begin so, `left.curve` for
    all knots of a curve, `curve` for those of all curves."""
    named = {f"{t.name}.exponent" for t in model.vessel.thrusters}  # a file has it by a name
    known = [n for n in model.names if n not in named]

    def matching(asked: str) -> list[str]:
        whole = asked[:-1] if asked.endswith(".*") else None
        if asked.endswith(".curve"):
            whole = asked + "_"
        found = [n for n in known if n == asked or (whole and n.startswith(whole))]
        if asked == "curve":
            found = [n for n in known if n.rpartition(".")[2].startswith(KNOT_PREFIX)]
        if not found:
            raise UnknownNameError(f"no parameter {asked!r}: there are {', '.join(known)}")
        return found

    free = {n for asked in settings.free for n in matching(asked)}
    fixed = {n for asked in settings.fix for n in matching(asked)}
    priors = {n for asked in settings.priors for n in matching(asked)}
    if not free - fixed:
        raise UnknownNameError("nothing is free: every parameter is fixed")
    if priors - free:
        raise UnknownNameError(f"a prior for {', '.join(sorted(priors - free))}, which is not free")
    return [n for n in known if n in free - fixed]


def _effect_parameters(model: Model) -> dict[str, tuple[Scope, Parameter]]:
    """Names of the effects' parameters -> scope and limits; twins are marked `#2` in names."""
    out = {}
    for name in model.names:
        label, _, key = name.partition(".")
        for added in model.vessel.effects:
            if added.effect.name == label.partition("#")[0]:
                for p in added.effect.parameters:
                    if p.name == key:
                        out[name] = added.effect.scope, p
    return out


def _of(name: str, start: float, p: Parameter) -> Unknown:
    """A parameter of an effect; a start on a limit would be stuck there."""
    inside = min(max(start, p.lower), p.upper)
    wide = 0.5 * (p.upper - p.lower)
    return Unknown(
        name, p.unit, inside, p.lower, p.upper, p.scale, 0.05 * p.scale, wide, True,
        direction=p.direction,
    )  # fmt: skip


def _base(model: Model, name: str, start: float) -> Unknown:
    """A number of the vessel file, with limits that physics and the file's format set.

    It is assumed to be right to within a few times its size: what the data do not tell stays as it
    was, and what they do tell hardly notices.
    """
    scale = max(abs(start), typical(model, name))
    key = name.rpartition(".")[2]
    lower, upper = -np.inf, np.inf
    if key in (*MASSES, "ahead", "exponent", "aspect"):
        lower, upper = 0.05 * scale, 20.0 * scale
    elif key in ("X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr", "astern"):
        lower, upper = -100.0 * scale, 0.0
    elif key == "area":
        lower = 0.0
    elif key in ("angle_low", "angle_high"):
        lower, upper = (-STEEPEST, 0.0) if start < 0.0 else (0.0, STEEPEST)
    start = min(max(start, lower), upper)
    return Unknown(
        name, UNITS.get(key, ""), start, lower, upper, scale, NUDGE * scale, ASSUMED * scale, True
    )


def _knot(model: Model, name: str, start: float) -> Unknown:
    """A knot of a thrust curve: its share of the next one outward; any share is possible."""
    label, _, key = name.rpartition(".")
    own = [n.rpartition(".")[2] for n in model.names if n.startswith(f"{label}.{KNOT_PREFIX}")]
    outer = next_knot(key, own) or ("-" if "-" in key else "") + "full"
    return Unknown(name, "", start, 0.0, 1.0, 0.3, NUDGE, 1.0, True, inward=f"{label}.{outer}")


def typical(model: Model, name: str) -> float:
    """A size that a number of the vessel file might have, where the file says zero."""
    m11, m22, m33, length = (
        model.theta[model.names.index(n)] for n in ("m11", "m22", "m33", "length")
    )
    sizes = {
        "X_u": 0.5 * m11, "X_uu": m11 / length, "Y_v": 0.5 * m22, "Y_vv": m22 / length,
        "N_r": 0.5 * m33, "N_rr": 0.5 * m33, "x_g": 0.1 * length, "Y_r": 0.3 * m22 * length,
        "N_v": 0.3 * m22 * length, "Y_uv": m22 / length, "Y_ur": m22, "N_uv": m22, "N_ur": m33,
        "x": 0.1 * length, "y": 0.1 * length, "azimuth": 0.1, "ahead": 1.0, "astern": 1.0,
        "area": 0.003 * length**2, "angle_low": 0.3, "angle_high": 0.3,
    }  # fmt: skip
    return float(sizes.get(name.rpartition(".")[2], 0.1))


def _paired(each: Sequence[Unknown]) -> tuple[Unknown, ...]:
    """Magnitudes that stand before their direction, marked: both are solved as north and east."""
    out = list(each)
    for i, (a, b) in enumerate(pairwise(out)):
        label = a.name.partition(".")[0]
        if a.direction and b.name == f"{label}.{a.direction}" and a.trial == b.trial:
            out[i] = replace(a, polar=0)
            out[i + 1] = replace(
                b, polar=1, lower=0.0, upper=a.upper, scale=a.scale, step=a.step, prior=a.prior
            )
    return tuple(out)
