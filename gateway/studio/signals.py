"""Any field of any message of a recording as a signal, read by a worker of its own.

Derived signals are short expressions, read by a grammar of its own: no Python is ever run.

    expression  numbers, signals as MESSAGE.field or MESSAGE.field[k], names of derived signals,
                + - * / **, and the functions of `FUNCTIONS`

All signals are taken at the times of the first one that is named, linearly between their samples.
"""

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gateway.errors import BadInput, ShadowError
from gateway.figures import DEGREES
from gateway.files import stamp_of
from gateway.ingest.log import Boat, Log, Table, choose_boat
from gateway.ingest.log_events import on_boat_clock
from gateway.ingest.open import open_log
from gateway.studio.worker import Send, Worker, file_stamp
from sim.state import Floats

LONGEST, DEEPEST = 300, 8  # letters of an expression; derived signals of derived signals


class Signal(NamedTuple):
    """time (n,) [s] ascending, value (n,)."""

    time: Floats
    value: Floats


def _slope(x: Floats, time: Floats) -> Floats:
    return np.gradient(x, time) if len(x) > 1 else np.zeros_like(x)


def _mean(x: Floats, time: Floats, seconds: Any) -> Floats:
    """Of the time before and after each sample, `seconds` in all."""
    half = 0.5 * float(np.max(seconds))
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(x))])
    first, last = np.searchsorted(time, time - half), np.searchsorted(time, time + half, "right")
    return np.asarray((total[last] - total[first]) / np.maximum(last - first, 1))


FUNCTIONS: Mapping[str, tuple[int, Callable[..., Any]]] = {  # name -> arguments, what it does
    "abs": (1, np.abs), "sqrt": (1, np.sqrt), "exp": (1, np.exp), "log": (1, np.log),
    "sin": (1, np.sin), "cos": (1, np.cos), "tan": (1, np.tan), "atan2": (2, np.arctan2),
    "hypot": (2, np.hypot), "min": (2, np.minimum), "max": (2, np.maximum),
    "deg": (1, lambda x: x * DEGREES), "rad": (1, lambda x: x / DEGREES),
    "unwrap": (1, np.unwrap), "sum": (1, np.cumsum),
}  # fmt: skip
OVER_TIME: Mapping[str, tuple[int, Callable[..., Any]]] = {  # these are given the time as well
    "slope": (1, _slope), "mean": (2, _mean),
}  # fmt: skip
OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: np.divide,
    ast.Pow: np.power,
}  # fmt: skip
IN_EXPRESSIONS = (
    f"numbers, MESSAGE.field, + - * / **, and {', '.join(sorted((*FUNCTIONS, *OVER_TIME)))}"
)


class Expression:
    """A parsed expression. `names`: the signals in it, in order; BadInput where it is none."""

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST:
            raise BadInput(f"an expression has at most {LONGEST} letters")
        try:
            self._tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise BadInput(f"{text!r} is no expression: expected {IN_EXPRESSIONS}") from None
        self.text = text
        self.names: tuple[str, ...] = tuple(dict.fromkeys(self._named(self._tree)))
        if not self.names:
            raise BadInput(f"{text!r} names no signal: expected {IN_EXPRESSIONS}")

    def value(self, signals: Mapping[str, Signal]) -> Signal:
        """Of all its signals, by name."""
        time = signals[self.names[0]].time
        known = {n: np.interp(time, *signals[n], left=np.nan, right=np.nan) for n in self.names}
        with np.errstate(all="ignore"):
            value = np.asarray(self._of(self._tree, known, time), np.float64)
        return Signal(time, np.broadcast_to(value, time.shape))

    def _named(self, node: ast.expr) -> list[str]:
        """The signals below a node; BadInput for whatever the grammar does not hold."""
        name = _signal_name(node)
        if name is not None:
            return [name]
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float()):
                return []
            case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=one):
                return self._named(one)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                return [*self._named(left), *self._named(right)]
            case ast.Call(func=ast.Name(id=called), args=args, keywords=[]):
                count, _ = {**FUNCTIONS, **OVER_TIME}.get(called, (-1, None))
                if len(args) == count:
                    return [found for one in args for found in self._named(one)]
        wrong = ast.unparse(node)
        raise BadInput(f"{wrong!r} cannot stand in an expression: expected {IN_EXPRESSIONS}")

    def _of(self, node: ast.expr, known: Mapping[str, Floats], time: Floats) -> Any:
        name = _signal_name(node)
        if name is not None:
            return known[name]
        match node:
            case ast.Constant(value=int() | float() as number):
                return np.float64(number)
            case ast.UnaryOp(op=op, operand=one):
                value = self._of(one, known, time)
                return -value if isinstance(op, ast.USub) else value
            case ast.BinOp(left=left, op=op, right=right):
                both = self._of(left, known, time), self._of(right, known, time)
                return OPERATORS[type(op)](*both)
            case ast.Call(func=ast.Name(id=called), args=args):
                values = [np.broadcast_to(self._of(a, known, time), time.shape) for a in args]
                if called in OVER_TIME:
                    return OVER_TIME[called][1](values[0], time, *values[1:])
                return FUNCTIONS[called][1](*values)
        raise AssertionError(ast.dump(node))  # `_named` has let it in


def _signal_name(node: ast.expr) -> str | None:
    """A node that names a signal: NAME, MESSAGE.field, MESSAGE.field[k]; None for every other."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=ast.Name(id=message), attr=field):
            return f"{message}.{field}"
        case ast.Subscript(
            value=ast.Attribute(value=ast.Name(id=message), attr=field),
            slice=ast.Constant(value=int() as k),
        ) if not isinstance(k, bool):
            return f"{message}.{field}[{k}]"
    return None


def derived_signal(
    name: str, raw: Callable[[str], Signal | None], derived: Mapping[str, str], depth: int = 0
) -> Signal:
    """A signal by name: of the recording (`raw`) or derived from others; BadInput for no such."""
    if name not in derived:
        found = raw(name)
        if found is None:
            raise BadInput(f"{name}: no such signal in this recording")
        return found
    if depth > DEEPEST:
        raise BadInput(f"{name} is derived from itself, or from too many others")
    expression = Expression(derived[name])
    parts = {one: derived_signal(one, raw, derived, depth + 1) for one in expression.names}
    return expression.value(parts)


MOST_ELEMENTS = 32  # of an array field: a picture or a buffer is no signal


@dataclass(frozen=True)
class SignalRequest:
    """Signals of a recording that a page asks for, by name, some of them derived."""

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
def _opened(path: str, stamp: tuple[int, ...], mapping: str | None) -> Recording:
    log = open_log(path, mapping)
    return Recording(log, choose_boat(log))


def signals_task(send: Send, request: SignalRequest) -> SignalsView:
    """Read what is wanted; what cannot be read says why, and leaves the others as they are."""
    send(f"reading {Path(request.path).name}")
    found = _opened(request.path, file_stamp(request.path), request.mapping)
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
    _stamps: dict[str, list[int] | None] = field(default_factory=dict)  # of files, as they are read

    def forget_changed(self) -> None:
        """What was read of a file that has changed since is read again when it is asked for."""
        old = {path for path, stamp in self._stamps.items() if stamp_of(Path(path)) != stamp}
        self.answers = {k: v for k, v in self.answers.items() if k.path not in old}
        self.refused = {k: v for k, v in self.refused.items() if k.path not in old}

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
            self._stamps[self._reading.path] = stamp_of(Path(self._reading.path))
            self.worker.start("signals", signals_task, self._reading)
        return news
