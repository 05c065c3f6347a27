"""Ends that a signal asks for: no lock, nothing left in the middle, never lost."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from gateway.long_running import LOOK_S, Interrupts, Stop, print_line


def interrupt() -> None:
    """Ctrl-C, handled before this returns."""
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)


def test_a_stop_is_set_once_and_wakes_who_waits() -> None:
    stop = Stop()
    assert not stop.wait(0.01)
    began = time.monotonic()
    threading.Timer(0.1, stop.set).start()
    assert stop.wait(30.0)
    assert time.monotonic() - began < 0.1 + 20 * LOOK_S
    assert stop.is_set()


def test_an_interrupt_waits_for_a_moment_that_suits() -> None:
    done = []

    def work() -> None:
        with Interrupts() as interrupts:
            interrupt()
            done.append("the step is finished")
            interrupts.check()
            done.append("never")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["the step is finished"]


def test_an_interrupt_ends_a_sleep() -> None:
    began = time.monotonic()
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt), Interrupts() as interrupts:
        interrupts.sleep(30.0)
    assert time.monotonic() - began < 10.0


def test_an_interrupt_at_the_very_end_is_not_lost() -> None:
    with pytest.raises(KeyboardInterrupt), Interrupts():
        interrupt()


def test_a_second_interrupt_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.long_running.AGAIN_S", 0.0)
    seen = []

    def work() -> None:
        with Interrupts():
            interrupt()
            seen.append("first")
            interrupt()
            seen.append("second")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert seen == ["first"]


def test_a_signal_that_comes_twice_at_once_is_one() -> None:
    """As those of `timeout -s INT`, which signals the program and then the group that it is in."""
    done = []

    def work() -> None:
        with Interrupts() as interrupts:
            for _ in range(3):
                interrupt()
            done.append("the step is finished")
            interrupts.check()

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["the step is finished"]


PROGRAM = """
import os, signal, sys, time
from gateway import long_running
long_running.AGAIN_S = float(sys.argv[1])
stop = long_running.stop_on_signals()
for _ in range(2):
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)
print("ended", stop.is_set())
"""


@pytest.mark.parametrize(("again_s", "status", "said"), [("60", 0, "ended True\n"), ("0", -2, "")])
def test_the_same_for_programs_that_run_until_they_are_asked_to_end(
    again_s: str, status: int, said: str
) -> None:
    command = [sys.executable, "-c", PROGRAM, again_s]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert (done.returncode, done.stdout) == (status, said)


HANGS_UP = """
import os, signal, sys, time
from gateway import long_running
long_running.AGAIN_S = 0.0
# whoever runs the tests may have said nohup
signal.signal(signal.SIGHUP, signal.SIG_IGN if sys.argv[1] == "nohup" else signal.SIG_DFL)
stop = long_running.stop_on_signals()
for _ in range(2):
    os.kill(os.getpid(), signal.SIGHUP)
    time.sleep(0.01)
print("ended", stop.is_set())
with long_running.Interrupts() as interrupts:
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGHUP)
        time.sleep(0.01)
    print("step finished")
print("went on")
"""


@pytest.mark.parametrize(
    ("how", "said"),
    [("", "ended True\nstep finished\n"), ("nohup", "ended False\nstep finished\nwent on\n")],
)
def test_a_window_that_is_closed_ends_in_order_unless_nohup_says_otherwise(
    how: str, said: str
) -> None:
    command = [sys.executable, "-c", HANGS_UP, how]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.stdout == said
    assert "KeyboardInterrupt" in done.stderr or how == "nohup"


class Gone:
    """A terminal whose window is closed."""

    def __init__(self, error: int) -> None:
        self._error = error

    def write(self, text: str) -> None:
        raise OSError(self._error, os.strerror(self._error))

    def flush(self) -> None:
        pass


def test_a_terminal_that_is_gone_takes_no_line_and_other_trouble_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stderr", Gone(errno.EIO))
    print_line("finished")
    monkeypatch.setattr(sys, "stderr", Gone(errno.ENOSPC))
    with pytest.raises(OSError, match="No space"):
        print_line("finished")


def test_handlers_are_as_before_and_another_thread_is_left_alone() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with Interrupts():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    seen = []

    def work() -> None:
        with Interrupts() as interrupts:
            interrupts.sleep(0.0)
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before[0]]


PRESSED = """
import os, signal, sys
# a job in the background of a script begins with it ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
class Press:
    def find_spec(self, name, *_):
        if name == "gateway.commands":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Press())
if sys.argv[1] == "ignored":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
sys.argv[1:] = ["--version"]
from gateway.program import run
run()
"""


@pytest.mark.parametrize(("how", "status", "says"), [("heard", 130, "error: interrupted\n"),
                                                     ("ignored", 0, "")])  # fmt: skip
def test_whoever_presses_ctrl_c_during_the_imports_sees_a_line(how, status, says) -> None:
    ended = subprocess.run([sys.executable, "-c", PRESSED, how], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (status, says)
    assert ended.stdout.startswith("shadow-gateway" if how == "ignored" else "")
