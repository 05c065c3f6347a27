"""How much of our topics players are shown: the first row in each tenth of a second, all events.

One thinning for recordings and for the live server.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.foxglove import CHANNELS, Channel

UNTHINNED = "event"  # each says something of its own


class Shown(NamedTuple):
    """Messages of one channel, and which rows they were made from."""

    channel: Channel
    rows: list[int]
    payloads: list[bytes]


class PlayerRows:
    """Rows of our topics -> what players know, for one boat and one file or server."""

    def __init__(self, rate_hz: float, channels: Sequence[Channel] = CHANNELS) -> None:
        self.channels = tuple(channels)
        self._step_ns = round(1e9 / rate_hz)
        self._of: dict[str, list[Channel]] = {}
        for channel in channels:
            self._of.setdefault(channel.source, []).append(channel)
        self._step: dict[str, int] = {}  # of time, in which the last row was shown

    def of(
        self,
        topic: str,
        log_times: NDArray[np.int64],
        payloads: Sequence[bytes],
        wanted: Callable[[Channel], bool] = lambda channel: True,
    ) -> Iterator[Shown]:
        """Times (K,) [ns] and K messages of a topic -> the messages of each channel wanted."""
        channels = [channel for channel in self._of.get(topic, ()) if wanted(channel)]
        if not channels or not len(log_times):
            return
        chosen = self._thinned(topic, log_times)
        rows = [orjson.loads(payloads[i]) for i in chosen]
        for channel in channels if rows else ():
            yield Shown(channel, chosen, [orjson.dumps(channel.convert(row)) for row in rows])

    def _thinned(self, topic: str, log_times: NDArray[np.int64]) -> list[int]:
        if topic == UNTHINNED:
            return list(range(len(log_times)))
        step = log_times // self._step_ns
        fresh = np.diff(step, prepend=self._step.get(topic, -1)) > 0
        self._step[topic] = int(step[-1])
        return np.flatnonzero(fresh).tolist()
