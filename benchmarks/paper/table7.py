"""Table 7: WAM-V under IAcquaBot's commands, then following IAcquaBot.

(a) with perfect knowledge; (b) with identified models: the reference is what the identified
IAcquaBot does under the driver's commands, the law knows the identified WAM-V, and the WAM-V that
moves has the true parameters; (c) the law knows a WAM-V whose nine numbers are each 10 % off.
"""

import numpy as np

from benchmarks.paper.campaign import Campaign
from benchmarks.paper.drawing import Motion, tracks, velocities
from benchmarks.paper.mismatch import followed
from benchmarks.paper.part import Part
from benchmarks.paper.published import TABLE_7_ALONE, TABLE_7_FOLLOWING, TABLE_7_STD
from benchmarks.paper.scoring import beside, reached, scored, spread
from benchmarks.paper.table4 import simulated
from gateway.figures import SeriesRole
from sim.state import Floats
from sim.vessel import Vessel

DT = 0.02  # s between rows of the reference: the gateway follows at 50 Hz


def table_7(c: Campaign) -> Part:
    """Uncontrolled, (a), (b) for each set of instruments, (c)."""
    true, wam = c.boats[0].vessel, c.boats[1].vessel
    reference, free = driven(c, true), driven(c, wam)
    columns = {"(a) perfect knowledge": (reference, followed(wam, wam, reference, DT))}
    for carried in c.instruments:
        known = driven(c, c.study(0, carried).identified)
        moved = followed(wam, c.study(1, carried).identified, known, DT)
        columns[f"(b) identified, {carried.name}"] = known, moved
    careless = c.boats[1].guessed(c.lengths.seed)
    columns["(c) 10 % off"] = reference, followed(wam, careless, reference, DT)
    scores = {n: scored(r[:, :6], m[:, :6]) for n, (r, m) in columns.items()}
    alone = scored(reference[:, :6], free[:, :6])
    u, v, r = TABLE_7_STD
    lines = [
        f"The reference, IAcquaBot under a joystick, varies by {spread(reference)} (the paper's "
        f"figures imply {u:g} m/s, {v:g} m/s, {r:g} rad/s).", "",
        *beside(TABLE_7_ALONE, [("WAM-V uncontrolled", alone)]), "",
        *beside(TABLE_7_FOLLOWING, list(scores.items()), list(scores)), "",
        *(f"{name}: {reached(TABLE_7_FOLLOWING, s)}." for name, s in scores.items()), "",
        "What IAcquaBot truly did is not its identified model's prediction; against the truth "
        "that remains, and no follower can mend it:", "",
        *beside(TABLE_7_FOLLOWING, [
            (n, scored(reference[:, :6], m[:, :6])) for n, (_, m) in columns.items() if "(b)" in n
        ]),
    ]  # fmt: skip
    held = {f"{n}: all six rows": reached(TABLE_7_FOLLOWING, s)[0] == "6"
            for n, s in scores.items() if "(c)" not in n}  # fmt: skip
    time: Floats = DT * np.arange(len(reference), dtype=np.float64)
    boat = Motion("IAcquaBot (reference)", SeriesRole.MEASURED, time, reference)
    loose = Motion("WAM-V uncontrolled", SeriesRole.MODEL, time, free)
    name = f"(b) identified, {c.instruments[0].name}"
    shadow = Motion(f"WAM-V following {name}", SeriesRole.SHADOW, time, columns[name][1])
    pictures = {
        "table_7": velocities("Table 7: WAM-V made to move as IAcquaBot", [boat, loose, shadow]),
        "table_7_tracks": tracks(
            "Table 7: tracks", [("uncontrolled", [boat, loose]), ("following", [boat, shadow])]
        ),
    }
    return Part("Table 7: model following", tuple(lines), held, pictures)


def driven(c: Campaign, vessel: Vessel) -> Floats:
    """A vessel under the joystick: motion (T, 9), from rest."""
    side = [0 if t.position[1] < 0.0 else 1 for t in vessel.thrusters]
    return simulated(vessel, c.driven[:, side], DT)
