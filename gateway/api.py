"""What `import gateway` offers to a notebook: files in, values out, and figures of results.

import gateway as gw
boat = gw.load_vessel("otter")                 a vessel that ships, or a file
trials = gw.load_trials("voyage.tlog")         what all offline work reads
figures = gw.plot(sim.compare(trials, boat), trials)
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.files import RECORDINGS, write_whole
from gateway.vessel_file import dump_vessel
from sim.comparison.compare import Comparison
from sim.comparison.improvement import by_trial
from sim.diagnosis.answer import Diagnosis
from sim.identification.identify import Identification
from sim.near_names import did_you_mean
from sim.trial import Trial
from sim.vessel import Vessel

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_vessel(vessel: Vessel, path: str | Path) -> Path:
    """Write a vessel file, whole or not at all; `load_vessel` of it gives the same vessel."""
    file = Path(path)
    write_whole(file, dump_vessel(vessel).encode(), "the vessel file")
    return file


def example_log(name: str) -> Path:
    """A recording that ships, by its name (`voyage_1`); FileNotFoundError names those there are."""
    file = RECORDINGS / f"{name}.tlog"
    if not file.is_file():
        names = sorted(f.stem for f in RECORDINGS.glob("*.tlog"))
        meant = did_you_mean(name, names)
        raise FileNotFoundError(f"no recording {name!r} ships: {meant}there are {', '.join(names)}")
    return file


def plot(
    result: Comparison | Sequence[Comparison] | Identification | Diagnosis,
    trials: Trial | Sequence[Trial],
) -> Mapping[str, "Figure"]:
    """Figures of a result by name, drawn by matplotlib; `trials` are those it was made from.

    Comparisons: motion, errors and missing force on the trial of the first one. An identification:
    how the parameters changed, with intervals. A diagnosis: ladder, ranking, evidence.
    """
    from gateway.figures import comparison, diagnosis, motion
    from gateway.figures.matplotlib_draw import draw_figure

    some = [trials] if isinstance(trials, Trial) else list(trials)
    if isinstance(result, Diagnosis):
        figures = diagnosis.diagnosis_figures(result, some)
    elif isinstance(result, Identification):
        changes = motion.parameter_changes(result.vessel.name, result.estimates)
        figures = {"parameters": changes}
    else:
        compared = [result] if isinstance(result, Comparison) else list(result)
        mine = by_trial(compared)[0]
        trial = next(t for t in some if t.name == mine[0].log)
        figures = comparison.comparison_figures(trial, mine)
    return {name: draw_figure(figure) for name, figure in figures.items()}
