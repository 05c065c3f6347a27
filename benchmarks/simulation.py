"""Simulation: compiled against plain Python and against scipy's solve_ivp, in one run.

    python -m benchmarks.simulation

CPU time (`process_time`), compiled code warm unless told otherwise. Targets: an hour at 50 Hz in
well under a second; at least 30 times as fast as the same kernel in plain Python. Accuracy is
against DOP853 (rtol 1e-10), command by command.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from sim.effects import cubic_drag, heading_offset, steady_current, thruster_lag
from sim.following.follower import Reference, VesselFollower
from sim.kernel.cache import plain_kernel_for
from sim.model import InputTable, Model, Runs
from sim.state import Floats
from sim.vessel import AddedEffect, Dynamics, Hull, Servo, Thruster, Vessel

WAMV = Vessel(
    "WAM-V",
    Hull(4.9, 2.3, 180.0),
    Dynamics(
        125.9712, 121.4476, 70.5019,
        -26.5692, -35.8778, -36.4337, -27.4138, -99.1686, -10.6007,
    ),
    (
        Thruster("left", Servo(1), (-0.7, -0.7), (-85.0, 90.0)),
        Thruster("right", Servo(2), (-0.7, 0.7), (-85.0, 90.0)),
    ),
)  # fmt: skip
FOUR = WAMV.with_effects(
    AddedEffect(steady_current.EFFECT, {"speed": 0.3, "direction": 1.0}),
    AddedEffect(cubic_drag.EFFECT, {"X_uuu": -3.0}),
    AddedEffect(thruster_lag.EFFECT, {"tau": 0.3}),
    AddedEffect(heading_offset.EFFECT, {"angle": 0.1}),
)
HOUR, DT = 3600.0, 0.02
PLAIN_SECONDS = 10.0  # simulated, in plain Python


def cpu(work: Callable[[], Any], repeats: int = 3) -> float:
    """CPU time of the best run [s]: disturbances only add."""
    taken = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return min(taken)


def commands_for(seconds: float, dt: float = DT) -> Floats:
    """Commands (T, 2), new ones every two seconds."""
    count, hold = round(seconds / dt), round(2.0 / dt)
    levels = np.random.default_rng(1).uniform(-0.5, 1.0, (count // hold + 1, 2))
    return np.repeat(levels, hold, axis=0)[:count]


def plain_rate(model: Model, commands: Floats) -> Floats:
    """The compiled run's own steps in plain Python on floats -> last state (nx,)."""
    kernel: Any = plain_kernel_for(model.kernel.structure).module
    p = kernel.unpack(model.theta.tolist())
    x = kernel.state_from([0.0] * model.state_size)
    for k, row in enumerate(commands.tolist()):
        inputs = kernel.held_inputs(row, np.nan, np.nan, np.nan, p)
        if k == 0:
            x = kernel.settle_memory(x, 0.0, inputs, p)
        kernel.report_of_state(x, k * DT, inputs, p)
        x = kernel.advance(x, k * DT, inputs, DT, 1, p)
    return np.array(x, dtype=float)


