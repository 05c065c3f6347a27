"""Following a plant that nothing inverts: predict with its own `step`, choose the best forces.

    y(j) = y₀(j) + Σ_m S(j − m) G Δw_m,   j = 1 … N,   t_j = j H
    min Σ_j ‖Q (y(j) − r(j))‖² + R² ‖Δw‖²   subject to   low <= w <= high

y: velocity of the plant. y₀: how it goes on under the present force; S: what a newton more does,
by differences of `step` (renewed every REFRESH_S). w: forces on the body, or thrusts within their
limits (τ = G w), changed at the moments MOVES. r: the reference, approached as under the law of
`sim.following`:

    r(t) = ν_ref + ν̇_ref t − e exp(−K t) + K_i ∫e (1 − exp(−K t)) / K

The first move acts, then all begins anew. Without limits, or where none binds, the best forces
follow from a linear equation; else OSQP finds them. Source: Cutler & Ramaker, Dynamic matrix
control, JACC 1980; Maciejowski, Predictive Control with Constraints, 2002, §2, §3; Stellato et al.,
OSQP, Math. Prog. Comp. 12, 2020.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from sim.following import corrected_reference
from sim.following.follower import Axes, FollowerOptions, ThrustLimits
from sim.plants.plant import Plant, PlantInputs
from sim.state import Floats, Pose, Velocity, Wrench
from sim.vessel import Vessel

STEP_S = 0.02  # H, and the longest time that a force is held
STEPS = 10  # N: a horizon of 0.2 s
MOVES = (0, 1, 3, 6)  # steps at which the force may change
REFRESH_S = 0.1  # after which S is computed anew
PROBE = 0.02  # of full thrust: the newton more that S is computed with
MOVE_COST = 1e-3  # of a change by full thrust, beside an error of 1 m/s
AT_LIMIT = 1e-6  # of full thrust: closer to a limit than this, it binds
SOLVER = {
    "verbose": False, "eps_abs": 1e-7, "eps_rel": 1e-7, "max_iter": 4000, "polishing": True,
    "adaptive_rho_interval": 25,  # else OSQP chooses it by the clock, and no two runs are the same
}  # fmt: skip


class Control(NamedTuple):
    """A force, the integral of e with it, and whether thrust limits bind."""

    tau: Wrench
    integral: Velocity
    limited: bool


class ResponseMemory(NamedTuple):
    """Step responses S (N, 3, 3) [m/s per N …], and until when they hold [s]."""

    response: Floats
    until: float


@dataclass(frozen=True)
class Prediction:
    """Forces by prediction; settings and no state.

    inputs  (3, n) G; low, high (n,) [N] of w, infinite without limits
    weights (3,) Q of u, v, r; scale (3,) full thrust [N, N, N m]
    """

    plant: Plant
    options: FollowerOptions
    inputs: Floats
    low: Floats
    high: Floats
    weights: Floats
    scale: Floats
    longest_step: float = STEP_S

    @classmethod
    def of(cls, plant: Plant, options: FollowerOptions, vessel: Vessel) -> "Prediction":
        """Forces of the size of that vessel's thrust, within its limits where asked for."""
        full = sum(max(abs(f) for f in t.thrust) for t in vessel.thrusters) or vessel.hull.mass
        scale = np.array([full, full, 0.5 * full * vessel.hull.beam])
        G, n = np.eye(3), 3
        low, high = np.full(n, -np.inf), np.full(n, np.inf)
        if options.limits:
            limits = ThrustLimits.of(vessel)
            G, low, high = limits.effectiveness, limits.low, limits.high
        elif options.axes is Axes.SURGE_YAW:
            G, low, high = G[:, [0, 2]], low[:2], high[:2]
        if options.limits:
            _osqp()
        if not plant.rewinds:
            raise ValueError(
                f"{plant.name} cannot be followed: it does not go back to a state "
                "(an FMU has to save all of its state: canGetAndSetFMUstate)"
            )
        weights = np.array([1.0, 1.0, 0.5 * vessel.hull.length])
        if options.axes is Axes.SURGE_YAW or not np.abs(G[1]).max() > 0.0:
            weights[1] = 0.0  # no input pushes sideways: sway follows by coupling
        return cls(plant, options, G, low, high, weights, scale)

    def start(self) -> ResponseMemory:
        """The state before the first force: no response is known."""
        return ResponseMemory(np.zeros((STEPS, 3, 3)), -np.inf)

    def control(
        self, state: Any, ref: Floats, integral: Velocity, last: Wrench, inputs: PlantInputs,
        h: float, memory: ResponseMemory,
    ) -> tuple[Control, ResponseMemory]:  # fmt: skip
        """τ for a reference row (9,) after the force `last`, and the memory after it."""
        at, gains = self.plant.motion(state), self.options.gains
        nu_ref = corrected_reference(Pose(*ref[:3]), Velocity(*ref[3:6]), at.pose, gains)
        error = np.array(nu_ref) - np.array(at.velocity)
        grown = np.array(integral) + h * error
        t = STEP_S * np.arange(1, STEPS + 1)[:, np.newaxis]
        fade = np.exp(-gains.rate * t)
        rest = gains.integral * grown * (1.0 - fade) / max(gains.rate, 1e-9)
        wanted = np.array(nu_ref) + ref[6:] * t - error * fade + rest
        now = np.clip(self._allocation @ np.array(last), self.low, self.high)
        force = self.inputs @ now
        free = self._predicted(state, force, inputs)
        if not memory.until - REFRESH_S <= inputs.time < memory.until:
            response = self._response(state, force, inputs, free)
            memory = ResponseMemory(response, inputs.time + REFRESH_S)
        w = self._best(memory.response, wanted - free, now)
        limited = bool((np.minimum(w - self.low, self.high - w) < AT_LIMIT * self._size).any())
        kept = integral if limited else Velocity(*grown.tolist())
        return Control(Wrench(*(self.inputs @ w).tolist()), kept, limited), memory

    @cached_property
    def _allocation(self) -> Floats:
        """G⁺ (n, 3)."""
        return np.asarray(np.linalg.pinv(self.inputs), dtype=float)

    @cached_property
    def _size(self) -> Floats:
        """(n,) what is much of each w [N, N m]."""
        return np.abs(self._allocation) @ self.scale

    def _predicted(self, state: Any, force: Floats, inputs: PlantInputs) -> Floats:
        """Velocities (N, 3) of the plant under a constant force (3,)."""
        tau, out = Wrench(*force.tolist()), np.empty((STEPS, 3))
        for j in range(STEPS):
            now = inputs._replace(time=inputs.time + j * STEP_S)
            state = self.plant.step(state, tau, now, STEP_S)
            out[j] = self.plant.motion(state).velocity
        return out

    def _response(self, state: Any, force: Floats, inputs: PlantInputs, free: Floats) -> Floats:
        """S (N, 3, 3): change of velocity [rows of the second axis] by a newton of X, Y, N."""
        out = np.empty((STEPS, 3, 3))
        for i in range(3):
            probe = np.zeros(3)
            probe[i] = PROBE * self.scale[i]
            out[:, :, i] = (self._predicted(state, force + probe, inputs) - free) / probe[i]
        return out

    def _best(self, response: Floats, gap: Floats, now: Floats) -> Floats:
        """Gap r − y₀ (N, 3) and the present w (n,) -> w of the first move (n,)."""
        n, count = len(now), len(MOVES)
        A = np.zeros((STEPS, 3, count, n))
        effect = (self.weights[:, np.newaxis] * response) @ self.inputs * self._size
        for m, begin in enumerate(MOVES):
            A[begin:, :, m] = effect[: STEPS - begin]
        flat = A.reshape(STEPS * 3, count * n)
        H, g = (
            flat.T @ flat + MOVE_COST**2 * np.eye(count * n),
            flat.T @ (self.weights * gap).reshape(-1),
        )
        moves = np.linalg.solve(H, g)
        after = now + self._size * np.cumsum(moves.reshape(count, n), axis=0)
        if (after < self.low).any() or (after > self.high).any():
            moves = self._within_limits(H, g, now)
        w: Floats = np.clip(now + self._size * moves[:n], self.low, self.high)
        return w

    def _within_limits(self, H: Floats, g: Floats, now: Floats) -> Floats:
        """Changes of w, in shares of its size, that keep w within its limits after each move."""
        count = len(MOVES)
        total = np.kron(np.tril(np.ones((count, count))), np.eye(len(now)))
        low, high = (
            np.tile((end - now) / self._size, count) for end in (self.low, self.high)
        )  # fmt: skip
        solver = _osqp().OSQP()
        solver.setup(sparse.csc_matrix(np.triu(H)), -g, sparse.csc_matrix(total), low, high,
                     **SOLVER)  # fmt: skip
        found = solver.solve(raise_error=False).x
        solved = found is not None and np.isfinite(found).all()
        return np.asarray(found if solved else np.linalg.solve(H, g), dtype=float)


def _osqp() -> Any:
    """The solver; ValueError where it is not installed."""
    try:
        import osqp
    except ImportError:
        raise ValueError(
            "a plant that is followed by prediction within thrust limits needs OSQP: "
            "pip install 'shadow-gateway[mujoco]'"
        ) from None
    return osqp
