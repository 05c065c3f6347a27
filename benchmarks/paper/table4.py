"""Table 4 and Figure 6: two boats under the same excitation move differently.

The paper's R² and RMSE imply that WAM-V's motion is the yardstick. "Same" is taken twice: the same
commands of port and starboard thrusters, and the same forces (IAcquaBot pushed as WAM-V is).
"""

from dataclasses import replace

import numpy as np

from benchmarks.paper.campaign import Campaign
from benchmarks.paper.drawing import Motion, velocities
from benchmarks.paper.part import Part
from benchmarks.paper.published import TABLE_4, Scores
from benchmarks.paper.scoring import beside, scored, spread
from benchmarks.paper.voyage import motion_of
from gateway.figures import SeriesRole
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel


def table_4(c: Campaign) -> Part:
    """Nothing to reach: the boats are as different as they are."""
    armed = c.validation[1].armed
    small, large = (motion_of(t)[armed] for t in c.validation)
    pushed = same_force(c)[: len(large)]
    columns = [("same commands", _three(large, small)), ("same forces", _three(large, pushed))]
    time = c.validation[1].time[armed]
    lines = (
        f"WAM-V under the validation excitation varies by {spread(large)} (the paper's figures "
        "imply 0.71 m/s, 0.227 m/s, 0.481 rad/s); nothing is to be reached here.",
        "",
        *beside(TABLE_4, columns),
    )
    picture = velocities(
        "Figure 6: two boats, the same commands",
        [
            Motion("WAM-V", SeriesRole.MEASURED, time, large),
            Motion("IAcquaBot", SeriesRole.MODEL, time, small),
            Motion("IAcquaBot, same forces", SeriesRole.SHADOW, time, pushed),
        ],
    )
    return Part("Table 4: IAcquaBot against WAM-V", lines, pictures={"figure_6": picture})


def same_force(c: Campaign) -> Floats:
    """IAcquaBot's hull with WAM-V's thrusters under the validation commands: (T, 6)."""
    hull, engines = c.boats[0].vessel, c.boats[1].vessel
    truth = c.validation[1]
    return simulated(
        replace(hull, thrusters=engines.thrusters),
        engines.commands(
            [m.channel for m in c.boats[1].boat.motors], truth.pulses[truth.armed].astype(float)
        ),
    )


def simulated(vessel: Vessel, commands: Floats, dt: float = 0.02) -> Floats:
    """Commands (T, na) from rest at the origin -> motion (T + 1, 9)."""
    return np.asarray(Model.of(vessel).simulate(commands, dt)[1][0])


def _three(reference: Floats, other: Floats) -> Scores:
    return {k: v for k, v in scored(reference, other[:, :6]).items() if k in TABLE_4}
