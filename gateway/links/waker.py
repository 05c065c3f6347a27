"""Ends a wait from another thread, so that nobody has to look again and again."""

import selectors
import socket
from typing import Self


class Closing(Exception):
    """The link is being closed: not an error."""


class Waker:
    """A pair of sockets: the receiver waits for one end together with its line."""

    def __init__(self) -> None:
        self._near, self._far = socket.socketpair()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._near.close()
        self._far.close()

    def fileno(self) -> int:
        """For selectors."""
        return self._near.fileno()

    def wake(self) -> None:
        """End every wait, now and later."""
        self._far.send(b"!")

    def sleep(self, seconds: float) -> None:
        """Wait; raises Closing when woken."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._near, selectors.EVENT_READ)
            if selector.select(seconds):
                raise Closing
