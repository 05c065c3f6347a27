"""What the server's libraries log: faults of ours whole, what a page did wrong in a line or not.

A page that is gone while something goes to it is no fault. A page that sends what cannot be used (a
text where a number belongs: another program, an old tab) is refused by Bokeh or by Panel, and the
server goes on: one line is enough.
"""

import logging
import traceback
from collections.abc import Iterator

from bokeh.server.connection import ServerConnection
from tornado.websocket import WebSocketClosedError

from gateway.errors import printable

QUIET = ("bokeh", "tornado.access", "panel")
WATCHED = ("asyncio", "tornado.application", "bokeh.server.protocol_handler",
           "bokeh.server.views.ws", "panel.reactive")  # fmt: skip
LIBRARIES = {"bokeh", "panel", "param", "tornado", "asyncio", "functools"}
TAKES = {"apply_json_patch", "_process_events", "_process_event"}  # functions that take a message
AGAIN = {"asyncio", "tornado.application"}  # these log what Panel has logged already
LONGEST = 200


def quieten_logs() -> None:
    """Keep messages of the server's libraries off the terminal."""
    for name in QUIET:
        logging.getLogger(name).setLevel(logging.ERROR)
    for name in WATCHED:
        logging.getLogger(name).addFilter(is_fault)


def is_fault(record: logging.LogRecord) -> bool:
    """Whether a record is to be logged; one of a page's own mistake becomes a line."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, WebSocketClosedError) or _has_lost_its_session(error):
        return False
    if error is None or not _is_of_the_page(error):
        return True
    if record.name in AGAIN:
        return False
    says = printable(" ".join(str(error).split()))[:LONGEST]
    record.msg, record.args = "studio: a page sent what cannot be used: %s", (says,)
    record.exc_info = record.exc_text = None
    return True


def _has_lost_its_session(error: BaseException | None) -> bool:
    """Of Bokeh: a ping found the page closed and took its session away; the page's last messages
    and its close, which come later, ask for it."""
    frames = [frame.f_code for frame, _ in traceback.walk_tb(error.__traceback__)] if error else []
    return frames[-1:] == [ServerConnection.session.fget.__code__]


def _is_of_the_page(error: BaseException) -> bool:
    """Whether only libraries took part, and one of them was taking a message of the page."""
    places = list(_places(error))
    return all(module in LIBRARIES for module, _ in places) and any(
        function in TAKES for _, function in places
    )


def _places(error: BaseException) -> Iterator[tuple[str, str]]:
    """Package and function of each step on the way to an error."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        yield str(frame.f_globals.get("__name__")).partition(".")[0], frame.f_code.co_name
