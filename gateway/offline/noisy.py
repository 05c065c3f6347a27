"""That what a log reports scatters more than its source usually does, in words."""

from collections.abc import Mapping

import numpy as np

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.events import KIND_OF
from gateway.estimation.scatter import LEAST, white_std
from gateway.ingest.sources import Choice

TOLD = {  # the kinds whose scatter is told, in which unit, and that unit over SI
    MeasurementKind.YAW_RATE: ("yaw rate", "°/s", 180.0 / np.pi),
    MeasurementKind.VELOCITY: ("velocity", "m/s", 1.0),
    MeasurementKind.BODY_VELOCITY: ("velocity", "m/s", 1.0),
}


def noisy_notices(
    choices: Mapping[str, Choice], settings: FilterSettings, epoch_ns: int
) -> list[str]:
    """One sentence for each chosen source that scatters by twice what is assumed and more."""
    out = list[str]()
    for choice in choices.values():
        kind = KIND_OF.get(choice.samples.quantity)
        if kind not in TOLD:
            continue
        time = choice.samples.seconds(epoch_ns)
        order = np.argsort(time, kind="stable")
        values = choice.samples.values.reshape(len(time), -1)
        std, assumed = (
            white_std(time[order], values[order]),
            settings.white_std(kind, choice.samples.equivalent),
        )
        if not std**2 > LEAST * assumed**2:  # nor where it is not told
            continue
        name, unit, factor = TOLD[kind]
        out.append(
            f"{name} ({choice.source}) scatters by {std * factor:.2g} {unit} from one report to "
            f"the next, {std / assumed:.0f} times what is usual: each report counts for less"
        )
    return out
