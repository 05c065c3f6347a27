"""What each effect depends on: the axis of the force that it shows in, and the variable.

One table for the whole catalogue. An effect that is not in it (a user's own) gets the axis and the
variable whose bins hold most of what it supplies (`sim.diagnosis.evidence`).
"""

from collections.abc import Callable, Mapping

import numpy as np

from sim.diagnosis.inputs import commands_of
from sim.effects.wave_motion import GRAVITY
from sim.model import Model
from sim.state import Eta, Floats, Nu
from sim.trial import Trial

SETTLE_S = 0.5  # over which a change of commands is taken
AROUND_S = 1.0  # over which an acceleration is taken
ALONG = 3  # beside X, Y, N: the force in the effect's own direction over the ground

Variable = Callable[[Trial, Model, Mapping[str, float]], Floats]


def _mean_thrust(trial: Trial, model: Model) -> Floats:
    count = max(len(model.vessel.thrusters), 1)
    return np.asarray(commands_of(model, trial)[:, :count].mean(axis=1))


def _helm(trial: Trial, model: Model) -> Floats:
    """Rudder command, or port minus starboard thrusters where there is no rudder."""
    command = commands_of(model, trial)
    count = len(model.vessel.thrusters)
    if command.shape[1] > count:
        return np.asarray(command[:, count])
    side = -np.sign([t.position[1] for t in model.vessel.thrusters])
    return np.asarray(command @ side / max(float(np.abs(side).sum()), 1.0))


def _astern(trial: Trial, model: Model) -> Floats:
    """The hardest reversed thruster; NaN where none is."""
    count = max(len(model.vessel.thrusters), 1)
    most = commands_of(model, trial)[:, :count].min(axis=1)
    return np.where(most < 0.0, most, np.nan)


def _acceleration(trial: Trial) -> Floats:
    """Mean surge acceleration around each row: the row's own noise is in the missing force too."""
    wide = max(round(AROUND_S / trial.dt), 1)
    return np.asarray(np.convolve(trial.nu_dot[:, Nu.U], np.full(wide, 1.0 / wide), "same"))


def _change(values: Floats, trial: Trial) -> Floats:
    """Per second, over a moment before each row."""
    back = max(round(SETTLE_S / trial.dt), 1)
    earlier = np.concatenate([np.repeat(values[:1], back), values[:-back]])
    return np.asarray((values - earlier) / (back * trial.dt))


def _phase(trial: Trial, p: Mapping[str, float]) -> Floats:
    """Of a travelling wave at the boat [rad, 0 … 2π]."""
    away = trial.eta[:, Eta.NORTH] * np.cos(p["direction"])
    away = away + trial.eta[:, Eta.EAST] * np.sin(p["direction"])
    turn = p["omega"] * trial.time - p["omega"] ** 2 / GRAVITY * away + p["phase"]
    return np.asarray(turn % (2.0 * np.pi))


VARIABLES: Mapping[str, Variable] = {
    "heading": lambda t, m, p: t.eta[:, Eta.YAW] % (2.0 * np.pi),
    "surge": lambda t, m, p: t.nu[:, Nu.U],
    "sway": lambda t, m, p: t.nu[:, Nu.V],
    "turn_rate": lambda t, m, p: t.nu[:, Nu.R],
    "acceleration": lambda t, m, p: _acceleration(t),
    "throttle": lambda t, m, p: _mean_thrust(t, m),
    "astern": lambda t, m, p: _astern(t, m),
    "helm": lambda t, m, p: _helm(t, m),
    "throttle_change": lambda t, m, p: _change(_mean_thrust(t, m), t),
    "helm_change": lambda t, m, p: _change(_helm(t, m), t),
    "voltage": lambda t, m, p: t.voltage,
    "time": lambda t, m, p: t.time,
    "phase": lambda t, m, p: _phase(t, p),
}
AROUND = ("heading", "phase")  # bins of equal width, all the way round
AGAINST: Mapping[str, tuple[int, str]] = {  # effect -> axis of the force, and what it depends on
    "steady_current": (0, "heading"),
    "varying_current": (ALONG, "time"),
    "steady_wind": (0, "heading"),
    "inertial_force": (0, "heading"),
    "wave_motion": (ALONG, "phase"),
    "cross_damping": (1, "turn_rate"),
    "hull_lift": (2, "sway"),
    "cg_offset": (2, "turn_rate"),
    "cubic_drag": (0, "surge"),
    "drag_growth": (0, "time"),
    "payload_change": (0, "acceleration"),
    "towed_load": (0, "surge"),
    "actuator_wiring": (2, "helm"),
    "thruster_deadband": (0, "throttle"),
    "thrust_curve": (0, "throttle"),
    "reverse_loss": (0, "astern"),
    "thruster_imbalance": (2, "throttle"),
    "thruster_fault": (2, "time"),
    "battery_sag": (0, "voltage"),
    "advance_loss": (0, "surge"),
    "astern_stall": (0, "astern"),
    "thruster_lag": (0, "throttle_change"),
    "command_delay": (0, "throttle_change"),
    "thruster_misalignment": (1, "throttle"),
    "steering_offset": (2, "surge"),
    "steering_lag": (2, "helm_change"),
    "antenna_offset": (1, "turn_rate"),
    "velocity_latency": (0, "acceleration"),
    "compass_deviation": (1, "heading"),
    "heading_offset": (1, "surge"),
    "yaw_rate_bias": (2, "time"),
}
