"""`shadow identify --by-recording`: whose recording it is, what is refused, what is written."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gateway.offline.identify as work
from gateway.errors import BadInput
from gateway.offline.identify import boat_of, boats_of, files_of, identify_logs_by_recording
from gateway.offline.trials import TrialOptions
from gateway.vessel_file import dump_vessel, load_vessel, read_vessel_file
from sim.identification import IdentifySettings
from sim.identification.by_recording import RecordingFit, pooled
from sim.identification.wiring import Wiring
from tests.gateway.command_line import one_line
from tests.sim.vessels import WAMV


def test_the_first_pattern_that_fits_says_whose_recording_it_is() -> None:
    boats = boats_of(["heron=heron/*", "otter=*_o.BIN"])
    assert boat_of("logs/heron/1_o.BIN", boats) == "heron"
    assert boat_of(Path("logs/2_o.BIN"), boats) == "otter"
    with pytest.raises(BadInput, match=r"x\.tlog: fits none of --boat heron/\*, \*_o\.BIN"):
        boat_of("x.tlog", boats)
    with pytest.raises(BadInput, match=r"the name '\.\./heron': must not be empty nor contain /"):
        boats_of(["../heron=heron/*"])
    with pytest.raises(BadInput, match="expected NAME=PATTERN"):
        boats_of(["heron"])


def test_each_boat_gets_a_file_one_boat_the_file() -> None:
    out = Path("a/type.toml")
    assert files_of(out, {}) == {"": out}
    assert files_of(out, {"h*": "heron"}) == {"heron": out}
    both = files_of(out, {"h*": "heron", "o*": "otter"})
    assert both == {"heron": Path("a/type-heron.toml"), "otter": Path("a/type-otter.toml")}


def test_what_does_not_go_with_it_is_refused_at_once(run) -> None:
    log = "recordings/voyage_1.tlog"
    beside = run("identify", log, "-v", "otter", "--by-recording", "--from", "10")
    assert "--by-recording takes no --from" in one_line(beside, 2)
    assert "--boat goes with --by-recording" in one_line(
        run("identify", log, "-v", "otter", "--boat", "a=b"), 2
    )
    equations = run("identify", log, "-v", "otter", "--by-recording", "--method", "regression")
    assert "--by-recording goes with --method shooting or simulation" in one_line(equations, 2)


def test_the_file_holds_the_numbers_with_their_origin_and_not_the_odd_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = [[125.0, -26.0], [126.0, -26.5], [126.5, -26.2], [127.0, -40.0]]
    cov = np.diag([1.0, 0.25])
    fits = [
        RecordingFit(f"r{k}", "", ("m11", "X_u"), np.array(v), cov, {})
        for k, v in enumerate(values)
    ]
    trials = {
        f"r{k}": SimpleNamespace(name=f"r{k}", start_time_ns=1_750_000_000_000_000_000)
        for k in range(4)
    }
    monkeypatch.setattr(work, "usable_trials", lambda logs, *_: [trials[str(logs[0])]])
    monkeypatch.setattr(work, "identify_by_recording", lambda *_: pooled(fits, WAMV))
    monkeypatch.setattr(work, "wiring_of", lambda *_: Wiring(1, 1, (), 0.0))
    monkeypatch.setattr(work, "notices_of", lambda *_: ["left and right are swapped"])
    given, out = tmp_path / "wamv.toml", tmp_path / "better.toml"
    given.write_text(dump_vessel(WAMV), encoding="utf-8")
    found = identify_logs_by_recording(list(trials), given, out, IdentifySettings())
    (odd,) = found.disagreements
    assert found.notices == ("left and right are swapped",)
    assert (odd.recording, odd.name) == ("r3", "X_u")
    boat, tables = load_vessel(out), read_vessel_file(out)
    assert boat.dynamics.X_u == pytest.approx(-26.2, abs=0.3)
    origin = tables.provenance["dynamics.X_u"]
    assert origin.recording == "r0, r1, r2"
    assert origin.fit == "shadow identify, each of 4 recordings alone"
    assert "r3" not in tables.history[-1].model_dump_json()


def test_a_boat_whose_wiring_is_wrong_is_not_fitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, fitted = tmp_path / "wamv.toml", []
    given.write_text(dump_vessel(WAMV), encoding="utf-8")
    trials = [SimpleNamespace(name="r0", start_time_ns=0)]
    monkeypatch.setattr(work, "usable_trials", lambda *_: trials)
    monkeypatch.setattr(work, "wiring_of", lambda *_: Wiring(-1, -1, ("r0",), -0.9))
    monkeypatch.setattr(work, "notices_of", lambda *_: [])

    def fit(*_):
        fitted.append(1)
        return pooled([RecordingFit("r0", "", ("m11",), np.ones(1), np.eye(1), {})], WAMV)

    monkeypatch.setattr(work, "identify_by_recording", fit)
    with pytest.raises(BadInput, match=r"goes astern where .*\(r0: .* Set that first"):
        identify_logs_by_recording(["r0"], given)
    assert not fitted
    identify_logs_by_recording(["r0"], given, options=TrialOptions(anyway=True))
    assert fitted
