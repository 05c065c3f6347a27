"""Kernels compiled by another process, while this one has other things to do.

numba compiles under the lock of the interpreter, one function after the other, and threads do not
help. A diagnosis needs some fifteen kernels that are known before its first recording is read: a
second process puts them into the cache, from where this one takes them.

    with compiled_ahead(structures):
        ...
"""

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from sim.kernel.cache import compile_entries, is_kept, kernel_for
from sim.kernel.generator import Structure


@contextmanager
def compiled_ahead(structures: Iterable[Structure]) -> Iterator[None]:
    """While the block runs, kernels that are not kept yet are compiled beside it, in this order.

    Nothing is done where that would take time from somebody: without a core that is free, or where
    one kernel alone is missing.
    """
    missing = [s for s in structures if not is_kept(s)] if _is_core_free() else []
    child = _started(missing) if len(missing) > 1 else None
    try:
        yield
    finally:
        if child is not None:
            child.kill()
            child.communicate()


def _is_core_free() -> bool:
    """Whether this process may run on two cores, and others leave one of them alone."""
    try:
        return os.getloadavg()[0] < len(os.sched_getaffinity(0)) - 0.5 > 1.0
    except (AttributeError, OSError):  # not told on this system
        return False


def _started(structures: Iterable[Structure]) -> subprocess.Popen[bytes] | None:
    """The process that compiles them; None where it cannot be started, or told what to do."""
    try:
        order = pickle.dumps([pickle.dumps(s) for s in structures])
        child = subprocess.Popen(  # -P: a folder `sim` of the user's is not what is imported
            [sys.executable, "-P", "-m", "gateway.kernels_ahead"], stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except (OSError, pickle.PicklingError, AttributeError):  # effects made where no import finds
        return None
    if child.stdin is not None:
        threading.Thread(target=_told, args=(child, order), daemon=True).start()
    return child


def _told(child: subprocess.Popen[bytes], order: bytes) -> None:
    """Write to a process that may read late, or be gone; the pipe stays open as long as we live."""
    try:
        if child.stdin is not None:
            child.stdin.write(order)
            child.stdin.flush()
    except (OSError, ValueError):
        pass


def main() -> None:
    """Compile the structures that stdin names, until they are done or stdin ends."""
    order = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for one in order:
        try:
            compile_entries(kernel_for(pickle.loads(one)))
        except Exception:  # whoever needs that kernel will be told; here is nobody to tell
            continue


def _end_with_parent() -> None:
    """Not by `sys.stdin`: who ends while another thread reads from that is aborted."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(0)


if __name__ == "__main__":
    main()