def by_scipy(model: Model, commands: Floats, hold: int) -> Floats:
    """DOP853 piece by piece over held commands -> last state (nx,)."""
    kernel: Any = plain_kernel_for(model.kernel.structure).module
    p = kernel.unpack(model.theta)
    x = np.zeros(model.state_size)
    for k in range(0, len(commands), hold):
        inputs = kernel.held_inputs(commands[k], np.nan, np.nan, np.nan, p)
        if k == 0:
            x = np.array(kernel.settle_memory(tuple(x), 0.0, inputs, p), dtype=float)

        def rates(t: float, y: Floats, inputs: Any = inputs) -> Any:
            return kernel.state_rates(tuple(y), t, inputs, p)

        span = (0.0, hold * DT)
        x = solve_ivp(rates, span, x, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return x


def hour(model: Model, label: str) -> None:
    """An hour at 50 Hz, and the same in plain Python, scaled from a shorter time."""
    commands = commands_for(HOUR)
    compiled = cpu(lambda: model.simulate(commands, DT))
    short = commands[: round(PLAIN_SECONDS / DT)]
    plain = cpu(lambda: plain_rate(model, short), 1) * HOUR / PLAIN_SECONDS
    np.testing.assert_allclose(
        plain_rate(model, short), model.simulate(short, DT)[0][0, -1], atol=1e-9
    )
    ratio = plain / compiled
    print(f"{label}: an hour at 50 Hz {compiled * 1e3:6.0f} ms, {HOUR / compiled:,.0f}× real time")
    print(f"    plain Python {plain:6.1f} s: {ratio:,.0f}× slower (target ≥ 30×)")


def accuracy(model: Model, label: str) -> None:
    """Ten minutes at 50 Hz and at 10 Hz against DOP853."""
    commands = commands_for(600.0)
    exact = by_scipy(model, commands, round(2.0 / DT))
    for every in (1, 5):
        states, _ = model.simulate(commands[::every], every * DT)
        off = np.abs(states[0, -1] - exact)
        print(
            f"{label}: after 10 min at {1 / (every * DT):.0f} Hz off solve_ivp by "
            f"{off[:2].max():.1e} m, {off[2]:.1e} rad, {off[3:5].max():.1e} m/s"
        )


def batch(model: Model, label: str) -> None:
    """360 segments × 100 steps × 14 parameter sets, as a fit asks for."""
    segments, steps, sets = 360, 100, 14
    table = InputTable.of(commands_for(segments * steps * 0.1, 0.1)[None], 0.1)
    count = segments * sets
    runs = Runs(
        np.zeros(count, np.int64),
        np.repeat(np.arange(segments) * steps, sets),
        np.full(count, steps),
        np.zeros(count),
    )
    thetas = np.tile(model.theta * np.linspace(0.99, 1.01, sets)[:, None], (segments, 1))
    start = np.zeros((count, 6))
    taken = cpu(lambda: model.run(start, runs, table, theta=thetas), 5)
    print(
        f"{label}: {segments} segments × {steps} steps × {sets} parameter sets {taken * 1e3:.0f} ms"
    )


def live(model: Model, label: str) -> None:
    """An hour of reference, following and missing force at 50 Hz."""
    commands = commands_for(HOUR)
    rows = model.simulate(commands, DT)[1][0, :-1]
    times, fresh = DT * np.arange(len(rows)), np.ones(len(rows), np.bool_)
    reference, follower = Reference(model), VesselFollower.of(model)
    reference.prepare()
    follower.prepare()
    model.missing_force(rows[:2], times[:2], commands[:2], commands[:2])
    asked = cpu(lambda: reference.advance(reference.start(), times, rows, fresh, commands))
    followed = cpu(lambda: follower.advance(follower.start(), times, rows))
    missing = cpu(lambda: model.missing_force(rows, times, commands, commands))
    print(
        f"{label}: an hour at 50 Hz of reference (auto) {asked * 1e3:.0f} ms, "
        f"following {followed * 1e3:.0f} ms, missing force {missing * 1e3:.0f} ms"
    )


def compiling(name: str, label: str) -> None:
    """CPU time to compile a vessel anew, and to load it from the cache, in fresh processes."""
    with tempfile.TemporaryDirectory() as folder:
        measure = (
            "import time; from benchmarks.simulation import *; Model.of(FOUR if {warm} else WAMV); "
            "s = time.process_time(); Model.of({name}); print(time.process_time() - s)"
        )
        code = measure.format(warm=name == "WAMV", name=name)  # numba itself wakes on the other
        took = [
            float(
                subprocess.run(
                    [sys.executable, "-c", code],
                    env={**os.environ, "XDG_CACHE_HOME": folder},
                    capture_output=True, text=True, check=True,
                ).stdout
            )
            for _ in range(2)
        ]  # fmt: skip
    print(f"{label}: compiled in {took[0]:.2f} s CPU, from the cache in {took[1]:.3f} s")


def main() -> None:
    """All figures, for the plain vessel and with four effects."""
    for name, vessel, label in (("WAMV", WAMV, "plain"), ("FOUR", FOUR, "four effects")):
        model = Model.of(replace(vessel))
        hour(model, label)
        accuracy(model, label)
        batch(model, label)
        live(model, label)
        compiling(name, label)


if __name__ == "__main__":
    main()
