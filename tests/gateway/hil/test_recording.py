"""What a loop records: the truth beside the outputs; and that no inference ever reads it."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput, ShadowError
from gateway.hil.day_file import load_day
from gateway.hil.run import LoopOptions, LoopPlan
from gateway.ingest.open import open_log
from gateway.recording.reader import Recording
from gateway.recording.recorder import Recorder
from gateway.vessel_file import load_vessel
from tests.gateway.hil.firmware import StandIn, free_port, looping

ROOT = Path(__file__).resolve().parents[3]
DAY = '[[moments]]\nat = 2.0\nthruster = "left"\ngain = 0.0\n'


@pytest.fixture
def sailed(tmp_path):
    """Four seconds ahead, then a restart and two more; a motor fails at 2 s."""
    (tmp_path / "day.toml").write_text(DAY)
    day, text = load_day(tmp_path / "day.toml")
    plan = LoopPlan(f"json:127.0.0.1:{free_port()}", "ferry", load_vessel("otter"))
    with looping([plan], LoopOptions(day=day, day_text=text, seed=4, out=tmp_path)) as running:
        for seconds in (4.0, 2.0):
            firmware = StandIn(int(plan.endpoint.rpartition(":")[2]), rate=200)
            values = firmware.sail({1: 1800, 3: 1700}, seconds)
            firmware.close()
    (path,) = running.loops[0].recording.paths
    return Recording.open(path), values, running


def test_recordings_that_cannot_be_finished_are_an_error_that_names_each(tmp_path, monkeypatch):
    """The disk is full when the last of it is written: each boat's is told."""
    finish = Recorder.finish

    def full(recorder):
        finish(recorder)
        raise ShadowError("the disk is full")

    monkeypatch.setattr(Recorder, "finish", full)
    otter = load_vessel("otter")
    plans = [LoopPlan(f"json:127.0.0.1:{free_port()}", name, otter) for name in ("one", "two")]

    def scene():
        with looping(plans, LoopOptions(out=tmp_path)):
            pass

    with pytest.raises(ShadowError, match=r"^one: the disk is full; two: the disk is full$"):
        scene()


def test_truth_and_outputs_fifty_times_a_second(sailed):
    recording, values, _ = sailed
    assert recording.finished
    truth, outputs = recording.columns("truth/ferry"), recording.columns("outputs/ferry")
    assert set(recording.counts()) == {"truth/ferry", "outputs/ferry"}
    assert len(truth["north_m"]) == len(outputs["output_1_us"]) == pytest.approx(300, abs=2)
    assert set(outputs["output_1_us"]) == {1800.0}
    assert set(outputs["output_3_us"]) == {1700.0}
    assert set(outputs["output_32_us"]) == {0.0}
    steps = np.diff(truth["vehicle_time_ns"])
    assert np.median(steps) == pytest.approx(2e7, rel=1e-3)
    assert 0 < steps.min() <= steps.max() < 2.6e7, "the clock goes on over a restart"
    assert truth["north_m"][-1] == pytest.approx(values["position"][0], abs=0.05)
    force = truth["surge_n"]
    assert force[50] == pytest.approx(119.7 * (0.6**2 + 0.4**2))
    assert force[150] == pytest.approx(119.7 * 0.4**2), "the left one has failed"


def test_the_recording_holds_vessel_day_and_seed(sailed):
    recording, _, running = sailed
    assert recording.attachments["day.toml"].data.decode() == DAY
    assert tomllib.loads(recording.attachments["vessel.toml"].data.decode())["name"] == "Otter"
    assert b'"seed": 4' in recording.attachments["config.json"].data
    assert recording.metadata["shadow"]["vessel"] == "ferry"
    assert running.said(f"recorded to {recording.path}")


def test_to_an_analysis_it_is_no_log_and_the_line_says_which_file_is(sailed):
    recording, _, _ = sailed
    with pytest.raises(BadInput, match=r"which no analysis reads: give the autopilot's own log"):
        open_log(recording.path)


