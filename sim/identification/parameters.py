"""The parameters that a fit estimates: by name, with bounds, scale and prior, and as one vector z.

A parameter that holds on one voyage only (a current, a fault) is estimated once per trial. A speed
or force with a direction is estimated by its north and east parts: around zero a direction means
nothing, and a search would not find its way. A knot of a thrust curve is estimated as its share of
the next knot outward, from 0 to 1: so a curve never falls.

Three nuisance parameters are estimated along: how much later than the other streams commands and
velocities are, and how much rounder the motion is than the model's, because commands are held from
message to message and a smoother cannot follow a corner. 20 ms look like a cause otherwise, and
what is rounded costs the inertia one per cent.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.effects.effect import Parameter, Scope
from sim.identification import AREAS, MASSES, IdentifySettings
from sim.identification.at_rest import AXES_AT_REST, axis_of
from sim.identification.fast_damping import AXES, Axis, sizes_of_small_damping
from sim.model import Model
from sim.near_names import did_you_mean
from sim.state import Floats
from sim.vessel import KNOT_PREFIX, next_knot

OFFSETS = ("command_offset", "velocity_offset")  # [s] later than the other streams
ROUNDING = "rounding"  # [s²] by which the motion's second derivative is added to it
DAMPING = ("X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr")
MAGNITUDE, DIRECTION = 0, 1  # of a pair that is estimated as north and east parts
# Chosen, not measured:
OFFSET_STD_S, OFFSET_LIMIT_S, OFFSET_STEP_S = 0.03, 0.06, 2e-3  # prior, bounds, difference step
ROUNDING_STD_S2, ROUNDING_LIMIT_S2, ROUNDING_STEP_S2 = 0.001, 0.004, 1e-4
BASE_STEP = 1e-5  # scales, of differences: a coarse step would pass curvature off for information
EFFECT_STEP = 0.05  # scales, of differences of an effect's parameters
ASSUMED_STD = 3.0  # scales that a number of a first vessel file may be off by
SMALLEST = 1e-9  # of a number that a prior is a share of
FIXED_STD = 1e-4  # scales: prior of a parameter that is held at its start
MAX_TURN_RAD = 1.5  # that a blade or motor turns
UNITS = {
    "m11": "kg", "m22": "kg", "m33": "kg m²", "X_u": "N s/m", "X_uu": "N s²/m²", "Y_v": "N s/m",
    "Y_vv": "N s²/m²", "N_r": "N m s", "N_rr": "N m s²", "x_g": "m", "Y_r": "N s", "N_v": "N s",
    "Y_uv": "N s²/m²", "Y_ur": "N s²/m", "N_uv": "N s²/m", "N_ur": "N s²", "ahead": "N",
    "astern": "N", "exponent": "1", "x": "m", "y": "m", "azimuth": "rad", "angle_low": "rad",
    "angle_high": "rad", "area": "m²", "aspect": "1", "length": "m", "beam": "m", "mass": "kg",
    "area_front": "m²", "area_side": "m²", "antenna_x": "m", "antenna_y": "m",
}  # fmt: skip


GROUPS = (".*", ".curve")  # behind what they are of: many numbers by one name


class UnknownNameError(ValueError):
    """A parameter that the vessel does not have."""


@dataclass(frozen=True)
class Unknown:
    """One parameter: start, bounds, scale (a change that matters), step of its differences.

    prior      standard deviation of what is known beforehand
    assumed    the prior was not given: it keeps what the data do not determine, and is no evidence
    trial      the only trial that it belongs to; None: all
    polar      MAGNITUDE or DIRECTION, of a pair with the unknown beside it; None: of no pair
    share_of   name of the parameter that it is estimated as a share of
    at_rest    why the recordings cannot tell it, where they do not move along its axis: it is held
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
    share_of: str | None = None
    direction: str = ""
    at_rest: str = ""

    @property
    def large_change(self) -> float:
        """An uncertainty so large that nothing is known of the parameter."""
        return self.prior / ASSUMED_STD if self.assumed else self.prior


