"""The filter against the simulator's truth, beside the autopilot's own estimate; and its speed.

    python -m benchmarks.estimation_accuracy

Logs: otter_calm and boat_calm of the shared folder (SHADOW_SHARED), 10 to 500 s after arming. The
truth is SIM_STATE, which nothing else here ever reads. It carries no time: it was sent together
with the ATTITUDE before it. Errors are root mean squares of estimate − truth; the autopilot's own
estimate is LOCAL_POSITION_NED's velocity turned by ATTITUDE's yaw, and ATTITUDE's yaw rate.
Speed is CPU time per event, warm, beside filterpy's dense predict and update of the same size.
"""

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gateway.estimation import STATES, FilterSettings, Flag, MeasurementKind, State
from gateway.estimation.events import Events, join, make_events
from gateway.estimation.filter import Estimator, FilterRows
from gateway.estimation.smoother import smooth
from gateway.ingest.log import Log, Table
from gateway.ingest.open import open_log
from sim.state import Floats, to_body

ROOT = Path(__file__).resolve().parent.parent
SHARED = Path(os.environ.get("SHADOW_SHARED", ROOT.parent / "shared")) / "data" / "sitl"
FROM_S, TO_S = 10.0, 500.0
BOAT = 1  # system id
NU = slice(State.U, State.R + 1)
NU_DOT = slice(State.U_DOT, State.R_DOT + 1)


@dataclass(frozen=True)
class Voyage:
    """Events, and at the moments `time` (T,) truth and the autopilot's own idea of nu (T, 3)."""

    events: Events
    time: Floats
    truth: Floats
    autopilot: Floats


def columns(table: Table, *names: str) -> list[Floats]:
    """Fields of the boat's own messages, as floats."""
    mine = table.system == BOAT
    return [np.asarray(table.columns[name], np.float64)[mine] for name in names]


def boot_s(table: Table) -> Floats:
    """Time of the boat's messages since boot [s]."""
    return columns(table, "time_boot_ms")[0] * 1e-3


def telemetry(attitude: Table, local: Table, settings: FilterSettings) -> Events:
    """ATTITUDE and LOCAL_POSITION_NED in the order of the log."""
    yaw, rate = columns(attitude, "yaw", "yawspeed")
    north, east, vn, ve = columns(local, "x", "y", "vx", "vy")
    readings = (
        (MeasurementKind.YAW, attitude, yaw),
        (MeasurementKind.YAW_RATE, attitude, rate),
        (MeasurementKind.VELOCITY, local, np.column_stack([vn, ve])),
        (MeasurementKind.POSITION, local, np.column_stack([north, east])),
    )
    parts = [
        make_events(kind, boot_s(table), z, settings.white_std(kind, table.name))
        for kind, table, z in readings
    ]
    order = np.concatenate([table.order[table.system == BOAT] for _, table, _ in readings])
    return join(parts)[np.argsort(order, kind="stable")]


def body_rates(yaw: Floats, vn: Floats, ve: Floats, rate: Floats) -> Floats:
    """Yaw [rad], velocity towards north and east [m/s], yaw rate -> nu (T, 3)."""
    u, v = to_body(vn, ve, yaw)  # type: ignore[arg-type]
    return np.column_stack([np.asarray(u), np.asarray(v), rate])


def voyage(log: Log, arming_s: float, settings: FilterSettings) -> Voyage:
    """What the benchmark needs of one log."""
    attitude, local, sim = (
        log.table(name) for name in ("ATTITUDE", "LOCAL_POSITION_NED", "SIM_STATE")
    )
    events = telemetry(attitude, local, settings)
    last = np.searchsorted(attitude.order, sim.order) - 1
    time_s = boot_s(attitude)[last]
    part = (last >= 0) & (time_s > arming_s + FROM_S) & (time_s < arming_s + TO_S)
    yaw, rate, vn, ve = (column[part] for column in columns(sim, "yaw", "zgyro", "vn", "ve"))
    time_s = time_s[part]

    def at(table: Table, values: Floats) -> Floats:
        return np.interp(time_s, boot_s(table), values)

    reported_yaw, reported_rate = columns(attitude, "yaw", "yawspeed")
    reported_vn, reported_ve = columns(local, "vx", "vy")
    autopilot = body_rates(
        at(attitude, np.unwrap(reported_yaw)),
        at(local, reported_vn),
        at(local, reported_ve),
        at(attitude, reported_rate),
    )
    return Voyage(events, time_s, body_rates(yaw, vn, ve, rate), autopilot)


