"""All pictures of a comparison, by name."""

from collections.abc import Sequence

from gateway.figures import error_against, forces, independence, track, velocities, vessels
from gateway.figures.figure_data import FigureData
from sim.comparison.compare import Comparison
from sim.trial import Trial


def album(trial: Trial, comparisons: Sequence[Comparison]) -> dict[str, FigureData]:
    """One trial and its vessels under one ruler -> name of a picture -> what it shows."""
    pictures = {} if len(comparisons) < 2 else {"vessels": vessels.vessels(comparisons)}
    for one in comparisons:
        pictures |= {
            f"{one.vessel} velocities": velocities.horizon_runs(trial, one),
            f"{one.vessel} free run": velocities.free_run(trial, one),
            f"{one.vessel} track": track.track(trial, one),
            f"{one.vessel} shares": error_against.shares(one),
            f"{one.vessel} strips": error_against.strips(one),
            f"{one.vessel} missing force": forces.missing_force(one),
        }
        if one.independence is not None:
            pictures[f"{one.vessel} independence"] = independence.correlations(one)
    return pictures
