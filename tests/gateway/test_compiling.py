"""That something is compiled is told while it is, also where another process does it."""

import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba import TypingError, njit
from numba.core.typing import signature
from numba.extending import intrinsic

from gateway.compiling import compiling_s
from sim.kernel.compiled import compiled_once


def test_what_is_compiled_is_told_while_it_is_and_what_is_there_already_is_not() -> None:
    told = []

    @intrinsic
    def law(context: object, x: object) -> object:  # asked while numba compiles who calls it
        told.append(compiling_s())
        return signature(x, x), lambda context, builder, call, arguments: arguments[0]

    @njit
    def caller(x: float) -> float:
        return law(x)

    for _ in range(2):
        assert caller(1.0) == 1.0
        assert compiling_s() == 0.0
    assert told
    assert min(told) > 0.0

    @njit
    def broken(x: float) -> float:
        return x.no_such_thing  # type: ignore[attr-defined]

    with pytest.raises(TypingError):
        broken(1.0)
    assert compiling_s() == 0.0


def test_to_wait_for_another_process_that_compiles_the_same_counts_too(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")

    class Dispatcher:
        """What `compiled_once` knows of one of numba's."""

        stats = SimpleNamespace(cache_path=tmp_path)
        py_func = SimpleNamespace(__qualname__="law")

        def compile(self, signature: str) -> str:
            return signature

    with (tmp_path / "law.lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        other = threading.Thread(target=compiled_once(Dispatcher()).compile, args=("x",))
        other.start()
        other.join(0.5)
        assert other.is_alive()
        assert compiling_s() >= 0.1
    other.join(60.0)
    assert compiling_s() == 0.0
