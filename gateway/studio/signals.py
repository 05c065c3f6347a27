"""Any field of any message of a recording as a signal, read by a worker of its own."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from gateway.errors import ShadowError
from gateway.ingest.happenings import on_boat_clock
from gateway.ingest.log import Boat, Log, Table, choose_boat
from gateway.ingest.open import open_log
from gateway.studio.expression import Signal, derived_signal
from gateway.studio.worker import Send, Worker
from sim.state import Floats

MOST_ELEMENTS = 32  # of an array field: a picture or a buffer is no signal


@dataclass(frozen=True)
class SignalRequest:
    """What a page wants: signals of a recording by name, some of them derived."""

    path: str
    names: tuple[str, ...] = ()
    derived: tuple[tuple[str, str], ...] = ()
    mapping: str | None = None


@dataclass(frozen=True)
class SignalsView:
    """fields: MESSAGE.field, all there are; signals by name; refused: name -> why there is none."""

    request: SignalRequest
    fields: tuple[str, ...]
    signals: Mapping[str, Signal]
    refused: Mapping[str, str]


class Recording:
    """An open recording; its fields are decoded once."""

    def __init__(self, log: Log, boat: Boat) -> None:
        self._log, self._boat, self._times = log, boat, on_boat_clock(log, boat)
        tables = {name: log.table(name) for name in log.counts()}
        self._tables = {name: table for name, table in tables.items() if len(table)}
        firsts = [int(self._times(table)[0]) for table in self._tables.values()]
        self._start_ns = min(firsts, default=0)
        self.fields = tuple(
            f"{name}.{one}" for name, table in sorted(self._tables.items())
            for one in _fields(table)
        )  # fmt: skip

    def signal(self, name: str) -> Signal | None:
        """A field by name, over the seconds since the recording's first message."""
        message, _, of = name.partition(".")
        table = self._tables.get(message)
        key, _, rest = of.partition("[")
        if table is None or name not in self.fields:
            return None
        rows = table.sent_by(self._boat)
        rows = rows if rows.any() else np.ones(len(table), np.bool_)
        values = np.asarray(table.columns[key], np.float64)[rows]
        time = (self._times(table)[rows] - self._start_ns) * 1e-9
        value: Floats = values[:, int(rest.rstrip("]"))] if rest else values
        time, first = np.unique(time, return_index=True)
        return Signal(time, value[first])


def _fields(table: Table) -> list[str]:
    """Names of a message's numbers, one for each element of an array."""
    out: list[str] = []
    for name, values in table.columns.items():
        if values.dtype.kind not in "iufb":
            continue
        if values.ndim == 1:
            out.append(name)
        elif values.ndim == 2 and values.shape[1] <= MOST_ELEMENTS:
            out += [f"{name}[{k}]" for k in range(values.shape[1])]
    return out


@lru_cache(maxsize=2)
def _opened(path: str, stamp: int, mapping: str | None) -> Recording:
    log = open_log(path, mapping)
    return Recording(log, choose_boat(log))


def signals_task(send: Send, request: SignalRequest) -> SignalsView:
    """Read what is wanted; what cannot be read says why, and leaves the others as they are."""
    send(f"reading {Path(request.path).name}")
    found = _opened(request.path, Path(request.path).stat().st_mtime_ns, request.mapping)
    signals: dict[str, Signal] = {}
    refused: dict[str, str] = {}
    for name in request.names:
        try:
            signals[name] = derived_signal(name, found.signal, dict(request.derived))
        except ShadowError as error:
            refused[name] = str(error)
    return SignalsView(request, found.fields, signals, refused)


@dataclass
class SignalReader:
    """A worker that reads for all pages, the latest request first; answers by request."""

    worker: Worker = field(default_factory=Worker)
    answers: dict[SignalRequest, SignalsView] = field(default_factory=dict)
    refused: dict[SignalRequest, str] = field(default_factory=dict)
    _wanted: SignalRequest | None = None
    _reading: SignalRequest | None = None

    def ask(self, request: SignalRequest) -> None:
        """Read this next, unless it was read already."""
        if request not in self.answers and request not in self.refused | {self._reading: ""}:
            self._wanted = request

    def update(self) -> bool:
        """Take what was read, begin the next; whether there is something new."""
        news = False
        for message in self.worker.messages():
            if message.kind in ("done", "failed") and self._reading is not None:
                if message.kind == "done":
                    self.answers = {self._reading: message.value}  # of now: they may be large
                else:
                    self.refused[self._reading] = message.value
                self._reading, news = None, True
        if self._wanted is not None and not self.worker.busy:
            self._reading, self._wanted = self._wanted, None
            self.worker.start("signals", signals_task, self._reading)
        return news
