"""The truth of boats in the loop on zenoh, `shadow/<name>/truth`, for people who watch.

It joins the bus that `shadow live` or a router opens, and never opens one: without anybody there it
tries again once a second.
"""

import time
from contextlib import ExitStack
from typing import Any

import numpy as np

from gateway.json_rows import encode_rows
from gateway.monitor import RETRY_S, join_bus
from sim.hil.boat import Truth


class TruthOnBus:
    """Publishes what is new; a session is open until `scope` ends. BadInput: no endpoint."""

    def __init__(self, endpoint: str, scope: ExitStack) -> None:
        self._endpoint, self._scope = endpoint, scope
        self._session: Any = None
        self._next_try_s = -float("inf")
        self._begun_ns = time.time_ns()
        self._last: dict[str, Truth] = {}
        self._joined()

    def publish(self, name: str, truth: Truth | None) -> None:
        """A boat's latest truth, unless it is the one that was published last."""
        if truth is None or truth is self._last.get(name) or not self._joined():
            return
        self._last[name] = truth
        vehicle = np.array([self._begun_ns + round(truth.time * 1e9)])
        rows = encode_rows("truth", vehicle, np.array([time.time_ns()]), np.array([truth[1:]]))
        for payload in rows.payloads:
            self._session.put(f"shadow/{name}/truth", payload)

    def _joined(self) -> bool:
        if self._session is None and time.monotonic() >= self._next_try_s:
            self._next_try_s = time.monotonic() + RETRY_S
            session = join_bus(self._endpoint, None)
            self._session = None if session is None else self._scope.enter_context(session)
        return self._session is not None
