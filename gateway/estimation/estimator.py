"""The filter as its users see it: events in, rows out, and a state that is a value.

The state is a pure function of the ordered events: it does not matter how they are cut into
chunks. Live gives chunks of a few events, replay whole arrays, to the same compiled loop.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.events import Events
from gateway.estimation.filter import run
from gateway.estimation.history import History, copied, new_history
from gateway.estimation.names import Flag
from gateway.estimation.settings import FilterSettings
from sim.state import Floats
from sim.trial import MOTION


@dataclass(frozen=True)
class FilterState:
    """All that the filter remembers. Never changed: `advance` returns a new one."""

    history: History


@dataclass(frozen=True)
class Rows:
    """What the filter says after each event.

    time_s      (K,)       of the estimate: of the newest event so far, not of a late one
    motion      (K, 9)     eta, nu, nu_dot, columns as in `State`
    std         (K, 9)     their standard deviations
    covariance  (K, 9, 9)  of the motion, or (K, 0, 0) where it was not asked for
    nis         (K,)       normalised innovation squared of the event
    used        (K,)       components used: degrees of freedom of `nis`; 0 where none was
    flags       (K,)       bits of `Flag`
    """

    time_s: Floats
    motion: Floats
    std: Floats
    covariance: Floats
    nis: Floats
    used: NDArray[np.int8]
    flags: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time_s)

    def has(self, flag: Flag) -> NDArray[np.bool_]:
        """Which rows carry that flag: (K,)."""
        return np.asarray((self.flags & int(flag)) != 0)


class Estimator:
    """A filter with its settings; it holds no state of its own."""

    def __init__(self, settings: FilterSettings | None = None) -> None:
        self.settings = settings or FilterSettings()
        self._model = self.settings.model()

    def start(self) -> FilterState:
        """The state before the first event."""
        return FilterState(new_history(self.settings.history_events, self._model))

    def advance(
        self, state: FilterState, events: Events, covariance: bool = False, spend: bool = False
    ) -> tuple[FilterState, Rows]:
        """Takes K events in the order of their receipt -> the state after them, K rows.

        `spend`: the caller has no more use for `state`, its memory (0.4 MB) becomes the new one's.
        """
        history = state.history if spend else copied(state.history)
        rows = _empty_rows(len(events), MOTION if covariance else 0)
        run(
            history,
            events.time_s,
            events.kind,
            events.z,
            events.std,
            self._model,
            rows.time_s,
            rows.motion,
            rows.std,
            rows.covariance,
            rows.nis,
            rows.used,
            rows.flags,
        )
        return FilterState(history), rows


def _empty_rows(count: int, size: int) -> Rows:
    return Rows(
        np.empty(count),
        np.empty((count, MOTION)),
        np.empty((count, MOTION)),
        np.empty((count, size, size)),
        np.empty(count),
        np.empty(count, np.int8),
        np.empty(count, np.uint8),
    )
