"""A boat with two motors in plain Python, written as a table that keeps or breaks its word."""

from dataclasses import dataclass
from math import cos, sin
from pathlib import Path

import numpy as np
from scipy.signal import lfilter, savgol_filter

DT, FINE = 0.1, 0.01
METRES = 111_319.49  # per degree of latitude
MAPPING = """
time = { column = "t", unit = "ms" }

[columns]
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
yaw = { column = "yaw", unit = "deg" }
yaw_rate = { column = "r", unit = "rad/s" }
surge = { column = "u", unit = "m/s" }
sway = { column = "v", unit = "m/s" }
surge_acceleration = { column = "a_x", unit = "m/s2" }
sway_acceleration = { column = "a_y", unit = "m/s2" }
channel_1 = { column = "thr_left", unit = "us" }
channel_3 = { column = "thr_right", unit = "us" }
"""


@dataclass(frozen=True)
class Traps:
    """What is wrong with the table."""

    swapped: bool = False
    held: bool = False  # positions at 5 Hz, shown twice, with rows that slip
    rates: str = ""  # "savgol", "mean": towards both sides; "lag", "late", "noisy": honest faults
    gravity: float = 0.0  # m/s² per m/s² of acceleration, from a bow that rises
    straight: bool = False
    left_turned: bool = False  # a high pulse is astern


@dataclass(frozen=True)
class Made:
    """Rows of the table as they were: time (T,), pose (T, 3), velocity (T, 3), commands (T, 2)."""

    time: np.ndarray
    pose: np.ndarray
    nu: np.ndarray
    commands: np.ndarray


def sailed(seconds: float, seed: int, straight: bool) -> Made:
    """Random throttles for a while: speed and turn rate answer within a second or two."""
    rng = np.random.default_rng(seed)
    steps = round(seconds / DT)
    held = np.repeat(rng.uniform(-0.4, 1.0, (steps // 40 + 1, 2)), 40, axis=0)[:steps]
    if straight:
        held[:, 1] = held[:, 0]
    north = east = yaw = u = v = r = 0.0
    rows = []
    for left, right in held.tolist():
        rows.append((north, east, yaw, u, v, r))
        for _ in range(round(DT / FINE)):
            u += FINE * (2.0 * (left + right) - 0.9 * u - 0.3 * abs(u) * u)
            v += FINE * (-0.3 * u * r - 2.0 * v)
            r += FINE * (0.9 * (left - right) - 1.2 * r)
            north += FINE * (u * cos(yaw) - v * sin(yaw))
            east += FINE * (u * sin(yaw) + v * cos(yaw))
            yaw += FINE * r
    motion = np.array(rows)
    return Made(DT * np.arange(steps), motion[:, :3], motion[:, 3:], held)


def written(folder: Path, traps: Traps, seconds: float = 120.0, seed: int = 1) -> tuple[Path, Made]:
    """The table and its mapping beside it."""
    made = sailed(seconds, seed, traps.straight)
    nu = _rates(made.nu, traps.rates, np.random.default_rng(seed + 100))
    place = np.round(made.pose[:, :2] / METRES / [1.0, cos(np.radians(63.4))] * 1e7) / 1e7
    place = _held(place, seed) if traps.held else place
    u_dot = np.gradient(made.nu[:, 0], DT) - made.nu[:, 2] * made.nu[:, 1]
    v_dot = np.gradient(made.nu[:, 1], DT) + made.nu[:, 2] * made.nu[:, 0]
    pulses = 1500.0 + 400.0 * made.commands * [-1.0 if traps.left_turned else 1.0, 1.0]
    if traps.swapped:
        pulses = pulses[:, ::-1]
    columns = [
        1000.0 * made.time, 63.4 + place[:, 0], 10.3 + place[:, 1],
        np.degrees(made.pose[:, 2]) % 360.0, nu[:, 2], nu[:, 0], nu[:, 1],
        (1.0 + traps.gravity) * u_dot, v_dot, *pulses.T,
    ]  # fmt: skip
    names = "t,lat,lon,yaw,r,u,v,a_x,a_y,thr_left,thr_right"
    lines = [",".join(f"{x:.9g}" if i not in (1, 2) else f"{x:.7f}" for i, x in enumerate(row))
             for row in zip(*columns, strict=True)]  # fmt: skip
    table = folder / "run.csv"
    table.write_text("\n".join([names, *lines]) + "\n", encoding="utf-8")
    (folder / "run.toml").write_text(MAPPING, encoding="utf-8")
    return table, made


def _held(place: np.ndarray, seed: int) -> np.ndarray:
    """Every second fix alone, shown until the next; some appear a row late."""
    rng = np.random.default_rng(seed + 200)
    shown = place.copy()
    late = rng.random(len(place)) < 0.1
    last = 0
    for k in range(len(place)):
        beat = k // 2 * 2
        if k == beat and late[k]:
            beat = last  # the row slips: still the fix before
        last = beat
        shown[k] = place[beat]
    return shown


def _rates(nu: np.ndarray, how: str, rng: np.random.Generator) -> np.ndarray:
    """What the table says of u, v, r."""
    if how == "savgol":
        return np.asarray(savgol_filter(nu, 21, 2, axis=0))
    if how == "mean":
        return np.stack([np.convolve(x, np.ones(15) / 15.0, "same") for x in nu.T], axis=1)
    if how == "lag":
        keep = np.exp(-DT / 0.6)
        return np.asarray(lfilter([1.0 - keep], [1.0, -keep], nu, axis=0))
    if how == "late":
        return np.vstack([np.zeros((4, 3)), nu[:-4]])
    if how == "noisy":
        return nu + rng.normal(0.0, [0.05, 0.05, 0.02], nu.shape)
    return nu + rng.normal(0.0, 1e-4, nu.shape)


def boat_toml(left: int = 1, right: int = 3) -> str:
    """A vessel file for it, its motors on these channels."""
    motors = "".join(
        f'[[thrusters]]\nname = "{name}"\nchannel = {channel}\nposition = [-0.5, {y}]\n'
        "thrust = [-20.0, 20.0]\n"
        for name, channel, y in (("left", left, -0.45), ("right", right, 0.45))
    )
    return (
        'name = "made"\n[hull]\nlength = 1.5\nbeam = 1.0\nmass = 10.0\n[dynamics]\nm11 = 10.0\n'
        "m22 = 10.0\nm33 = 10.0\nX_u = -9.0\nX_uu = -3.0\nY_v = -20.0\nY_vv = 0.0\nN_r = -12.0\n"
        f"N_rr = 0.0\n{motors}"
    )
