"""Whether numba compiles just now: the first work of its kind on a machine waits for that."""

from time import monotonic

from numba.core import event

from sim.kernel.compiled import COMPILED_ELSEWHERE


class _Watch(event.Listener):  # type: ignore[misc]
    """Since when numba compiles without a break: one function compiles those that it calls, and
    its lock lets one thread in at a time.
    """

    def __init__(self) -> None:
        self.depth, self.since = 0, 0.0

    def on_start(self, _: object) -> None:
        self.since = self.since if self.depth else monotonic()
        self.depth += 1

    def on_end(self, _: object) -> None:
        self.depth -= 1


_WATCH = _Watch()
for _kind in ("numba:compile", COMPILED_ELSEWHERE):
    event.register(_kind, _WATCH)


def compiling_s() -> float:
    """For how long by now a function has been compiled, or waited for while another process
    compiles it [s]; 0 where nothing is: what is in the cache is loaded at once.
    """
    return monotonic() - _WATCH.since if _WATCH.depth else 0.0