@dataclass(frozen=True)
class Unknowns:
    """All unknown parameters as one vector z (n,); `model` gives what is not estimated.

    fastest  see `IdentifySettings`
    """

    model: Model
    each: tuple[Unknown, ...]
    fastest: tuple[float, float, float] | None = None

    def __len__(self) -> int:
        return len(self.each)

    def column(self, name: str) -> int | None:
        """Column of a name in z; None where it is not estimated."""
        names = [u.name for u in self.each]
        return names.index(name) if name in names else None

    def columns_of_trial(self, trial: int) -> list[int]:
        """Columns of z that act on a trial."""
        return [i for i, u in enumerate(self.each) if u.trial in (None, trial)]

    @cached_property
    def start(self) -> Floats:
        """z (n,) of the vessel as it is."""
        return _held(self.from_named(np.array([u.start for u in self.each])))

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Limits (n,), (n,) of z."""
        lower = np.array([u.lower if u.polar is None else -u.upper for u in self.each])
        return _held(lower), _held(np.array([u.upper for u in self.each]))

    @cached_property
    def prior(self) -> Floats:
        """Standard deviation (n,) of what is known beforehand."""
        held = (u.prior if not u.at_rest else FIXED_STD * u.scale for u in self.each)
        return _held(np.fromiter(held, float))

    @cached_property
    def at_rest(self) -> NDArray[np.bool_]:
        """Which (n,) are held because the boat did not move along their axis."""
        return np.array([bool(u.at_rest) for u in self.each])

    @cached_property
    def step(self) -> Floats:
        """Step (n,) of differences."""
        return _held(np.array([u.step for u in self.each]))

    def to_named(self, z: Floats) -> Floats:
        """z (..., n) -> values of the named parameters (..., n).

        Damping that is over before a row can show it stands for "as fast as the rows can tell" and
        is held there: a fit to a boat that follows its helm at once would go on to hulls without
        inertia, which take tens of steps in each row.
        """
        out = self._unlimited(z)
        for axis in self._axes:
            share = axis.share(out)
            for i in axis.damping:
                out[..., i] *= share
        return out

    def _unlimited(self, z: Floats) -> Floats:
        out = np.array(z, dtype=float)
        for i in self._pairs:
            out[..., i] = np.hypot(z[..., i], z[..., i + 1])
            out[..., i + 1] = np.arctan2(z[..., i + 1], z[..., i])
        for i in self._shares:
            out[..., i] *= self._whole(i, out)
        return out

    def from_named(self, values: Floats) -> Floats:
        """Values of the named parameters (n,) -> z (n,)."""
        z = np.array(values, dtype=float)
        for i in self._pairs:
            z[i] = values[i] * np.cos(values[i + 1])
            z[i + 1] = values[i] * np.sin(values[i + 1])
        for i in self._shares:
            whole = float(self._whole(i, values))
            z[i] = values[i] / whole if whole != 0.0 else 0.5
        return z

    def theta(self, z: Floats, trial: int) -> Floats:
        """z (K, n) -> the model's parameters (K, P) on a trial."""
        theta = np.tile(self.model.theta, (len(z), 1))
        values = self.to_named(z)
        for i in self.columns_of_trial(trial):
            if (at := self._places[i]) is not None:
                theta[:, at] = values[:, i]
        return theta

    @cached_property
    def _places(self) -> list[int | None]:
        """Index of each parameter in the model's θ; None of a nuisance."""
        where = {name: at for at, name in enumerate(self.model.names)}
        return [where.get(u.name) for u in self.each]

    def offset(self, z: Floats, name: str) -> Floats:
        """z (K, n) -> one of `OFFSETS` (K,) [s]; zero where it is not estimated."""
        i = self.column(name)
        return np.zeros(len(z)) if i is None else np.asarray(z[:, i])

    @property
    def prior_information(self) -> Floats:
        """Information (n, n) of the priors that were given."""
        return np.diag([0.0 if u.assumed else u.prior**-2.0 for u in self.each])

    @property
    def assumed_information(self) -> Floats:
        """Information (n, n) of the priors that are only assumed."""
        return np.diag([u.prior**-2.0 if u.assumed else 0.0 for u in self.each])

    def beside(self, names: Sequence[str]) -> "Unknowns":
        """With further parameters of the model, which each z then gives at its end."""
        values = dict(zip(self.model.names, self.model.theta.tolist(), strict=True))
        given = (Unknown(n, "", values[n], -np.inf, np.inf, scale=1.0, step=0.0) for n in names)
        return replace(self, each=(*self.each, *given))

    def fixed(self, which: NDArray[np.bool_]) -> "Unknowns":
        """These unknowns, those of the mask (n,) held where they start."""
        pairs = zip(self.each, which, strict=True)
        each = (replace(u, prior=FIXED_STD * u.scale) if fix else u for u, fix in pairs)
        return replace(self, each=tuple(each))

    def prior_residuals(self, z: Floats) -> Floats:
        """z (..., n) -> residuals of the priors (..., n); zero where nothing is known."""
        return (z - self.start) / self.prior

    def faster_than_rows(self, z: Floats) -> set[str]:
        """Names of damping that is held at z (n,), because it is over before a row can show it."""
        values = self._unlimited(z)
        held = [axis for axis in self._axes if axis.share(values) < 1.0]
        return {self.each[i].name for axis in held for i in axis.strong(values)}

    @cached_property
    def _axes(self) -> list[Axis]:
        if self.fastest is None:
            return []
        known = dict(zip(self.model.names, self.model.theta.tolist(), strict=True))
        known |= {u.name: u.start for u in self.each}
        return [
            Axis([self.column(n) for n in names], [known[n] for n in names], speed)
            for names, speed in zip(AXES, self.fastest, strict=True)
        ]

    def _whole(self, i: int, values: Floats) -> Floats:
        """The value (...) that unknown i is a share of."""
        name = str(self.each[i].share_of)
        at = self.column(name)
        if at is not None:
            return np.asarray(values[..., at])
        known = dict(zip(self.model.names, self.model.theta.tolist(), strict=True))
        return np.full(values.shape[:-1], known.get(name, -1.0 if name.endswith(".-full") else 1.0))

    @cached_property
    def _shares(self) -> list[int]:
        """Unknowns that are shares of others, those first that others are shares of."""
        shares = [i for i, u in enumerate(self.each) if u.share_of is not None]
        return sorted(shares, key=lambda i: -abs(int(self.each[i].name.rpartition(KNOT_PREFIX)[2])))

    @cached_property
    def _pairs(self) -> list[int]:
        return [i for i, u in enumerate(self.each) if u.polar == MAGNITUDE]


