"""`shadow simulate`: commands in, motion out, as a recording; a second vessel may follow the first.

The table of commands is a CSV: `time` [s] and one column per actuator, by its name in the vessel
file, −1 … 1. Each row holds until the next.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from gateway.ingest.mcap.log import enclosure
from gateway.json_rows import encode_rows
from gateway.offline.notices import assumed_by
from gateway.recording.recorder import Attachment, Recorder, RecordingSettings, TopicsKept
from gateway.shadow.path import follower_of
from gateway.shadow.topic_rows import MOTION_FIELDS
from gateway.vessel_file import dump_vessel
from sim.following.follower import FollowerOptions
from sim.hil.boat import Boat
from sim.model import Model
from sim.plants import OWN_VESSEL, PlantChoice
from sim.state import Floats
from sim.vessel import Vessel

BLOCK_ROWS = 500  # handed to the recorder at a time
LONGEST_S = 86400.0  # of a table of commands: a longer one is probably not in seconds


@dataclass(frozen=True)
class SimulationResult:
    """Motion of the vessel and of its follower (T, 9), force on the follower (T, 3).

    commands  (T, na) held over each interval
    notices   what was assumed for the vessels' effects to act
    """

    time: Floats
    motion: Floats
    follower: Floats | None
    control: Floats | None
    commanded: Floats
    commands: Floats
    recording: Path
    notices: tuple[str, ...] = ()

    @property
    def follower_rmse(self) -> Floats | None:
        """Follower less vessel in u, v [m/s], r [rad/s]: (3,); None without a follower."""
        if self.follower is None:
            return None
        return np.asarray(((self.follower - self.motion)[:, 3:6] ** 2).mean(axis=0) ** 0.5)

    def to_dict(self) -> dict[str, object]:
        """Where the recording is, how long, the motion at the end in SI, how well it followed."""
        names = ("north_m", "east_m", "yaw_rad", "surge_mps", "sway_mps", "yaw_rate_radps")
        off = self.follower_rmse
        return {
            "recording": str(self.recording),
            "seconds": float(self.time[-1]),
            "at_end": dict(zip(names, self.motion[-1, :6].tolist(), strict=True)),
            "follower_rmse": (
                None if off is None else dict(zip(names[3:], off.tolist(), strict=True))
            ),
            "notices": list(self.notices),
        }


def read_commands(path: Path, vessel: Vessel) -> tuple[Floats, Floats]:
    """A table of commands -> times (R,) from 0 [s], commands (R, actuators)."""
    names = [actuator.name for actuator in vessel.actuators]
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except OSError as error:
        raise BadInput(f"{path}: cannot read the commands: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise BadInput(f"{path}: not a text table: expected a CSV of commands") from None
    header = list(rows[0]) if rows else []
    if "time" not in header or not set(names) & set(header):
        raise BadInput(
            f"{path}: expected a CSV with the columns time [s] and {', '.join(names)} (−1 … 1)"
        )
    unknown = [name for name in header if name not in ("time", *names)]
    if unknown:
        raise BadInput(f"{path}: unknown column {unknown[0]!r}: actuators are {', '.join(names)}")
    time = np.array([_number(path, k, row, "time") for k, row in enumerate(rows)])
    if len(time) < 2 or np.any(np.diff(time) <= 0.0):
        raise BadInput(f"{path}: time must have two or more rows and go up")
    if time[-1] - time[0] > LONGEST_S:
        raise BadInput(f"{path}: time spans {time[-1] - time[0]:.3g} s, more than a day: seconds?")
    columns = [[_number(path, k, r, n) if n in header else 0.0 for n in names]
               for k, r in enumerate(rows)]  # fmt: skip
    return time - time[0], np.array(columns)


def _number(path: Path, row: int, values: dict[str, str], name: str) -> float:
    try:
        number = float(values[name])
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or (name != "time" and abs(number) > 1.0):
        expected = "seconds" if name == "time" else "a command from −1 to 1"
        raise BadInput(f"{path}: line {row + 2}, {name} = {values[name]!r}: expected {expected}")
    return number


def simulate(
    commands: Path,
    vessel: Vessel,
    follow: Vessel | None,
    out: Path,
    rate_hz: float = 50.0,
    options: FollowerOptions | None = None,
    plant: PlantChoice = OWN_VESSEL,
) -> SimulationResult:
    """Run the vessel on a table of commands; record it, and the vessel that follows it.

    A `plant` of another kind moves under the vessel's actuators.
    """
    times, values = read_commands(commands, vessel)
    model = Model.of(vessel)
    grid = np.arange(0.0, times[-1], 1.0 / rate_hz)
    held = values[np.searchsorted(times, grid, side="right") - 1]
    if plant == OWN_VESSEL:
        motion = model.simulate(held, 1.0 / rate_hz)[1][0, :-1]
    else:
        motion = _moved(vessel, plant, held, 1.0 / rate_hz)
    _, commanded = model.missing_force(motion, grid, held, held)
    followed = forces = None
    if follow is not None:
        follower = follower_of(Model.of(follow), options or FollowerOptions())
        result = follower.advance(follower.start(), grid, motion)
        followed, forces = result.shadows, result.forces
    vessels = [vessel] if follow is None else [vessel, follow]
    notices = tuple(notice for one in vessels for notice in assumed_by(one))
    file = recording_file(commands, out)
    simulated = SimulationResult(grid, motion, followed, forces, commanded, held, file, notices)
    _record(simulated, vessels)
    return simulated


def _moved(vessel: Vessel, plant: PlantChoice, commands: Floats, dt: float) -> Floats:
    """Motion (T, 9) of a plant under the vessel's actuators, at the start of each interval."""
    try:
        boat = Boat.of(vessel, plant=plant)
    except ValueError as error:
        raise BadInput(f"{vessel.name}: {error}") from None
    channels, pulses = vessel.pulses(commands)
    state, out = boat.start(), np.empty((len(commands), 9))
    _, _, truth = boat.step(state, {}, 0.0)
    for k, row in enumerate(pulses.tolist()):
        out[k] = truth.north, truth.east, truth.yaw, *truth[1:7]
        state, _, truth = boat.step(state, dict(zip(channels, row, strict=True)), dt)
    return out


