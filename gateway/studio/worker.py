"""Long work in a process of its own: it reports progress, fails in a sentence, and is cancelled
at any moment by ending the process. The page and a live shadow beside it keep their rate.
"""

import multiprocessing
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Literal, Self

from gateway.errors import ShadowError
from sim.effects.effect import LawError

Send = Callable[[Any], None]  # takes a line of progress, or a part of the result
NICE = 5  # steps of lower priority: a live shadow on this machine goes first
GONE = "the work ended without an answer (out of memory?): try again with fewer recordings"
BUG = "the studio has a fault here; its log says more"


@dataclass(frozen=True)
class JobMessage:
    """What came of a job: a line of progress, a part, the result, or why there is none."""

    job: str
    kind: Literal["progress", "part", "done", "failed"]
    value: Any


class Worker:
    """One process that does one job at a time; started when there is a job."""

    def __init__(self) -> None:
        self._process: Any = None
        self._connection: Connection | None = None
        self.job: str | None = None
        self.progress = ""
        self._since = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.cancel()

    @property
    def busy(self) -> bool:
        """Is there a job under way?"""
        return self.job is not None

    @property
    def seconds(self) -> float:
        """How long the job has been under way."""
        return time.monotonic() - self._since if self.busy else 0.0

    def start(self, job: str, task: Callable[..., Any], *arguments: Any) -> None:
        """Begin a job; `task(send, *arguments)` is a module-level function."""
        if self.busy:
            raise RuntimeError(f"busy with {self.job}: wait for it, or press Cancel")
        if self._process is None or not self._process.is_alive():
            self._begin()
        assert self._connection is not None
        self.job, self.progress, self._since = job, "starting", time.monotonic()
        self._connection.send((task, arguments))

    def messages(self) -> list[JobMessage]:
        """What has come since the last time; never waits."""
        out: list[JobMessage] = []
        while self.busy and self._connection is not None:
            try:
                if not self._connection.poll():
                    break
                kind, value = self._connection.recv()
            except (EOFError, OSError):
                kind, value = "failed", GONE
                self._forget()
            out.append(JobMessage(str(self.job), kind, value))
            if kind == "progress":
                self.progress = value
            elif kind in ("done", "failed"):
                self.job = None
        return out

    def cancel(self) -> None:
        """End the process, whatever it does; the next job begins a new one."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join(2.0)
            if self._process.is_alive():
                self._process.kill()
        self._forget()
        self.job = None

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        self._process = context.Process(target=serve_jobs, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self._connection = ours

    def _forget(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


def serve_jobs(connection: Connection) -> None:
    """The other process: jobs come in, messages go out, until the connection ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the studio's to handle
    if hasattr(os, "nice"):
        os.nice(NICE)

    def send(value: Any) -> None:
        connection.send(("progress" if isinstance(value, str) else "part", value))

    while True:
        try:
            task, arguments = connection.recv()
        except (EOFError, OSError):
            return
        connection.send(outcome(task, arguments, send))


def outcome(task: Callable[..., Any], arguments: Any, send: Send) -> tuple[str, Any]:
    """`done` and the result, or `failed` and one line; a traceback goes to the log alone."""
    try:
        return "done", task(send, *arguments)
    except (ShadowError, LawError) as error:
        return "failed", " ".join(str(error).split())
    except Exception as error:  # the outermost loop of this process
        print(traceback.format_exc(), file=sys.stderr, flush=True)
        return "failed", f"{BUG} ({type(error).__name__})"