def show(name: str, error: Floats, std: Floats | None = None, unit: str = "") -> None:
    rms = "  ".join(f"{value:8.4f}" for value in np.sqrt(np.mean(error**2, axis=0)))
    stated = "" if std is None else "  ".join(f"{value:8.4f}" for value in std.mean(axis=0))
    print(f"  {name:26s} {rms}   {stated} {unit}")


def accuracy(name: str, settings: FilterSettings) -> Events:
    """Prints the errors on one log."""
    arming_s = json.loads((SHARED / f"{name}.truth.json").read_text())["t_arm_boot_s"]
    v = voyage(open_log(SHARED / f"{name}.tlog"), arming_s, settings)
    estimator = Estimator(settings)
    _, rows = estimator.advance(estimator.start(), v.events)
    row = np.searchsorted(rows.time_s, v.time, side="right") - 1
    whole = smooth(v.events, v.time, settings)
    std = np.sqrt(np.einsum("tii->ti", whole.covariance))
    print(f"{name}: RMS error of u [m/s], v [m/s], r [rad/s]; what the estimate states")
    show("autopilot", v.autopilot - v.truth)
    show("filter", rows.motion[row, NU] - v.truth, rows.std[row, NU])
    show("smoother", whole.nu - v.truth, std[:, NU])
    true_dot = np.gradient(v.truth, v.time, axis=0)
    show("smoother, accelerations", whole.nu_dot - true_dot, std[:, NU_DOT])
    show("  of which there were", true_dot - true_dot.mean(axis=0))
    print(f"  health: {health(v.events, rows)}\n")
    return v.events


def health(events: Events, rows: FilterRows) -> str:
    """NIS per component, outliers and jumps by kind."""
    says = []
    for kind in (
        MeasurementKind.YAW,
        MeasurementKind.YAW_RATE,
        MeasurementKind.VELOCITY,
        MeasurementKind.POSITION,
    ):
        mine = events.kind == kind
        used = mine & (rows.used > 0)
        nis = rows.nis[used].sum() / max(rows.used[used].sum(), 1)
        gated, jumps = (int(rows.has(flag)[mine].sum()) for flag in (Flag.GATED, Flag.JUMP))
        says.append(f"{kind.name.lower()} NIS {nis:.3f}, {gated} gated, {jumps} jumps")
    return "; ".join(says)


def filterpy_us(count: int) -> float:
    """CPU time [µs] of one predict and one update of filterpy."""
    ekf = ExtendedKalmanFilter(STATES, 2)
    ekf.Q = 1e-3 * np.eye(STATES)
    H, z = np.eye(2, STATES), np.zeros((2, 1))
    start = time.process_time()
    for _ in range(count):
        ekf.predict()
        ekf.update(z, lambda _: H, lambda x: x[:2])
    return (time.process_time() - start) / count * 1e6


def speed(events: Events, settings: FilterSettings) -> None:
    """Prints CPU time per event and per step of the smoother."""
    estimator = Estimator(settings)
    start = time.process_time()
    estimator.advance(estimator.start(), events)
    ours = (time.process_time() - start) / len(events) * 1e6
    grid = np.arange(events.time_s.min(), events.time_s.max(), 0.05)
    start = time.process_time()
    smooth(events, grid, settings)
    back = (time.process_time() - start) / (len(events) + len(grid)) * 1e6
    theirs = filterpy_us(3000)
    print(f"filter {ours:.1f} µs per event (filterpy {theirs:.0f} µs: {theirs / ours:.0f}×)")
    print(f"smoother {back:.1f} µs per step, two passes")


def main() -> None:
    if not SHARED.is_dir():
        raise SystemExit(f"no logs at {SHARED}: set SHADOW_SHARED")
    settings = FilterSettings().with_parameters({"INS_GYRO_FILTER": 4.0})  # as both logs say
    for name in ("otter_calm", "boat_calm"):
        events = accuracy(name, settings)
    speed(events, settings)


if __name__ == "__main__":
    main()
