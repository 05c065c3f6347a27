"""A short voyage of a simulated WAM-V as a telemetry log, cut and damaged as a test wants."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.model import Model
from sim.vessel import Vessel
from tests.gateway.ingest.scripted import (
    START_NS,
    attitude,
    heartbeat,
    local_position,
    servo,
)
from tests.sim.vessels import WAMV

RATE_HZ = 20.0
ORIGIN = (634470000, 104000000)  # latitude, longitude [1e-7 deg]
BOOT_S, DELAY_S = 100.0, 0.02  # boot time of the first message; what the link needs
Span = tuple[float, float]
Said = tuple[float, Any]  # s after the first message, message
SERVOS = {
    f"SERVO{channel}_{name}": value
    for channel, function in ((1, 73.0), (2, 74.0))
    for name, value in (("FUNCTION", function), ("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))
}


def voyage(
    seconds: float = 20.0, *, vessel: Vessel = WAMV, silent: Span = (0.0, 0.0), noise: float = 1.0
) -> list[Said]:
    """What the boat says; nothing about its motion while `silent`."""
    times = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    commands = _sticks(times, len(vessel.actuators))
    states, _ = Model.of(vessel).simulate(commands, 1.0 / RATE_HZ)
    _, pulses = vessel.pulses(commands)
    said: list[Said] = [(0.0, dialect.MAVLink_gps_global_origin_message(*ORIGIN, 0))]
    for k, row in enumerate(_measured(states[0, :-1, :6], noise)):
        t, moving = float(times[k]), not silent[0] <= times[k] < silent[1]
        said += [(t, message) for message in _reports(BOOT_S + t, row)] if moving else []
        said.append((t, servo(BOOT_S + t, *np.round(pulses[k]).astype(int).tolist())))
        if k % int(RATE_HZ) == 0:
            said.append((t, heartbeat()))
    return said


def _sticks(times: Any, count: int) -> Any:
    """Commands that push ahead and turn both ways."""
    turn = 0.3 * np.sin(0.6 * times)
    ahead = 0.4 + 0.3 * np.sin(0.21 * times + 1.0)
    signs = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    return np.clip(ahead[:, None] + turn[:, None] * signs, -1.0, 1.0)


def _measured(states: Any, noise: float) -> Iterator[Any]:
    """Pose and velocity as an autopilot's filter gives them."""
    std = noise * np.array([0.02, 0.02, 0.001, 0.01, 0.01, 0.002])
    yield from states + std * np.random.default_rng(5).normal(size=states.shape)


def _reports(boot_s: float, row: Any) -> list[Any]:
    north, east, yaw, u, v, r = row.tolist()
    c, s = np.cos(yaw), np.sin(yaw)
    return [
        attitude(boot_s, (yaw + np.pi) % (2.0 * np.pi) - np.pi, r),
        local_position(boot_s, north, east, c * u - s * v, s * u + c * v),
    ]


def parameters(values: dict[str, float] = SERVOS) -> list[Said]:
    """The boat's answer to a ground station that asks for its parameters."""
    real = dialect.MAV_PARAM_TYPE_REAL32
    return [
        (0.0, dialect.MAVLink_param_value_message(name.encode(), value, real, len(values), i))
        for i, (name, value) in enumerate(values.items())
    ]


def frames(said: list[Said], system: int = 1) -> list[bytes]:
    """Messages as frames with sequence numbers that count, each behind its time of receipt."""
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    out = []
    for t, message in said:
        time_us = START_NS // 1000 + round((t + DELAY_S) * 1e6)
        out.append(struct.pack(">Q", time_us) + message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
    return out


def tlog(path: Path, said: list[Said] | None = None, system: int = 1) -> Path:
    """The voyage as a file."""
    path.write_bytes(b"".join(frames(voyage() if said is None else said, system)))
    return path
