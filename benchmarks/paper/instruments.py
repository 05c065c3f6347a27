"""What the boats carry: errors that wander (Gauss and Markov) and a small white part on top.

`gnss` is the usual autopilot with one receiver and a compass, as benchmarks.hidden has it. `rtk`
is a survey boat's inertial system with two antennas and corrections. Each is smoothed with a
filter that was told what its sensors are, as an owner would in gateway.toml.
"""

from dataclasses import dataclass, replace

from benchmarks.hidden.scene import Report
from benchmarks.hidden.sensors import ESTIMATE, Wander
from gateway.estimation import FilterSettings
from gateway.offline.trials import AS_REPORTED


@dataclass(frozen=True)
class Instruments:
    """Errors of position [m], heading [rad], velocity [m/s], turn rate [rad/s]; filter settings."""

    name: str
    errors: Report
    offline: FilterSettings
    live: FilterSettings

    def says(self) -> str:
        """The errors in words."""
        e = self.errors
        named = (("position", e.north, "m"), ("heading", e.yaw, "rad"),
                 ("velocity", e.v_north, "m/s"), ("gyro", e.r, "rad/s"))  # fmt: skip
        parts = [
            f"{name} {w.std:g} {unit} over {w.seconds:g} s + white {w.white:g} {unit}"
            for name, w, unit in named
        ]
        return f"`{self.name}`: {'; '.join(parts)}"


def _rtk() -> Instruments:
    position, velocity = Wander(0.01, 30.0, 0.004), Wander(0.01, 2.0, 0.003)
    heading, turning = Wander(0.003, 60.0, 0.0005), Wander(0.0003, 100.0, 0.001)
    live = FilterSettings(
        position_error_m=0.01,
        position_error_tau_s=30.0,
        velocity_error_mps=0.01,
        heading_error_rad=0.003,
    )
    return Instruments(
        "rtk",
        Report(position, position, heading, velocity, velocity, turning),
        replace(live, heading_error_rad=AS_REPORTED.heading_error_rad),
        live,
    )


GNSS = Instruments("gnss", ESTIMATE, AS_REPORTED, FilterSettings())
RTK = _rtk()
ALL = (RTK, GNSS)
