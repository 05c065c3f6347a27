"""The rhythm in which motors fail, if they do: a motor that cuts out again and again, say.

    A_i(ω) = mean over time of  f |c_i| c_i exp −i ω t

f is what the model lacks on one axis, c_i a motor's command. A push of that motor that comes and
goes shows as a line, whatever the motor is told meanwhile.
"""

import numpy as np

from sim.diagnosis.inputs import commands_of
from sim.diagnosis.missing import lacking
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial

SLOWEST, FASTEST = 60.0, 2.0  # s, periods that are looked for
FINER = 4  # points per line of the spectrum


def rhythms(model: Model, trial: Trial) -> Floats:
    """The frequency [rad/s] that stands out most in what each motor fails to do: (motors,)."""
    left = lacking(trial, model)[:, (0, 2)]
    left = np.where(trial.usable[:, None], left, 0.0)
    left = left / np.maximum(left.std(axis=0), 1e-12)
    c = commands_of(model, trial)[:, : len(model.vessel.thrusters)]
    told = left[:, None, :] * (c * np.abs(c))[..., None]
    size = FINER * len(trial)
    power = np.sum(np.abs(np.fft.rfft(told, size, axis=0)) ** 2, axis=-1)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, trial.dt)
    inside = (omega > 2.0 * np.pi / SLOWEST) & (omega < 2.0 * np.pi / FASTEST)
    return np.asarray(omega[inside][np.argmax(power[inside], axis=0)])
