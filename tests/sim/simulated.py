"""Simulated runs of a vessel with all inputs, and the missing force along them."""

import numpy as np

from sim.effects.effect import Effect, Need
from sim.kernel.cache import Kernel, plain_kernel_for
from sim.kernel.generator import Structure
from sim.model import InputTable, Model, Runs
from sim.vessel import Vessel
from tests.sim.vessels import RUDDER_BOAT, WAMV, excitation

DT = 0.02
SECONDS = 6.0  # past the moment of every effect that has one


def home(effect: Effect) -> Vessel:
    """A vessel on which the effect can be seen: one that steers, for effects of steering."""
    return RUDDER_BOAT if Need.STEERING in effect.needs else WAMV


def surroundings(count):
    """Voltage (T,) of a battery half empty, and a steady measured wind (T, 2)."""
    return {"voltage": np.full(count, 14.0), "wind": np.tile([2.0, -3.0], (count, 1))}


def in_numpy(vessel: Vessel) -> Model:
    """The model with its laws in numpy, none passed over where its numbers are neutral.

    For laws one by one: compiling each by itself takes seconds. That the compiled kernels do the
    same is shown with all laws together, and for each of them switched on among all.
    """
    return Model.of(vessel, plain_kernel_for)


def on_floats(vessel: Vessel) -> Model:
    """The same for one run after another: its laws in plain Python on single numbers.

    Several times as fast as arrays of one element.
    """
    return Model.of(vessel, floats_kernel_for)


def floats_kernel_for(structure: Structure) -> Kernel:
    """The kernel in plain Python that takes one run after another, as a compiled one does."""
    return plain_kernel_for(structure)._replace(compiled=True)


def simulated(vessel, model_of=Model.of):
    """Model, commands (T, na), states (T, nx), reports (T, 9) of a free run with all inputs."""
    model, commands = model_of(vessel), excitation(vessel, SECONDS, DT)
    states, reports = model.simulate(commands, DT, **surroundings(len(commands)))
    return model, commands, states[0, :-1], reports[0, :-1]


def reports_without_past(model, commands, states):
    """Reports (T, 9) of each row alone: without a past, late sensors extrapolate."""
    count = len(states)
    nothing = np.zeros(count, np.int64)
    inputs = InputTable.of(commands[None], DT, **surroundings(count))
    runs = Runs(nothing, np.arange(count), nothing, np.zeros(count))
    return model.run(states, runs, inputs)[1][:, 0]


def delayed(commands, delay):
    """Commands (T, na), `delay` [s] late, as means over the steps."""
    shift = delay / DT
    whole, part = int(shift), shift - int(shift)
    late = [commands[np.maximum(np.arange(len(commands)) - whole - i, 0)] for i in (0, 1)]
    return (1.0 - part) * late[0] + part * late[1]


def missing_along(model, commands, reports):
    """Missing force (T, 3) along a motion with the surroundings of `simulated`."""
    delayed_commands = delayed(commands, model.delay)
    held = np.concatenate([delayed_commands[:1], delayed_commands[:-1]])
    times = DT * np.arange(len(commands))
    air = surroundings(len(commands))
    return model.missing_force(reports, times, held, delayed_commands, **air)[0]
