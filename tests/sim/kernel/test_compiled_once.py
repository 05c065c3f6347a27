"""Of several processes that want the same machine code, one compiles it."""

import threading
from pathlib import Path

import pytest

from sim.kernel import compiled as module
from sim.kernel.compiled import compiled_once

fcntl = pytest.importorskip("fcntl")


class Dispatcher:
    """What `compiled_once` knows of one of numba's: its function, its cache, and `compile`."""

    def __init__(self, folder: Path) -> None:
        self.stats = self
        self.cache_path = str(folder)
        self.entered = threading.Event()
        self.py_func = Dispatcher

    def compile(self, signature: str) -> str:
        self.entered.set()
        return f"machine code for {signature}"


def started(dispatcher: Dispatcher) -> threading.Thread:
    thread = threading.Thread(target=compiled_once(dispatcher).compile, args=("x",), daemon=True)
    thread.start()
    return thread


def test_it_waits_for_the_process_that_compiles_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOCK_WAIT_S", 0.01)
    dispatcher = Dispatcher(tmp_path)
    with (tmp_path / "Dispatcher.lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        other = started(dispatcher)
        assert not dispatcher.entered.wait(0.2)
    assert dispatcher.entered.wait(20.0)
    other.join()


def test_a_process_that_was_stopped_holds_up_the_others_for_a_while_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOCK_TRIES", 3)
    monkeypatch.setattr(module, "LOCK_WAIT_S", 0.01)
    dispatcher = Dispatcher(tmp_path)
    with (tmp_path / "Dispatcher.lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        started(dispatcher)
        assert dispatcher.entered.wait(20.0)


def test_where_no_file_can_be_made_each_compiles_for_itself(tmp_path: Path) -> None:
    assert compiled_once(Dispatcher(tmp_path / "not there")).compile("x") == "machine code for x"


def test_without_compiling_a_function_stays_as_it_is() -> None:
    """`NUMBA_DISABLE_JIT=1` gives no dispatcher but the function: to step through it, say."""
    assert compiled_once(abs) is abs
