"""An end that a signal asks for.

`threading.Event` is no flag for a signal handler: the handler runs in the main thread between two
of its instructions, and waits for ever where that thread holds the event's lock, as it does while
it goes to sleep on it.
"""

import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Any, Self

LOOK_S = 0.05  # so often whoever sleeps looks whether the end was asked for


class Stop:
    """Set once, by a signal handler or another thread; takes no lock."""

    def __init__(self) -> None:
        self._asked = False

    def set(self) -> None:
        """Ask for the end."""
        self._asked = True

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
    """Inside `with`, SIGINT and SIGTERM wait for the next `check` or `sleep`, or for the end of it.

    What is open (a zenoh session, a recorder) is never left in the middle of a step, nor while it
    closes. A second signal interrupts at once. Outside of the main thread this does nothing: there
    Python delivers no signals.
    """

    def __init__(self) -> None:
        self._stop = Stop()
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
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
        if self._stop.is_set():
            raise KeyboardInterrupt
        self._stop.set()


def stop_on_signals() -> Stop:
    """A `Stop` that SIGINT and SIGTERM set; the same signal again ends the program at once."""
    stop = Stop()

    def ask(number: int, _: FrameType | None) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    return stop
