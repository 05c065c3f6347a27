"""What a boat in the loop records: the truth and the outputs, fifty times a second of its time.

The truth also goes to zenoh, `shadow/<name>/truth`, for people who watch. It joins the bus that
`shadow live` or a router opens, and never opens one: without anybody there it tries again once a
second.
"""

import time
from collections.abc import Mapping
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gateway.json_rows import TopicRows, encode_rows
from gateway.live.outputs import unused_path
from gateway.monitor import RETRY_S, join_bus
from gateway.recording.recorder import Attachment, Recorder
from gateway.recording.thread import RecordingThread
from gateway.recording.writer import warm_up
from gateway.shadow.topic_rows import METADATA, attachments_of
from gateway.topics import OUTPUTS
from sim.hil.boat import Truth
from sim.plants import OWN_VESSEL, VESSEL, PlantChoice
from sim.vessel import Vessel

EVERY_S = 0.02
BLOCK_ROWS = 50
ROUNDING_S = 1e-6  # sums of steps miss a multiple of 20 ms by less


def loop_recorder(
    folder: Path,
    name: str,
    vessel: Vessel,
    day_text: str | None,
    seed: int,
    plant: PlantChoice = OWN_VESSEL,
) -> Recorder:
    """A recording `<name>-hil-<time>.mcap` with vessel, plant and day in it."""
    warm_up()
    stamp = time.strftime("%Y%m%d-%H%M%S", time.gmtime())
    config = {"hil": {"seed": seed}}
    attached = attachments_of(vessel, plant, config)
    if day_text is not None:
        attached.append(Attachment("day.toml", "application/toml", day_text.encode()))
    entries = {"gateway": version("shadow-gateway"), "vessel": name, "hil": "yes"}
    entries |= {} if plant.kind is VESSEL else {"plant": plant.kind.name}
    return Recorder(
        unused_path(folder, f"{name}-hil-{stamp}"),
        attachments=attached,
        metadata={METADATA: entries},
        live=True,
    )


class TruthRecording:
    """Rows of truth and outputs to a recording. The boat's clock goes on where it starts anew."""

    def __init__(self, name: str, thread: RecordingThread, unix_ns: int) -> None:
        self._name, self._thread = name, thread
        self._zero_ns, self._last_s, self._next_s = unix_ns, 0.0, 0.0
        self._times: list[tuple[int, int]] = []
        self._truth: list[Truth] = []
        self._outputs: list[list[float]] = []

    def put(self, truth: Truth, pulses: Mapping[int, float]) -> None:
        """After one step: a row where one is due."""
        self._last_s = truth.time
        if truth.time < self._next_s - ROUNDING_S:
            return
        self._next_s = max(self._next_s + EVERY_S, truth.time)
        self._times.append((self._zero_ns + round(truth.time * 1e9), time.time_ns()))
        self._truth.append(truth)
        self._outputs.append([float(pulses.get(n, 0.0)) for n in range(1, OUTPUTS + 1)])
        if len(self._times) >= BLOCK_ROWS:
            self.flush()

    def start(self, time_s: float = 0.0) -> None:
        """The boat's time is another: that of the recording goes on."""
        self._zero_ns += round((self._last_s - time_s) * 1e9)
        self._last_s = self._next_s = time_s

    def flush(self) -> None:
        """Hand over what waits."""
        if not self._times:
            return
        times = np.array(self._times, np.int64).T
        motion = np.array([row[1:] for row in self._truth])  # the first is the time
        for topic, values in (("truth", motion), ("outputs", np.array(self._outputs))):
            rows = encode_rows(topic, times[0], times[1], values)
            named = TopicRows(f"{topic}/{self._name}", times[0], times[1], rows.payloads)
            self._thread.rows([named])
        self._times, self._truth, self._outputs = [], [], []


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
