"""The digital shadow that the paper leaves to future work: ν_ref is measured, and noisy.

IAcquaBot's joystick run as telemetry through the live path (`ShadowPath`: Kalman filter, measured
reference, follower), fact by fact in order of receipt, nothing looked up ahead. The shadow is held
against what the boat truly did at the boat's time of each row.
"""

from pathlib import Path

import numpy as np

from benchmarks.paper.campaign import Campaign
from benchmarks.paper.drawing import Motion, tracks, velocities
from benchmarks.paper.instruments import Instruments
from benchmarks.paper.part import Part
from benchmarks.paper.published import TABLE_7_FOLLOWING, Scores
from benchmarks.paper.scoring import beside, scored
from benchmarks.paper.voyage import clock_offset_s, logged, true_at
from gateway.config import Settings
from gateway.figures import FigureData, SeriesRole
from gateway.ingest.open import open_log
from gateway.offline.replay import replay_input_of
from gateway.shadow.path import ShadowPath, ShadowRows, follower_of
from sim.following.follower import Reference, ReferenceMode
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

SETTLED_S = 5.0  # after arming: the filter has found its feet long before


def shadows(c: Campaign, folder: Path) -> Part:
    """Per instruments: the filter, IAcquaBot's own shadow, WAM-V as the shadow."""
    lines = [
        "Shadow against the true motion of IAcquaBot. The paper's column is Table 7, whose "
        "reference has no noise: a yardstick, not a demand.",
    ]
    pictures: dict[str, FigureData] = {}
    for carried in c.instruments:
        log = logged(
            folder / "joystick.tlog", c.boats[0].boat, c.joystick, carried, 1000 * c.lengths.seed
        )
        columns: dict[str, Scores] = {}
        for pair in c.boats:
            out = shadowed(log, c.study(0, carried).identified, pair.vessel, carried)
            times = out.vehicle_time_ns * 1e-9 - clock_offset_s(log)
            rows = (times > SETTLED_S) & (times < c.joystick.time[c.joystick.armed][-1])
            true = true_at(c.joystick, times[rows])
            columns.setdefault("Kalman filter", scored(true, out.estimate[rows, :6]))
            columns[f"shadow: {pair.name}"] = scored(true, out.shadow[rows, :6])
        lines += ["", f"**{carried.name}**", "", *beside(TABLE_7_FOLLOWING, list(columns.items()))]
        pictures |= _pictures(carried, times[rows], true, out.shadow[rows])
    return Part("The digital shadow on measured ν_ref", tuple(lines), {}, pictures)


def shadowed(log: Path, vessel: Vessel, plant: Vessel, carried: Instruments) -> ShadowRows:
    """A log through the live path with that plant."""
    settings, model = Settings(filter=carried.live), Model.of(vessel)
    given = replay_input_of(open_log(log), settings=settings)
    path = ShadowPath(
        model,
        Reference(model, ReferenceMode.MEASURED),
        follower_of(Model.of(plant), settings.following.follower),
        given.settings.filter,
    )
    return path.advance(path.start(), given.feed)[1]


def _pictures(
    carried: Instruments, times: Floats, true: Floats, shadow: Floats
) -> dict[str, FigureData]:
    boat = Motion("IAcquaBot, true", SeriesRole.MEASURED, times, true)
    follows = Motion("WAM-V, its shadow", SeriesRole.SHADOW, times, np.asarray(shadow))
    title = f"Digital shadow through {carried.name}"
    return {
        f"shadow_{carried.name}": velocities(title, [boat, follows]),
        f"shadow_{carried.name}_track": tracks(title, [("track", [boat, follows])]),
    }
