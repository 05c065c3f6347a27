"""The model of a vessel: its parameters by name, and the compiled loops on arrays."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from sim.body import Body, RudderParameters, ThrusterParameters
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Law, Role
from sim.kernel import air, floats, rollout_numpy
from sim.kernel.cache import Kernel, kernel_for
from sim.kernel.compiled import compiled
from sim.kernel.generator import Structure
from sim.state import Floats, Ints
from sim.vessel import (
    BASE,
    AddedEffect,
    Vessel,
    curve_exponent,
    knot_commands,
    knot_shares,
    table_owner,
)

# Length h of a Runge–Kutta step, against the rates λ [1/s] of the vessel
MAX_STEP_S = 0.2
ACCURATE_STEP = 0.6  # of h λ of damping at rest: the error (h λ)⁵/120 of a step is then 6e-4
STABLE_STEP = 2.0  # of h λ of the fastest motion: Runge–Kutta steps are unstable beyond 2.78
MIN_STABLE_STEP_S = 0.025  # a hull with faster motion than this allows is none: left so while …
FASTER, FASTER_BY = 1.2, 0.1  # … no run becomes faster than all starts by this factor and amount
RUNAWAY_SPEED = 1e3  # m/s, rad/s: of what is no number any more
SHORTEST_STEP_S = 1e-3  # of runs that did
SETTLED = 1e-3  # of a speed: shorter steps that change the fastest by less are short enough
MIN_LAG_STEP_S = 1e-3  # a time constant below this does not shorten steps further


@dataclass(frozen=True)
class Model:
    """A vessel, its kernel, and its parameters: names and values theta (P,)."""

    vessel: Vessel
    kernel: Kernel
    names: tuple[str, ...]
    theta: Floats

    @classmethod
    def of(cls, vessel: Vessel, kernel_of: Callable[[Structure], Kernel] = kernel_for) -> "Model":
        """Compose and compile, or load from the cache; with `plain_kernel_for` in plain Python."""
        parameters = parameters_of(vessel)
        theta = np.array(list(parameters.values()), dtype=float)
        return cls(vessel, kernel_of(structure_of(vessel)), tuple(parameters), theta)

    @property
    def state_size(self) -> int:
        """Components of a state: pose, velocity, memory of actuators and effects."""
        return self.kernel.structure.nx

    @property
    def actuator_count(self) -> int:
        """Columns of a command table (at least one)."""
        return max(len(self.vessel.actuators), 1)

    @cached_property
    def delay(self) -> float:
        """How much later all commands act [s]."""
        laws = [(a.effect.delay, a.values) for a in self.vessel.effects]
        return float(sum(law(SimpleNamespace(**values)) for law, values in laws if law))

    def simulate(
        self, commands: Floats, dt: float, x0: Floats | None = None, *,
        theta: Floats | None = None, voltage: Floats | None = None, wind: Floats | None = None,
        start_time: float = 0.0,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Commands (T, na) or (B, T, na) held over dt -> states (B, T+1, nx), reports (B, T+1, 9).

        x0 (nx,), (6,) or (B, …): missing memory starts settled under the first command. theta
        (P,) or (B, P). voltage (T,) [V], wind (T, 2) [m/s]: not measured where left out.
        """
        table = np.asarray(commands, dtype=float)
        table = table[None] if table.ndim == 2 else table
        start = np.zeros((1, 6)) if x0 is None else np.atleast_2d(np.asarray(x0, dtype=float))
        thetas = np.atleast_2d(self.theta if theta is None else theta)
        batch = max(len(table), len(start), len(thetas))
        steps = table.shape[1]
        number, none = np.arange(batch), np.zeros(batch, np.int64)
        runs = Runs(number % len(table), none, np.full(batch, steps), np.zeros(batch))
        inputs = InputTable.of(table, dt, voltage, wind, start_time)
        return self.run(np.resize(start, (batch, start.shape[1])), runs, inputs, theta=thetas)

    def run(
        self, x0: Floats, runs: "Runs", inputs: "InputTable", *, theta: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Free runs: x0 (B, 6 or nx) -> states (B, H+1, nx), reports (B, H+1, 9), NaN past ends.

        Steps short enough for the starts may be too long for what the runs reach, and then grow
        without end: such runs are made again in shorter ones, and all others from the same row,
        until that changes nothing or the steps are short enough for the speeds that are reached.
        """
        start = np.full((len(x0), self.state_size), np.nan)
        start[:, : x0.shape[1]] = x0
        thetas = np.atleast_2d(self.theta if theta is None else theta)
        first = np.abs(np.nan_to_num(x0[:, 3:6])).max(axis=0)
        needed = self.steps_in(inputs.dt, thetas, first)
        horizon = int(runs.steps.max()) + 1
        states, reports = self._rolled(start, runs, inputs, thetas, needed, horizon)
        reached, limit = _fastest(states, runs.steps), FASTER * first + FASTER_BY
        if not np.any(reached > limit):
            return states, reports
        origin, again, settled = runs.origin, np.arange(len(x0)), np.zeros(len(x0), np.bool_)

        def too_fast(rows: Ints) -> Ints:
            return np.asarray(rows[np.any(reached[rows] > limit, axis=1) & ~settled[rows]])

        while len(fast := too_fast(again)):
            stable = self.max_step(thetas, reached[again].max(axis=0), SHORTEST_STEP_S)
            substeps, needed = needed, min(_steps_in(inputs.dt, stable), 2 * needed)
            if needed <= substeps:
                break
            again = np.flatnonzero(np.isin(origin, origin[fast]))
            some, own = runs.subset(again), thetas[again % len(thetas)]
            part, seen = self._rolled(start[again], some, inputs, own, needed, horizon)
            before, now = reached[again], _fastest(part, some.steps)
            same = (np.abs(now - before) <= SETTLED * now) & (now < RUNAWAY_SPEED)
            states[again], reports[again], reached[again] = part, seen, now
            settled[again] = same.all(axis=1)
        return states, reports

    def _rolled(
        self, start: Floats, runs: "Runs", inputs: "InputTable", thetas: Floats, substeps: int,
        horizon: int,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """`run` in so many steps for each row, from whole states (B, nx)."""
        states, reports = (np.full((len(start), horizon, n), np.nan) for n in (self.state_size, 9))
        module = self.kernel.module
        (module.rollout if self.kernel.compiled else partial(rollout_numpy, module))(
            floats(thetas), floats(start), runs.table, runs.start, runs.steps, runs.delay,
            inputs.total, inputs.voltage, inputs.wind, inputs.time, inputs.dt, substeps, states,
            reports,
        )  # fmt: skip
        return states, reports

    def max_step(
        self, theta: Floats | None, nu: Floats, shortest: float = MIN_STABLE_STEP_S
    ) -> float:
        """Longest Runge–Kutta step [s] that follows the fastest lag and damping of the vessel.

        At velocities nu (3,) or (B, 3) it is also short enough to stay stable, down to `shortest`:
        damping rises with speed, and so does the Munk moment. Damping so strong that it is over
        within a few hundredths of a second (of a hull that was fitted to too little) is not
        followed, only kept stable. How closely damping is followed is decided by the vessel's own
        numbers and not by theta: all candidates of a fit take the same steps, else slopes by small
        differences would show the steps.
        """
        lags = self._time_constants
        rows = np.atleast_2d(self.theta if theta is None else theta)
        fastest_lag = float(np.min(rows[:, lags])) if lags else MAX_STEP_S
        d = self.vessel.dynamics
        damping = max(-d.X_u / d.m11, -d.Y_v / d.m22, -d.N_r / d.m33, 1e-9)
        rate_limit = STABLE_STEP / self._fastest_rate(rows, nu)
        accurate = max(ACCURATE_STEP / damping, min(rate_limit, MIN_STABLE_STEP_S))
        stable = max(rate_limit, shortest)
        return min(MAX_STEP_S, accurate, max(fastest_lag, MIN_LAG_STEP_S), stable)

    def steps_in(self, dt: float, theta: Floats | None, nu: Floats) -> int:
        """Equal steps in a row of dt [s] that `max_step` asks for."""
        return _steps_in(dt, self.max_step(theta, nu))

    @cached_property
    def _time_constants(self) -> list[int]:
        """Columns of theta that are time constants of first-order lags."""
        return [
            self.names.index(f"{label}.{p.name}")
            for label, added in _labelled(self.vessel)
            for p in added.effect.parameters
            if p.role is Role.TIME_CONSTANT
        ]

    def _fastest_rate(self, rows: Floats, nu: Floats) -> float:
        """The fastest rate [1/s] of the hull, over theta (K, P) and velocities (B, 3)."""
        m11, m22, m33, X_u, X_uu, Y_v, Y_vv, N_r, N_rr = rows[:, self.hull_columns].T
        u, v, r = np.abs(np.atleast_2d(nu)).max(axis=0)
        damped = np.maximum(-(X_u + 2.0 * X_uu * u) / m11, -(Y_v + 2.0 * Y_vv * v) / m22)
        damped = np.maximum(damped, -(N_r + 2.0 * N_rr * r) / m33)
        munk = u * np.sqrt(np.abs((m22 - m11) * m11 / (m22 * m33)))
        return float(np.max(damped + munk, initial=1e-9))

    @cached_property
    def hull_columns(self) -> list[int]:
        """Columns of theta with the inertia and the damping of the hull."""
        return [self.names.index(name) for name in BASE]

    @cached_property
    def passive_columns(self) -> list[int]:
        """Columns of theta that actuators do not feel along a measured motion: inertia and damping
        of the hull, and the numbers of effects that act on the hull alone.
        """
        passive = [
            self.names.index(f"{label}.{p.name}")
            for label, added in _labelled(self.vessel)
            if ON_THE_HULL.issuperset(added.effect.laws)
            for p in added.effect.parameters
        ]
        return [*self.hull_columns, *passive]

    def missing_force(
        self, motion: Floats, times: Floats, held: Floats, commands: Floats, *,
        theta: Floats | None = None, voltage: Floats | None = None, wind: Floats | None = None,
        carry: Floats | None = None, memory: Floats | None = None,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """What the vessel would need beside its commanded forces to move as measured.

        Reported motion (T, 9) at times (T,) [s]; commands (T, na): those `held` over the interval
        that ends at their row, and those at its instant -> missing force (T, 3) and τ(commands)
        (T, 3) [N, N, N m]. No command delay is applied: that is the caller's. `carry` (nx + 1,)
        continues an earlier call and is changed in place; `memory` (T, nx − 6) is filled with that
        of actuators and effects at each row.
        """
        if memory is None:
            memory = np.empty((len(times), self.state_size - 6))
        out, commanded = np.empty((len(times), 3)), np.empty((len(times), 3))
        self.kernel.module.missing_force(
            floats(self.theta if theta is None else theta),
            self.initial_carry() if carry is None else carry,
            floats(times), floats(motion), floats(held), floats(commands),
            *air(voltage, wind, len(times)), out, commanded, memory,
        )  # fmt: skip
        return out, commanded

    def missing_force_std(
        self, motion: Floats, covariance: Floats, times: Floats, commands: Floats, *,
        voltage: Floats | None = None, wind: Floats | None = None,
    ) -> Floats:  # fmt: skip
        """Motion (T, 9) with covariance (T, 9, 9) -> std of the missing force (T, 3)."""
        out = np.empty((len(times), 3))
        self.kernel.module.missing_force_std(
            self.theta, floats(times), floats(motion), floats(covariance), floats(commands),
            *air(voltage, wind, len(times)), out,
        )  # fmt: skip
        return out

    def initial_carry(self) -> Floats:
        """(nx + 1,) state and time of `missing_force` before its first row."""
        return np.full(self.state_size + 1, np.nan)

    @cached_property
    def _late(self) -> list[tuple[Law, dict[str, int], Floats]]:
        """Of each effect that makes reports late, and has a neutral: its law, the columns of its
        parameters in theta, and their neutral numbers.
        """
        out = []
        for label, added in _labelled(self.vessel):
            parameters = added.effect.parameters
            neutral = [p.neutral for p in parameters if p.neutral is not None]
            if added.effect.latency is not None and len(neutral) == len(parameters):
                columns = {p.name: self.names.index(f"{label}.{p.name}") for p in parameters}
                out.append((added.effect.latency, columns, np.array(neutral)))
        return out

    def ages(self, theta: Floats) -> Floats:
        """Ages [s] of reported position and velocity over ground as each of theta (K, P) has them:
        (K,).
        """
        out = np.zeros(len(theta))
        for latency, columns, _ in self._late:
            out += latency(SimpleNamespace(**{key: theta[:, i] for key, i in columns.items()}))
        return out

    def in_time(self, theta: Floats) -> Floats:
        """theta (K, P) with the effects that make reports late at their neutral numbers."""
        out = theta.copy()
        for _, columns, neutral in self._late:
            out[:, list(columns.values())] = neutral
        return out

    def true_states(self, motion: Floats, *, theta: Floats | None = None) -> Floats:
        """Reported motion (B, 9) -> true pose and velocity (B, 6)."""
        out = np.empty((len(motion), 6))
        self.kernel.module.true_states(
            floats(np.atleast_2d(self.theta if theta is None else theta)), floats(motion), out
        )
        return out


@dataclass(frozen=True)
class Runs:
    """Free runs, each field (B,): input table, first row, length [steps], command delay [s]."""

    table: NDArray[np.int64]
    start: NDArray[np.int64]
    steps: NDArray[np.int64]
    delay: Floats

    @property
    def origin(self) -> NDArray[np.int64]:
        """A number (B,) for each first row of each table: runs of the same row share it."""
        return self.table * (int(self.start.max(initial=0)) + 1) + self.start

    def subset(self, which: NDArray[np.int64]) -> "Runs":
        """Some of the runs."""
        return Runs(self.table[which], self.start[which], self.steps[which], self.delay[which])


@dataclass(frozen=True, eq=False)
class InputTable:
    """Inputs on uniform grids: integrated commands (C, T+1, na) [steps], voltage, wind, time.

    Each is its own, whatever it holds: so that what is made of some of them can be kept.
    """

    total: Floats
    voltage: Floats
    wind: Floats
    time: Floats
    dt: float

    @classmethod
    def of(
        cls,
        commands: Floats,
        dt: float,
        voltage: Floats | None = None,
        wind: Floats | None = None,
        start_time: float = 0.0,
    ) -> "InputTable":
        """Commands (C, T, na) held over dt [s]; voltage (T,), wind (T, 2), NaN where left out."""
        tables, steps, _ = commands.shape
        total = np.zeros((tables, steps + 1, commands.shape[2]))
        np.cumsum(commands, axis=1, out=total[:, 1:])
        volts, winds = air(voltage, wind, steps)
        return cls(
            total,
            np.broadcast_to(volts, (tables, steps)).copy(),
            np.broadcast_to(winds, (tables, steps, 2)).copy(),
            np.tile(start_time + dt * np.arange(steps), (tables, 1)),
            dt,
        )

    @classmethod
    @lru_cache(maxsize=32)  # a search asks for the same ones again and again
    def stacked(cls, tables: tuple["InputTable", ...]) -> "InputTable":
        """Tables of one time step under each other, each continued to the length of the longest."""
        if len(tables) == 1:
            return tables[0]
        steps = max(t.time.shape[1] for t in tables)
        return cls(
            np.concatenate([_continued(t.total, steps + 1, np.diff(t.total[:, -2:], axis=1))
                            for t in tables]),
            np.concatenate([_continued(t.voltage, steps) for t in tables]),
            np.concatenate([_continued(t.wind, steps) for t in tables]),
            np.concatenate([_continued(t.time, steps, t.dt) for t in tables]),
            tables[0].dt,
        )  # fmt: skip


def _continued(values: Floats, length: int, rise: Floats | float = 0.0) -> Floats:
    """(C, T, ...) -> (C, length, ...): the last row again and again, each `rise` more."""
    after = np.arange(1.0, length - values.shape[1] + 1.0)
    more = values[:, -1:] + rise * after.reshape(1, -1, *[1] * (values.ndim - 2))
    return np.concatenate([values, more], axis=1)


@compiled
def _fastest(states: Floats, steps: NDArray[np.int64]) -> Floats:
    """States (B, H+1, nx) of runs of so many steps (B,) -> the largest |u|, |v|, |r|: (B, 3).

    At most `RUNAWAY_SPEED`, and that where a run broke off before its end.
    """
    out = np.zeros((len(states), 3))
    for b in range(len(states)):
        for k in range(steps[b] + 1):
            for i in range(3):
                speed = abs(states[b, k, 3 + i])
                if speed > out[b, i]:  # false of NaN
                    out[b, i] = min(speed, RUNAWAY_SPEED)
        for i in range(3):
            if not np.isfinite(states[b, steps[b], 3 + i]):
                out[b] = RUNAWAY_SPEED
    return out


def _steps_in(dt: float, step: float) -> int:
    """Equal steps in dt [s], none longer than `step` [s]."""
    return max(int(np.ceil(dt / step - 1e-9)), 1)


def _in_order(added: Sequence[AddedEffect]) -> list[AddedEffect]:
    """Effects in the order of the catalogue, then those of a user by name."""
    place = {effect.name: i for i, effect in enumerate(EFFECTS)}
    return sorted(added, key=lambda a: (place.get(a.effect.name, len(place)), a.effect.name))


ON_THE_HULL = frozenset({"force", "inertia", "turn", "reaction"})  # laws of an effect


def _labelled(vessel: Vessel) -> Iterator[tuple[str, AddedEffect]]:
    """Effects in order, with the labels of their parameters: name, name#2, …"""
    counts: Counter[str] = Counter()
    for added in _in_order(vessel.effects):
        name = added.effect.name
        counts[name] += 1
        yield (f"{name}#{counts[name]}" if counts[name] > 1 else name), added


def structure_of(vessel: Vessel) -> Structure:
    """What decides the kernel of a vessel."""
    number: dict[str | None, int] = {t.name: i for i, t in enumerate(vessel.thrusters)}
    number[None] = -1
    owners = tuple(table_owner(vessel.thrusters, t) for t in vessel.thrusters)
    curves = [t.curve for t in vessel.thrusters]
    knots = tuple(() if isinstance(curve, str) else knot_commands(curve) for curve in curves)
    tabled = max(owners, default=-1) >= 0
    return Structure(
        thrusters=len(vessel.thrusters),
        rudders=tuple((number[r.motor], number[r.wash]) for r in vessel.rudders),
        effects=tuple(added.effect for added in _in_order(vessel.effects)),
        tables=owners if tabled else (),
        knots=knots if tabled else (),
    )


def parameters_of(vessel: Vessel) -> dict[str, float]:
    """All numbers of a vessel by name, in the order of theta: m11, left.ahead, EFFECT.NAME."""
    h, s = vessel.hull, vessel.sensors
    known = {
        "length": h.length, "beam": h.beam, "mass": h.mass, "area_front": h.areas[0],
        "area_side": h.areas[1], "antenna_x": s.antenna[0], "antenna_y": s.antenna[1],
    }  # fmt: skip
    out = {
        field: known[field] if field in known else float(getattr(vessel.dynamics, field))
        for field in Body._fields
    }

    def add(label: str, names: Iterable[str], values: Iterable[float]) -> None:
        out.update({f"{label}.{n}": v for n, v in zip(names, values, strict=True)})

    for t in vessel.thrusters:
        values = (*t.position, t.azimuth, *t.thrust, curve_exponent(t))
        add(t.name, ThrusterParameters._fields[1:], values)
    for b in vessel.rudders:
        add(b.name, RudderParameters._fields[1:], (*b.position, *b.angle, b.area, b.aspect))
    for t in vessel.thrusters:
        if not isinstance(t.curve, str):
            shares = knot_shares(t.curve)
            add(t.name, shares, shares.values())
    for label, added in _labelled(vessel):
        names = [p.name for p in added.effect.parameters]
        add(label, names, [added.values[name] for name in names])
    return out
