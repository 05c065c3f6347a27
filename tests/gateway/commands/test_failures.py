"""What ends a command: arithmetic without a result is one line, a fault of the program too."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.errors import ShadowError, numerical_errors
from sim.identification.parameters import UnknownNameError
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import NoUsableTimeError
from tests.gateway.command_line import Run, one_line, strictly
from tests.gateway.ingest.scripted import attitude, heartbeat, local_position, servo
from tests.gateway.pipelines.sailing import Said, parameters, tlog, voyage

NUMERICAL = [
    np.linalg.LinAlgError("Singular matrix"),
    FloatingPointError("underflow"),
    ZeroDivisionError("division by zero"),
    OverflowError(34, "Numerical result out of range"),
]


def failing(error: BaseException) -> Callable[..., Any]:
    """A function that raises the error, whatever it is called with."""

    def fail(*_: Any, **__: Any) -> Any:
        raise error

    return fail


# command -> the function in it that fails, and words after the recording and the vessel
WORK = {
    "identify": ("gateway.offline.identify.identify", "--exclude"),
    "diagnose": ("gateway.offline.diagnose.diagnose", "shadow info"),
    "compare": ("gateway.offline.compare.compare", "shadow info"),
    "replay": ("gateway.offline.replay.ShadowPath.advance", "shadow info"),
    "report": ("gateway.offline.compare.compare", "shadow info"),
}


@pytest.mark.parametrize("error", NUMERICAL, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize("name", WORK)
def test_arithmetic_without_a_result_is_one_line_with_recording_vessel_and_advice(
    run: Run,
    boat: Path,
    log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    error: Exception,
) -> None:
    target, advice = WORK[name]
    monkeypatch.setattr(target, failing(error))
    out = {
        "replay": ["--out", tmp_path / "out", "--no-publish"],
        "report": ["--out", tmp_path / "report.html"],
    }
    done = run(name, log, "--vessel", boat, *out.get(name, []))
    vessel = "WAM-V" if name in ("compare", "report") else str(boat)
    one_line(done, 1, log.stem, f"with {vessel}", str(error.args[-1]), advice)
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize("name", ["info", "compare"])
def test_a_recording_that_cannot_be_smoothed_or_read_is_named(
    run: Run,
    boat: Path,
    log: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
) -> None:
    target = {
        "info": "gateway.ingest.survey.survey",
        "compare": "gateway.offline.trials.smooth_with_bias",
    }
    monkeypatch.setattr(target[name], failing(np.linalg.LinAlgError("Singular matrix")))
    words = [name, log] + (["--vessel", boat] if name == "compare" else [])
    one_line(run(*words), 1, str(log), "Singular matrix")


SIM_ERRORS = [
    NoUsableTimeError("voyage: 3 s of usable time"),
    DivergedError("every run leaves all bounds"),
    UnknownNameError("no parameter Z_uu"),
]


@pytest.mark.parametrize("error", SIM_ERRORS, ids=lambda e: type(e).__name__)
def test_an_error_of_sim_that_reaches_the_command_line_is_one_line_too(
    run: Run,
    boat: Path,
    log: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
) -> None:
    monkeypatch.setattr("gateway.offline.compare.load_vessel", failing(error))
    one_line(run("compare", log, "--vessel", boat), 1, str(log), str(boat), str(error))


FAULTS = [KeyError("u"), TypeError("not callable"), AttributeError("no fit"), ValueError("shape")]


@pytest.mark.parametrize("error", FAULTS, ids=lambda e: type(e).__name__)
def test_a_fault_of_the_program_is_one_line_and_its_traceback_is_written(
    run: Run,
    boat: Path,
    log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("gateway.offline.compare.compare", failing(error))
    done = run("compare", log, "--vessel", boat)
    line = one_line(done, 70, "this is a fault of the program", type(error).__name__)
    (file,) = tmp_path.glob("shadow-fault-*.txt")
    assert str(file) in line
    text = file.read_text(encoding="utf-8")
    assert f"shadow compare {log} --vessel {boat}" in text
    assert "Traceback (most recent call last)" in text
    assert "in fail\n    raise error\n" in text
    assert text.rstrip().endswith(f"{type(error).__name__}: {error}")


def test_where_the_traceback_cannot_be_written_it_is_printed(
    run: Run,
    boat: Path,
    log: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tempfile.NamedTemporaryFile", failing(OSError(28, "No space left")))
    monkeypatch.setattr("gateway.offline.compare.compare", failing(KeyError("u")))
    done = run("compare", log, "--vessel", boat)
    assert done.status == 70
    assert "Traceback" in done.err
    assert done.err.splitlines()[-1].startswith("error: this is a fault of the program")


@pytest.mark.parametrize(("value", "shown"), [("1", True), ("0", False), ("", False)])
def test_the_environment_asks_for_the_traceback(
    run: Run,
    boat: Path,
    log: Path,
    monkeypatch: pytest.MonkeyPatch,
    value: str,
    shown: bool,
) -> None:
    assert "SHADOW_DEBUG=1" in " ".join(run("--help").out.split())
    monkeypatch.setenv("SHADOW_DEBUG", value)
    error = np.linalg.LinAlgError("Singular matrix")
    monkeypatch.setattr("gateway.offline.compare.compare", failing(error))
    done = run("compare", log, "--vessel", boat)
    assert done.status == 1
    assert ("Traceback" in done.err) is shown
    assert ("LinAlgError: Singular matrix" in done.err) is shown
    assert done.err.splitlines()[-1].startswith("error: ")


def test_what_the_operating_system_refuses_is_one_line(
    run: Run,
    boat: Path,
    log: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refusal = PermissionError(13, "Permission denied", "/etc/shadow")
    monkeypatch.setattr("gateway.offline.compare.compare", failing(refusal))
    one_line(run("compare", log, "--vessel", boat), 1, "Permission denied: '/etc/shadow'")


def test_other_errors_pass_the_net_for_arithmetic() -> None:
    with pytest.raises(KeyError), numerical_errors("a.tlog", "boat.toml"):
        raise KeyError("u")
    line = r"^a\.tlog: the computation .*ZeroDivisionError"
    with pytest.raises(ShadowError, match=line) as caught, numerical_errors("a.tlog"):
        raise ZeroDivisionError
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def steady(surge: float, rate: float, pulses: tuple[int, int]) -> list[Said]:
    """45 s without noise: a constant speed [m/s] and yaw rate [rad/s] under constant pulses."""
    out: list[Said] = []
    for k in range(900):
        t, boot = k / 20.0, 100.0 + k / 20.0
        yaw = (rate * t + np.pi) % (2.0 * np.pi) - np.pi
        out += [
            (t, attitude(boot, yaw, rate)),
            (t, local_position(boot, 0.0, 0.0, surge * np.cos(yaw), surge * np.sin(yaw))),
            (t, servo(boot, *pulses)),
        ]
        out += [(t, heartbeat())] if k % 20 == 0 else []
    return out


ODD_LOGS: dict[str, Callable[[], list[Said]]] = {
    "voyage": lambda: voyage(45.0),
    "straight": lambda: steady(1.0, 0.0, (1600, 1600)),
    "spin": lambda: steady(0.0, 2.0, (1900, 1100)),
    "frozen": lambda: steady(0.0, 0.0, (1700, 1700)),
}


@pytest.mark.parametrize("name", ["compare", "identify", "diagnose"])
@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=() if k in ("voyage", "frozen") else pytest.mark.slow)
     for k in ODD_LOGS],
)  # fmt: skip
def test_after_init_every_command_ends_in_an_answer_or_one_line(
    run: Run, tmp_path: Path, kind: str, name: str
) -> None:
    source, made = tmp_path / f"{kind}.tlog", tmp_path / "made.toml"
    tlog(source, [*parameters(), *ODD_LOGS[kind]()])
    assert run("init", source, "--out", made).status == 0
    done = run(name, source, "--vessel", made, "--json")
    if done.status == 0:
        assert strictly(done.out)
    else:
        assert done.status in (1, 2)
        one_line(done, done.status, kind)


def test_an_interrupt_is_one_line_though_the_library_says_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Ctrl-C while the imports of a command are under way."""
    monkeypatch.setattr("gateway.plants.known_plants", failing(KeyboardInterrupt()))
    assert one_line(run("plants"), 130) == "error: interrupted\n"