LOG_COLUMNS = {  # column of the table -> its unit, and the component of the motion
    "north": ("m", 0), "east": ("m", 1), "yaw": ("rad", 2),
    "surge": ("m/s", 3), "sway": ("m/s", 4), "yaw_rate": ("rad/s", 5),
}  # fmt: skip


def _as_log(result: SimulationResult, vessel: Vessel) -> list[Attachment]:
    """The simulated voyage as a table with its mapping: what compare, identify, … read."""
    channels, pulses = vessel.pulses(result.commands)
    names = ["time", *LOG_COLUMNS, *(f"channel_{channel}" for channel in channels)]
    motion = [result.motion[:, place] for _, place in LOG_COLUMNS.values()]
    table = np.column_stack([result.time, *motion, pulses])
    text = io.StringIO()
    np.savetxt(text, table, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    units = {name: unit for name, (unit, _) in LOG_COLUMNS.items()}
    units |= {f"channel_{channel}": "us" for channel in channels}
    lines = [f'{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in units.items()]
    mapping = "\n".join(['time = { column = "time", unit = "s" }', "[columns]", *lines, ""])
    stem = result.recording.stem
    return enclosure(text.getvalue().encode(), f"{stem}.csv", mapping.encode())


def recording_file(commands: Path, out: Path) -> Path:
    """Where the simulation of a table of commands is recorded."""
    return out / f"{commands.stem}-simulated.mcap"


def _record(result: SimulationResult, vessels: Sequence[Vessel]) -> None:
    """The motion as the topics that a replay writes: the vessel is the reference."""
    files = [
        Attachment(name, "application/toml", dump_vessel(vessel).encode())
        for name, vessel in zip(("vessel.toml", "follower.toml"), vessels, strict=False)
    ]
    now = np.round(result.time * 1e9).astype(np.int64)
    files += _as_log(result, vessels[0])
    whole = RecordingSettings(topics=TopicsKept.ALL)  # nothing else gives these rows again
    with Recorder(result.recording, attachments=files, settings=whole) as recorder:
        for start in range(0, len(now), BLOCK_ROWS):
            part = slice(start, start + BLOCK_ROWS)
            times = now[part], now[part]
            motions = [("reference", result.motion)]
            if result.follower is not None:
                motions.append(("shadow", result.follower))
            for topic, motion in motions:
                exact = np.zeros((len(now[part]), 9))  # a simulation knows its state
                values = np.hstack([motion[part][:, MOTION_FIELDS], exact])
                recorder.write_rows(encode_rows(topic, *times, values, {"source": "model"}))
            control = result.control if result.control is not None else result.commanded
            forces = np.hstack([control[part], result.commanded[part]])
            recorder.write_rows(encode_rows("control", *times, forces))
