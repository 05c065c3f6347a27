"""Where the search for an effect's parameters begins: the points of a grid, effect by effect.

A number starts where its effect says, on either side of zero where it may have either sign; a
direction at the four quarters; a moment every so often along the trial, because nothing changes
until it passes a sample; a choice at each of its values. Waves start where `sim.diagnosis.starts`
finds them.

Where a train of waves would be looked for: matched filters over frequency and direction.

    A_w(ω, θ) = mean over window w of f_θ exp −i (ω t − ω² s_θ / g)

f_θ is the missing force along direction θ, s_θ the place along it. A boat that has moved by s meets
waves ω² s / g later: over a whole voyage that is many turns of phase, so direction and frequency
must be met more closely than any step of a fit can mend. Over short windows the peak is broad: they
are searched whole, Σ_w |A_w|²; the few best are followed through windows three times as long, and
steps a third as wide, up to the whole voyage. Source: Fossen, Handbook of Marine Craft
Hydrodynamics, 2nd ed. 2021, §10.2 (dispersion of waves on deep water).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sim.effects.effect import Effect, Kind, Parameter
from sim.effects.wave_motion import GRAVITY
from sim.model import Model
from sim.prediction.missing_force import lacking
from sim.state import Eta, Floats
from sim.trial import Trial
from sim.vessel import Vessel

Start = Mapping[str, float]

QUARTERS = (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)
THIRDS = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)
MOMENTS = 12  # along a trial
PERIODS = 7
LONGEST = 2.0  # of the length of the trials: a longer period is a trend


def starts_of(effect: Effect, model: Model, trials: Sequence[Trial]) -> list[Start]:
    """All points that a search for the effect starts from."""
    if effect.name == "actuator_wiring":
        return wirings(model.vessel)
    if effect.name == "wave_motion":
        return waves(model, max(trials, key=len))
    longest = max(float(t.time[-1]) for t in trials)
    values = [_values(p, _linear(effect, p), model.vessel, longest) for p in effect.parameters]
    names = [p.name for p in effect.parameters]
    return [dict(zip(names, point, strict=True)) for point in product(*values)]


def searched(effect: Effect) -> tuple[str, ...]:
    """The parameters that a small step tells something of: those that a fit moves."""
    return tuple(p.name for p in effect.parameters if p.kind in (Kind.NUMBER, Kind.CIRCLE))


def _linear(effect: Effect, p: Parameter) -> bool:
    """A direction whose north and east parts act in proportion is met from anywhere."""
    return p.name == "direction" and effect.name != "steady_wind"


def _values(p: Parameter, linear: bool, vessel: Vessel, longest: float) -> Sequence[float]:
    if p.kind is Kind.MOMENT:
        return [float(t) for t in np.linspace(0.0, longest, MOMENTS + 2)[1:-1]]
    if p.kind is Kind.CHOICE:
        return [float(i + 1) for i in range(len(vessel.thrusters))]
    if p.name == "period":
        shortest = max(p.lower, 1.5 * FINEST)
        return [float(t) for t in np.geomspace(max(shortest, 30.0), LONGEST * longest, PERIODS)]
    if p.kind is Kind.CIRCLE and not linear:
        return THIRDS if p.name == "phase" else QUARTERS
    return (p.start, -p.start) if p.lower == -p.upper and p.start != 0.0 else (p.start,)


def wirings(vessel: Vessel) -> list[Start]:
    """Plugs of port and starboard swapped, single motors or all of them the wrong way round."""
    count = len(vessel.actuators)
    own = "".join(str(i + 1) for i in range(count))
    all_motors = "".join(str(i + 1) for i in range(len(vessel.thrusters)))
    orders = [0.0, float(_mirrored(vessel))] if _mirrored(vessel) != own else [0.0]
    turned = [0.0, *(float(i + 1) for i in range(count)), float(all_motors or 0)]
    points = [{"order": o, "reversed": r} for o in orders for r in dict.fromkeys(turned)]
    return [p for p in points if p["order"] or p["reversed"]]


def _mirrored(vessel: Vessel) -> str:
    """Each thruster hears what was meant for the one on the other side."""
    place = [np.array(t.position) for t in vessel.thrusters]
    digits = []
    for p in place:
        away = [float(np.hypot(*(q - p * [1.0, -1.0]))) for q in place]
        digits.append(str(int(np.argmin(away)) + 1))
    digits += [str(i + 1) for i in range(len(place), len(vessel.actuators))]
    return "".join(digits)


FINEST = 0.8  # rad/s where waves begin; slower ones are currents and gusts
FASTEST = 6.0  # rad/s
EVERY = 0.4  # s between the samples that are looked at
WINDOW = 50.0  # s, the first
LONGER = 3  # times, the next
OMEGAS = 0.04  # rad/s between frequencies of the first look
DIRECTIONS = 96  # of the first look
FOLLOWED = 8  # of its best points
TRAINS = 2  # the second in what the first leaves: side lobes of a strong one are no train
GRID = np.arange(-3, 4)  # steps to either side


@dataclass(frozen=True)
class _Sea:
    """What is searched: time (T,), place and missing force north and east (T, 2) [s, m, N]."""

    time: Floats
    place: Floats
    force: Floats

    def filtered(self, omega: Floats, direction: Floats) -> Floats:
        """Frequencies (...) and directions (...) -> demodulated force (..., T), complex."""
        unit = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        along, force = unit @ self.place.T, unit @ self.force.T
        turn = omega[..., None] * self.time - (omega**2 / GRAVITY)[..., None] * along
        return np.asarray(force * np.exp(-1j * turn))

    def without(self, train: Mapping[str, float]) -> "_Sea":
        """What one train leaves."""
        unit = np.array([np.cos(train["direction"]), np.sin(train["direction"])])
        along = (train["omega"] ** 2 / GRAVITY) * (self.place @ unit)
        push = train["force"] * np.sin(train["omega"] * self.time - along + train["phase"])
        return replace(self, force=self.force - push[:, None] * unit)

    def power(self, omega: Floats, direction: Floats, window: float) -> Floats:
        """Σ over windows of |A|²: (...)."""
        first = np.flatnonzero(np.diff(self.time // window, prepend=-1.0))
        sums = np.add.reduceat(self.filtered(omega, direction), first, axis=-1)
        return np.asarray((np.abs(sums) ** 2).sum(axis=-1))


def waves(model: Model, trial: Trial) -> list[Mapping[str, float]]:
    """The strongest trains in what a model leaves: force, omega, direction, phase."""
    sea, found = _left(model, trial), []
    for _ in range(TRAINS):
        found.append(_strongest(sea))
        sea = sea.without(found[-1])
    return found


def _strongest(sea: _Sea) -> Mapping[str, float]:
    length = float(np.ptp(sea.time))
    window, d_omega, d_theta = WINDOW, OMEGAS, 2.0 * np.pi / DIRECTIONS
    points = _first_look(sea, window, d_omega, d_theta)
    while window < length:
        window, d_omega, d_theta = LONGER * window, d_omega / LONGER, d_theta / LONGER
        points = [_nearby(sea, p, window, d_omega, d_theta) for p in points]
    means = [sea.filtered(np.array([w]), np.array([t])).mean() for w, t in points]
    best = int(np.argmax(np.abs(means)))
    return {
        "force": 2.0 * float(np.abs(means[best])),
        "omega": points[best][0],
        "direction": points[best][1],
        "phase": (float(np.angle(means[best])) + 0.5 * np.pi) % (2.0 * np.pi),
    }


def _left(model: Model, trial: Trial) -> _Sea:
    """The missing force in the world without its mean, every so often."""
    found, yaw = lacking(trial, model), trial.eta[:, Eta.YAW]
    c, s = np.cos(yaw), np.sin(yaw)
    world = np.stack([c * found[:, 0] - s * found[:, 1], s * found[:, 0] + c * found[:, 1]], 1)
    use = trial.usable
    world = (world - world[use].mean(axis=0))[use]
    every = max(round(EVERY / trial.dt), 1)
    return _Sea(trial.time[use][::every], trial.eta[use, : Eta.YAW][::every], world[::every])


def _first_look(
    sea: _Sea, window: float, d_omega: float, d_theta: float
) -> list[tuple[float, float]]:
    """The best points of the whole grid."""
    fastest = min(FASTEST, 0.7 * np.pi / float(np.median(np.diff(sea.time))))
    omega = np.arange(FINEST, fastest, d_omega)
    theta = d_theta * np.arange(DIRECTIONS)
    found = np.stack([sea.power(omega, np.full(len(omega), t), window) for t in theta])
    best = np.argsort(found, axis=None)[::-1][:FOLLOWED]
    at_theta, at_omega = np.unravel_index(best, found.shape)
    return [(float(omega[j]), float(theta[i])) for i, j in zip(at_theta, at_omega, strict=True)]


def _nearby(
    sea: _Sea, point: tuple[float, float], window: float, d_omega: float, d_theta: float
) -> tuple[float, float]:
    """The best point of a finer grid around one."""
    omega, theta = np.meshgrid(point[0] + d_omega * GRID, point[1] + d_theta * GRID)
    best = np.unravel_index(np.argmax(sea.power(omega, theta, window)), omega.shape)
    return float(omega[best]), float(theta[best])
