"""Results as tables of pandas, where it is installed.

One stretch of a recording on a uniform time grid: the input of all offline inference.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.state import Floats
from sim.vessel import Servo


def data_frame(columns: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> Any:
    """Columns by name, or rows as mappings -> DataFrame; ImportError where pandas is missing."""
    try:
        import pandas
    except ImportError:
        raise ImportError("to_pandas needs pandas: pip install pandas") from None
    return pandas.DataFrame(columns)


MOTION_NAMES = ("north", "east", "yaw", "u", "v", "r", "u_dot", "v_dot", "r_dot")
MOTION = 9  # components of `covariance`: eta (3), nu (3), nu_dot (3)


@dataclass(frozen=True)
class Stretch:
    """A stretch of time [s after the first sample] that is left out, and why."""

    start: float
    end: float
    why: str


@dataclass(frozen=True)
class OutputsSet:
    """The autopilot's outputs, set otherwise from a time on [s after the first sample].

    text     the parameter that changes then
    outputs  all that move the boat from then on
    """

    start: float
    text: str
    outputs: tuple[Servo, ...]


@dataclass(frozen=True)
class Trial:
    """Smoothed motion, its covariance and the commands on the grid `time`.

    All motion is *as reported by the boat's sensors* (antenna position and velocity, compass
    heading): a model is mapped through its sensor effects before it is compared. Row k of `pwm`,
    `voltage` and `wind` holds over [time[k], time[k] + dt).

    time        (T,)       s after the first sample, uniform
    eta         (T, 3)     north [m], east [m], yaw [rad, unwrapped]
    nu          (T, 3)     u [m/s], v [m/s], r [rad/s]
    nu_dot      (T, 3)     m/s², m/s², rad/s²: time derivative of the body-frame components
    covariance  (T, 9, 9)  of (eta, nu, nu_dot)
    channels    (n,)       servo output channel of each column of `pwm`, 1-based
    pwm         (T, n)     mean pulse over the interval [µs]; NaN = no pulse or disarmed
    voltage     (T,)       battery [V]; NaN = not measured
    wind        (T, 2)     velocity of the air towards north, east [m/s]; NaN = not measured
    usable      (T,)       bool: armed, under way, motion and commands known
    """

    name: str
    time: Floats
    eta: Floats
    nu: Floats
    nu_dot: Floats
    covariance: Floats
    channels: tuple[int, ...]
    pwm: Floats
    voltage: Floats
    wind: Floats
    usable: NDArray[np.bool_]
    excluded: tuple[Stretch, ...] = ()
    start_time_ns: int = 0
    origin_deg: tuple[float, float] | None = None
    outputs: tuple[Servo, ...] = ()  # that move the boat, by the autopilot's parameters at first
    outputs_set: tuple[OutputsSet, ...] = ()  # where those parameters change, in order of time
    sources: Mapping[str, str] = field(default_factory=dict)
    rates_hz: Mapping[str, float] = field(default_factory=dict)
    notices: tuple[str, ...] = ()  # what was wrong with the recording, one sentence each
    contradictions: tuple[str, ...] = ()  # of these, sensors that do not tell of one motion
    filtered: bool = False  # its velocities are those of an autopilot's filter

    @property
    def dt(self) -> float:
        """Grid step [s]."""
        return float(self.time[1] - self.time[0])

    def __len__(self) -> int:
        return len(self.time)

    def to_pandas(self) -> Any:
        """One row per time: motion, its standard deviations (`..._std`), pulses, voltage, wind."""
        return data_frame(self.columns())

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of `to_pandas` by name: (T,) each."""
        motion = np.concatenate([self.eta, self.nu, self.nu_dot], axis=1)
        columns = {name: motion[:, i] for i, name in enumerate(MOTION_NAMES)}
        columns |= {f"{name}_std": self.std()[:, i] for i, name in enumerate(MOTION_NAMES)}
        pulses = {f"pwm_{channel}": self.pwm[:, i] for i, channel in enumerate(self.channels)}
        air = {"wind_north": self.wind[:, 0], "wind_east": self.wind[:, 1]}
        more = {"voltage": self.voltage, **air, "usable": self.usable}
        return {"time": self.time, **columns, **pulses, **more}

    def std(self) -> Floats:
        """Standard deviations of (eta, nu, nu_dot): (T, 9)."""
        return np.sqrt(np.einsum("tii->ti", self.covariance))
