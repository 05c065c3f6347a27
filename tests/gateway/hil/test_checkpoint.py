"""The state that a killed program leaves: whole whatever moment it was killed at."""

from threading import Timer

import pytest

from gateway.errors import BadInput, ShadowError
from gateway.hil import HEAD, SLOT_BYTES, Checkpoint
from gateway.vessel_file import load_vessel
from sim.hil.boat import Boat


@pytest.fixture(scope="module")
def states():
    """A boat after 1, 2 and 3 steps."""
    boat = Boat.of(load_vessel("otter"))
    out = [boat.start()]
    for _ in range(3):
        out.append(boat.step(out[-1], {1: 1800.0, 3: 1700.0}, 0.02)[0])
    return out[1:]


def same(one, other):
    return one.time == other.time and one.row.tolist() == other.row.tolist()


def kept(path, states):
    with Checkpoint(path, "otter") as checkpoint:
        for frame, state in enumerate(states, 10):
            checkpoint.keep(frame, state)
    return path


def test_the_last_state_comes_back_for_the_frame_that_waits(tmp_path, states):
    path = kept(tmp_path / "boat.state", states)
    with Checkpoint(path, "otter") as checkpoint:
        for frame in (12, 13):
            found = checkpoint.state_before(frame)
            assert same(found, states[-1])
            assert (found.number, found.voltage) == (states[-1].number, states[-1].voltage)
            assert found.past == states[-1].past[-1:]
        assert checkpoint.state_before(11) is checkpoint.state_before(14) is None
    with Checkpoint(path, "another") as other:
        assert other.state_before(13) is None


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_newest_comes_back_whichever_place_it_is_in(tmp_path, states, count):
    path = kept(tmp_path / "boat.state", states[:count])
    with Checkpoint(path, "otter") as checkpoint:
        assert same(checkpoint.state_before(10 + count), states[count - 1])


@pytest.mark.parametrize("cut", [0, HEAD.size - 2, HEAD.size + 5])
def test_a_writing_that_was_cut_short_leaves_the_one_before(tmp_path, states, cut):
    path = kept(tmp_path / "boat.state", states)
    data = bytearray(path.read_bytes())
    last = SLOT_BYTES * (len(states) % 2)
    data[last + cut : last + SLOT_BYTES] = bytes(SLOT_BYTES - cut)
    path.write_bytes(data)
    with Checkpoint(path, "otter") as checkpoint:
        assert same(checkpoint.state_before(12), states[-2])
        checkpoint.keep(12, states[-1])
    with Checkpoint(path, "otter") as checkpoint:
        assert same(checkpoint.state_before(13), states[-1])


def test_no_file_an_empty_one_and_junk_are_no_state(tmp_path):
    for name, data in (("none", None), ("empty", b""), ("junk", b"junk" * 4000)):
        if data is not None:
            (tmp_path / name).write_bytes(data)
        with Checkpoint(tmp_path / name, "otter") as checkpoint:
            assert checkpoint.state_before(1) is None


def test_a_folder_in_its_place_is_one_line(tmp_path):
    with pytest.raises(ShadowError, match="cannot keep the state there"):
        Checkpoint(tmp_path, "otter").__enter__()


def test_a_file_that_a_running_program_keeps_is_no_other_ones(tmp_path, states, monkeypatch):
    monkeypatch.setattr("gateway.hil.RELEASE_S", 0.0)
    path = tmp_path / "otter-hil.state"
    with Checkpoint(path, "otter") as first:
        first.keep(10, states[0])
        before = path.read_bytes()
        with pytest.raises(BadInput, match=r"another `shadow hil` .*--vessel NAME=FILE"):
            Checkpoint(path, "otter").__enter__()
        assert path.read_bytes() == before
        first.keep(11, states[1])
    with Checkpoint(path, "otter") as again:
        assert same(again.state_before(12), states[1])


def test_a_program_that_is_just_ending_is_waited_for(tmp_path):
    path = tmp_path / "otter-hil.state"
    first = Checkpoint(path, "otter")
    first.__enter__()
    ending = Timer(0.3, first.__exit__, (None, None, None))
    ending.start()
    with Checkpoint(path, "otter"):
        assert not ending.is_alive()
