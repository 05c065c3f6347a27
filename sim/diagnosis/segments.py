"""From which moments a model runs freely, and how long it may: before any limit by spread."""

from dataclasses import dataclass

import numpy as np

from sim.diagnosis.blocks import stretches
from sim.diagnosis.settings import CompareSettings
from sim.state import Ints
from sim.trial import Trial

SHORTEST_STRETCH = 2.0  # s of usable time that still give a segment


class NoUsableTimeError(ValueError):
    """The trial has no stretch that a model could be compared over."""


@dataclass(frozen=True)
class Segments:
    """Many moments of a trial from which free runs start.

    rows     (S,)  row of the trial where the segment starts
    nodes    (S,)  its length in nodes
    stride         steps of the trial from node to node
    """

    rows: Ints
    nodes: Ints
    stride: int

    @property
    def steps(self) -> Ints:
        """Lengths (S,) in steps of the trial."""
        return self.nodes * self.stride


def segments_of(trial: Trial, settings: CompareSettings) -> Segments:
    """Segments that lie within one usable stretch each; NoUsableTimeError if there is none.

    A stretch shorter than the horizon gives one segment as long as itself.
    """
    stride = max(round(settings.node / trial.dt), 1)
    node = stride * trial.dt
    longest = max(round(settings.horizon / node), 1)
    apart = max(round(settings.every / node), 1)
    rows, nodes = [], []
    for stretch in stretches(trial.usable):
        room = (len(stretch) - 1) // stride
        if room * node < min(SHORTEST_STRETCH, settings.horizon) - 1e-9:
            continue
        first = np.arange(0, max(room - longest, 0) + 1, apart)
        rows.append(stretch.start + stride * first)
        nodes.append(np.full(len(first), min(room, longest)))
    if not rows:
        raise NoUsableTimeError(
            f"{trial.name}: no usable stretch of {SHORTEST_STRETCH:g} s or more to compare over"
        )
    return Segments(np.concatenate(rows), np.concatenate(nodes), stride)
