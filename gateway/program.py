"""The program `shadow`: what has to stand before the imports of the command line.

They take a few tenths of a second, more on a slow disk. Whoever presses Ctrl-C in that time gets a
line and no traceback of an import. Nothing is open then that had to be closed.
"""

import os
import signal
from typing import Any, NoReturn


def run() -> NoReturn:
    """Import, then run; an interrupt that is ignored (by `nohup`, in the background) stays so."""
    waits = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if waits:
        signal.signal(signal.SIGINT, _interrupted)
    from gateway.cli import run as run_command

    if waits:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run_command()


def _interrupted(*_: Any) -> NoReturn:
    os.write(2, b"error: interrupted\n")
    os._exit(130)