def _held(values: Floats) -> Floats:
    """The same array, that nobody can write to."""
    values.setflags(write=False)
    return values


def unknowns_of(model: Model, trials: int, settings: IdentifySettings) -> Unknowns:
    """The parameters that settings ask for; UnknownNameError where the vessel has no such one."""
    effects = _effect_parameters(model)
    values = dict(zip(model.names, model.theta.tolist(), strict=True))
    sizes = {name: max(abs(value), SMALLEST) for name, value in values.items()}
    sizes |= sizes_of_small_damping(values, settings.fastest)
    each: list[Unknown] = []
    still = {name for name, (_, p) in effects.items() if not p.is_fitted}
    for name in _chosen(model, settings, still):
        scope, parameter = effects.get(name, (Scope.BOAT, None))
        start = values[name]
        if parameter is not None:
            one = _effect_unknown(name, start, parameter)
        elif name.rpartition(".")[2].startswith(KNOT_PREFIX):
            one = _knot(model, name, start)
        else:
            one = _base(model, name, start)
        prior = settings.priors.get(name)
        if prior is not None:
            one = replace(one, prior=prior * sizes[name], assumed=False)
        if (axis := axis_of(name)) in settings.at_rest:
            one = replace(one, at_rest=AXES_AT_REST[axis])
        own = scope is Scope.VOYAGE
        each += [replace(one, trial=trial) for trial in range(trials)] if own else [one]
    if settings.offsets:
        for name in OFFSETS:
            each.append(_nuisance(name, "s", OFFSET_LIMIT_S, OFFSET_STEP_S, OFFSET_STD_S))
        each.append(_nuisance(ROUNDING, "s²", ROUNDING_LIMIT_S2, ROUNDING_STEP_S2, ROUNDING_STD_S2))
    each.sort(key=lambda u: -1 if u.trial is None else u.trial)
    return Unknowns(model, _paired(each), settings.fastest)