BESIDE = "gateway/offline/beside_loop.py"  # holds it beside a log, and infers nothing
READS_TRUTH = {
    "gateway/topics.py", "gateway/hil/recording.py", BESIDE,
    "gateway/monitor.py",  # for people who watch
}  # fmt: skip
SHOWS_BESIDE = {
    "gateway/commands/model.py", "gateway/terminal/comparison.py", "gateway/hil_demo/story.py",
}  # fmt: skip


@pytest.mark.slow
def test_no_inference_reads_the_truth():
    """Nobody but the recorder of the loop names those channels, nor the table that holds them."""
    named = set()
    for file in [*(ROOT / "sim").rglob("*.py"), *(ROOT / "gateway").rglob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            text = isinstance(node, ast.Constant) and node.value == "truth"
            table = isinstance(node, ast.alias | ast.Name) and "LOOP_TOPICS" in ast.dump(node)
            path = isinstance(node, ast.Constant) and str(node.value).startswith("truth/")
            if text or table or path:
                named.add(str(file.relative_to(ROOT)))
    assert named == READS_TRUTH
    importers = {
        str(file.relative_to(ROOT))
        for file in (ROOT / "gateway").rglob("*.py")
        if "gateway.offline.beside_loop" in file.read_text(encoding="utf-8")
    }
    assert importers == SHOWS_BESIDE


def test_a_log_with_truth_in_it_gives_the_trial_that_it_gives_without(tmp_path):
    """Telemetry of a simulated boat, recorded twice: alone, and beside a truth that is a lie."""
    from gateway.hil.recording import TruthRecording
    from gateway.offline.trials import load_trials
    from gateway.recording.recorder import Recorder
    from gateway.recording.thread import RecordingThread
    from gateway.simulated_boat import FAST, SimulatedBoatSettings
    from gateway.simulated_boat.boat import SimulatedBoat
    from sim.hil.boat import Truth

    settings = SimulatedBoatSettings(rates=FAST)
    boat = SimulatedBoat(load_vessel("otter"), settings, seed=1)
    _, frames = boat.advance(boat.start(), 90.0)
    zero = round(settings.unix_s * 1e9)
    trials = []
    for name in ("alone", "beside"):
        with RecordingThread(Recorder(tmp_path / f"{name}.mcap", live=True)) as thread:
            lie = TruthRecording("otter", thread, zero)
            for k, frame in enumerate(frames):
                thread.raw("udp", zero + round(frame.time_s * 1e9), [frame.data])
                if name == "beside":
                    lie.put(Truth._make([frame.time_s, *[1e3 + k] * 27]), {1: 1900.0})
            lie.flush()
        trials.append(load_trials(tmp_path / f"{name}.mcap"))
    beside = Recording.open(tmp_path / "beside.mcap").counts()
    assert beside["truth/otter"] > 1000
    (one,), (other,) = trials
    for field in ("eta", "nu", "nu_dot", "pwm"):
        assert np.array_equal(getattr(one, field), getattr(other, field))


FIRST_RUN = """
from pathlib import Path
from gateway.hil.recording import TruthRecording, loop_recorder
from gateway.recording.thread import RecordingThread
from gateway.recording.writer import _lay_out
from gateway.vessel_file import load_vessel
from sim.hil.boat import Truth

recorder = loop_recorder(Path("."), "otter", load_vessel("otter"), None, 0)
ready = list(_lay_out.signatures)
with RecordingThread(recorder) as thread:
    truth = TruthRecording("otter", thread, 0)
    truth.put(Truth._make([0.02] * 28), {1: 1500.0})
    truth.flush()
print(len(ready), ready == list(_lay_out.signatures), thread.failure)
"""


@pytest.mark.slow
def test_the_first_recording_of_an_installation_compiles_nothing_when_it_ends(tmp_path):
    """Where it did, a busy machine left it unfinished, and empty."""
    words = [sys.executable, "-c", FIRST_RUN]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=200.0)
    assert done.stdout.split() == ["1", "True", "None"], done.stderr
