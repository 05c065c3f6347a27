"""What commands that run for long share: an end that a signal asks for, and lines that they print.

`threading.Event` is no flag for a signal handler: the handler runs in the main thread between two
of its instructions, and waits for ever where that thread holds the event's lock, as it does while
it goes to sleep on it.

Lines are text for people, JSON for programs (`--log json`). A line is a string, so that whoever
only prints needs to know no more; its level, kind and vessel are those of the event that it tells.
"""

import errno
import signal
import sys
import threading
import time
from datetime import UTC, datetime
from enum import StrEnum
from types import FrameType, TracebackType
from typing import Any, Self

import orjson

from gateway.errors import one_line

LOOK_S = 0.05  # so often whoever sleeps looks whether the end was asked for
AGAIN_S = 0.5  # what comes sooner is the same signal: `timeout` signals a program, then its group
HANGUP: int | None = getattr(signal, "SIGHUP", None)  # Windows has none


def other_ends() -> tuple[int, ...]:
    """Signals beside Ctrl-C that ask for the end: SIGTERM, and SIGHUP of a window that was closed.

    Where SIGHUP is ignored (`nohup`) it stays so.
    """
    if HANGUP is None or signal.getsignal(HANGUP) is signal.SIG_IGN:
        return (signal.SIGTERM,)
    return (signal.SIGTERM, HANGUP)


class Stop:
    """Set once, by a signal handler or another thread; takes no lock."""

    def __init__(self) -> None:
        self._asked = False
        self._asked_s = float("-inf")

    def set(self) -> None:
        """Ask for the end."""
        if not self._asked:
            self._asked_s = time.monotonic()
        self._asked = True

    def set_again(self) -> bool:
        """Ask for the end -> whether that was asked for before, more than a moment ago."""
        again = self._asked and time.monotonic() - self._asked_s > AGAIN_S
        self.set()
        return again

    def is_set(self) -> bool:
        """Whether the end was asked for."""
        return self._asked

    def wait(self, seconds: float) -> bool:
        """Sleep for so long, or until the end is asked for -> whether it was."""
        end = time.monotonic() + seconds
        while not self._asked and (left := end - time.monotonic()) > 0.0:
            time.sleep(min(left, LOOK_S))
        return self._asked


class Interrupts:
    """Inside `with`, SIGINT, SIGTERM and SIGHUP wait for the next `check` or `sleep`, or its end.

    What is open (a zenoh session, a recorder) is never left in the middle of a step, nor while it
    closes. A second signal, a moment later, interrupts at once: not so SIGHUP, which a shell passes
    on once more as it ends. Outside of the main thread this
    does nothing: there Python delivers no signals.
    """

    def __init__(self) -> None:
        self._stop = Stop()
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, *other_ends()):
                self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if kind is None:
            self.check()

    def check(self) -> None:
        """KeyboardInterrupt where a signal has come."""
        if self._stop.is_set():
            raise KeyboardInterrupt

    def sleep(self, seconds: float) -> None:
        """Sleep; KeyboardInterrupt as soon as a signal has come."""
        self._stop.wait(seconds)
        self.check()

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self._stop.set_again() and number != HANGUP:
            raise KeyboardInterrupt


def stop_on_signals() -> Stop:
    """A `Stop` that SIGINT, SIGTERM and SIGHUP set; a later one of the first two ends at once."""
    stop = Stop()

    def ask(number: int, _: FrameType | None) -> None:
        if stop.set_again() and number != HANGUP:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    for number in (signal.SIGINT, *other_ends()):
        signal.signal(number, ask)
    return stop


class LogFormat(StrEnum):
    """How lines are printed."""

    TEXT = "text"
    JSON = "json"


class LogLine(str):
    """A line with what programs want to know of it; kind and vessel empty where there is none."""

    level: str
    kind: str
    vessel: str

    def __new__(cls, text: str, level: str = "info", kind: str = "", vessel: str = "") -> Self:
        line = super().__new__(cls, text)
        line.level, line.kind, line.vessel = level, kind, vessel
        return line


def print_line(text: str, form: LogFormat = LogFormat.TEXT) -> None:
    """Print on standard error: text, or one JSON object of time, level, kind, vessel, message.

    A terminal that is gone (EIO) takes no line; what runs goes on, or ends in order.
    """
    shown = one_line(text)
    if form is LogFormat.JSON:
        line = text if isinstance(text, LogLine) else LogLine(text)
        now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        shown = orjson.dumps({
            "time": now, "level": line.level, "kind": line.kind, "vessel": line.vessel,
            "message": shown,
        }).decode()  # fmt: skip
    try:
        print(shown, file=sys.stderr, flush=True)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