def _chosen(model: Model, settings: IdentifySettings, still: Container[str]) -> list[str]:
    """Names in the order of the model.

    `effect.*` stands for all that begin so but those that no fit moves (`still`: choices, moments,
    the ranges of tables), `left.curve` for all knots of a curve, `curve` for those of all curves.
    """
    named = {f"{t.name}.exponent" for t in model.vessel.thrusters}  # a file has it by a name
    known = dict.fromkeys(n for n in model.names if n not in named)

    def matching(asked: str) -> list[str]:
        if asked in known:
            return [asked]
        prefix = asked[:-1] if asked.endswith(".*") else None
        if asked.endswith(".curve"):
            prefix = asked + "_"
        names = [n for n in known if prefix and n.startswith(prefix) and n not in still]
        if asked == "curve":
            names = [n for n in known if n.rpartition(".")[2].startswith(KNOT_PREFIX)]
        if not names:
            groups = {f"{n.partition('.')[0]}{end}" for n in known if "." in n for end in GROUPS}
            meant = did_you_mean(asked, (*known, *sorted(groups)))
            raise UnknownNameError(f"no parameter {asked!r}: {meant}there are {', '.join(known)}")
        return names

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
    known = {
        (added.effect.name, p.name): (added.effect.scope, p)
        for added in model.vessel.effects
        for p in added.effect.parameters
    }
    out = {}
    for name in model.names:
        label, _, key = name.partition(".")
        found = known.get((label.partition("#")[0], key))
        if found is not None:
            out[name] = found
    return out


def _nuisance(name: str, unit: str, limit: float, step: float, std: float) -> Unknown:
    return Unknown(name, unit, 0.0, -limit, limit, std, step, std)


def _effect_unknown(name: str, start: float, p: Parameter) -> Unknown:
    """A parameter of an effect, started within its bounds."""
    if not (p.lower < p.upper and 0.0 < p.scale < np.inf):
        raise UnknownNameError(f"{name} cannot be fitted between {p.lower:g} and {p.upper:g}")
    prior = p.prior or 0.5 * (p.upper - p.lower)
    return Unknown(
        name, p.unit, min(max(start, p.lower), p.upper), p.lower, p.upper, p.scale,
        EFFECT_STEP * p.scale, prior, not p.prior, direction=p.direction,
    )  # fmt: skip


def _base(model: Model, name: str, start: float) -> Unknown:
    """A number of the vessel file, with bounds that physics and the file's format set.

    It is assumed to be right to within a few times its scale: what the data do not determine stays
    as it was, and what they do determine is hardly moved by that.
    """
    scale = max(abs(start), typical(model, name))
    key = name.rpartition(".")[2]
    lower, upper = -np.inf, np.inf
    if key in (*MASSES, "ahead", "exponent", "aspect"):
        lower, upper = 0.05 * scale, 20.0 * scale
    elif key in (*DAMPING, "astern"):
        lower, upper = -100.0 * scale, 0.0
    elif key in ("area", *AREAS):
        lower = 0.0
    elif key in ("angle_low", "angle_high"):
        lower, upper = (-MAX_TURN_RAD, 0.0) if start < 0.0 else (0.0, MAX_TURN_RAD)
    start = min(max(start, lower), upper)
    return Unknown(
        name, UNITS.get(key, ""), start, lower, upper, scale, BASE_STEP * scale,
        ASSUMED_STD * scale, True,
    )  # fmt: skip


def _knot(model: Model, name: str, start: float) -> Unknown:
    """A knot of a thrust curve: its share of the next one outward; any share is possible."""
    label, _, key = name.rpartition(".")
    own = [n.rpartition(".")[2] for n in model.names if n.startswith(f"{label}.{KNOT_PREFIX}")]
    outer = next_knot(key, own) or ("-" if "-" in key else "") + "full"
    return Unknown(
        name, "", start, 0.0, 1.0, 0.3, BASE_STEP, 1.0, True, share_of=f"{label}.{outer}"
    )


def typical(model: Model, name: str) -> float:
    """A plausible size of a number of the vessel file, for where the file has zero."""
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
    """Magnitudes before their direction are marked: both are estimated as north and east parts."""
    out = list(each)
    for i, (a, b) in enumerate(pairwise(out)):
        label = a.name.partition(".")[0]
        if a.direction and b.name == f"{label}.{a.direction}" and a.trial == b.trial:
            out[i] = replace(a, polar=MAGNITUDE)
            out[i + 1] = replace(
                b, polar=DIRECTION, lower=0.0, upper=a.upper, scale=a.scale, step=a.step,
                prior=a.prior,
            )  # fmt: skip
    return tuple(out)
