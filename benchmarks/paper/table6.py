"""Table 6: the identified model, left alone from the first sample, against the measurement.

Beside it the error that a perfect model shows on the same recording (what the sensors cost), the
model of the paper's own method, and the identified model against the true motion. Commands are
sampled 25 times a second: a change happened up to 40 ms before it is told. How late that makes them
was found along with the parameters, on the other log (`command_offset`), and serves here for all.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.paper.campaign import Campaign, Study
from benchmarks.paper.drawing import Motion, tracks, velocities
from benchmarks.paper.part import Part
from benchmarks.paper.published import TABLE_6, Scores
from benchmarks.paper.scoring import beside, reached, scored, spread
from gateway.figures import FigureData, SeriesRole
from sim.identification import BASE, updated_vessel
from sim.model import Model
from sim.prediction import input_table, measured_motion, runs_from
from sim.prediction.segments import longest_stretch
from sim.state import Floats
from sim.vessel import Vessel

JUDGED = "identified"


def table_6(c: Campaign) -> Part:
    """One table per boat and instruments."""
    lines: list[str] = ["RMSE / MAE / R²; ✓: at least as good as the paper in all three."]
    held, pictures = {}, {}
    for study in c.studies.values():
        paper, columns = TABLE_6[study.pair.name], compared(study)
        name = f"{study.pair.name}, {study.instruments.name}"
        told = reached(paper, columns[JUDGED])
        seconds = float(study.validation.usable.sum()) * study.validation.dt
        lines += [
            "", f"**{name}**: free run over {seconds:.0f} s; the boat varies by "
            f"{spread(study.true_validation)}; commands act {-1e3 * command_offset(study):.0f} ms "
            "before they are told", "",
            *beside(paper, list(columns.items()), [JUDGED]), "", f"{told}.",
        ]  # fmt: skip
        floor = reached(paper, columns["perfect model"])
        lines += [f"A perfect model on the same recording: {floor}."]
        held[f"{name}: every row (reached: {told[0]} of 6; by a perfect model: {floor[0]})"] = (
            told[0] == "6"
        )
        pictures[f"table_6_{study.pair.boat.name.lower()}_{study.instruments.name}"] = _picture(
            study
        )
    pictures["table_6_tracks"] = _tracks(c)
    return Part("Table 6: model against measurement", tuple(lines), held, pictures)


class Run(NamedTuple):
    """Measured, modelled and true (eta, nu) (R, 6) at times (R,) [s]."""

    time: Floats
    measured: Floats
    model: Floats
    true: Floats


def compared(study: Study) -> dict[str, Scores]:
    """Columns of the table."""
    found = alone(study, study.identified)
    perfect, printed = (alone(study, v) for v in (study.pair.vessel, by_least_squares(study)))
    return {
        JUDGED: scored(found.measured, found.model),
        "perfect model": scored(perfect.measured, perfect.model),
        "LQS printed": scored(printed.measured, printed.model),
        "identified against the truth": scored(found.true, found.model),
    }


def alone(study: Study, vessel: Vessel) -> Run:
    """A vessel left alone from the first usable sample to the last."""
    trial, model = study.validation, Model.of(vessel)
    rows = longest_stretch(trial)
    first, motion = np.array([rows.start]), measured_motion(trial)
    runs = runs_from(first, np.array([len(rows) - 1]), command_offset(study))
    _, said = model.run(model.true_states(motion[first]), runs, input_table(model, trial))
    part = slice(rows.start, rows.stop)
    return Run(trial.time[part], motion[part, :6], said[0, :, :6], study.true_validation[part])


def command_offset(study: Study) -> float:
    """How much later than told the commands act [s]: below 0 where telemetry tells them late."""
    return study.found.command_offset


def by_least_squares(study: Study) -> Vessel:
    """The vessel that the paper's own method finds; what would push it along is taken as zero."""
    values = dict(zip(BASE, study.printed.value.tolist(), strict=True))
    usable = {n: max(v, 1e-3) if n in BASE[:3] else min(v, 0.0) for n, v in values.items()}
    return updated_vessel(study.pair.vessel, usable)


def _motions(study: Study) -> list[Motion]:
    run = alone(study, study.identified)
    return [
        Motion("measured", SeriesRole.MEASURED, run.time, run.measured),
        Motion("identified model, left alone", SeriesRole.MODEL, run.time, run.model),
    ]


def _picture(study: Study) -> FigureData:
    name = f"{study.pair.name}, {study.instruments.name}"
    return velocities(f"Table 6: {name}", _motions(study))


def _tracks(c: Campaign) -> FigureData:
    return tracks(
        "Table 6: tracks",
        [(f"{s.pair.name}, {s.instruments.name}", _motions(s)) for s in c.studies.values()],
    )
