"""Faults on the way and in the fields: as much as asked for, and nothing else."""

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.simulated_boat import FAST, Burst, Faults, Silence
from tests.gateway.simulated_boat.frames import decoded, frames_of, log_of, simulated_boat

SECONDS = 30.0


def frames_with(**faults):
    return frames_of(simulated_boat(rates=FAST, faults=Faults(**faults)), SECONDS)


@pytest.fixture(scope="module")
def clean():
    return frames_with()


def test_without_faults_nothing_is_lost_doubled_or_late(clean):
    found = log_of(clean).statistics
    assert (found.lost, found.duplicates, found.notes) == (0, 0, ())
    assert [f.time_s for f in clean] == sorted(f.time_s for f in clean)


def test_loss_takes_its_share(clean):
    got = frames_with(loss=0.3)
    assert len(got) / len(clean) == pytest.approx(0.7, abs=0.03)
    assert {f.data for f in got} <= {f.data for f in clean}


def test_duplicates_come_twice_byte_for_byte(clean):
    got = frames_with(duplicates=0.3)
    assert len(got) / len(clean) == pytest.approx(1.3, abs=0.03)
    assert {f.data for f in got} == {f.data for f in clean}


def test_reordered_frames_all_come_some_after_later_ones(clean):
    got = frames_with(reordered=0.3)
    here, there = [f.boot_s for f in got], [f.boot_s for f in clean]
    assert len(got) == pytest.approx(len(clean), abs=30)  # the last are still on their way
    assert np.mean(np.diff(here) < 0.0) > 0.1
    assert not np.any(np.diff(there) < 0.0)
    late = [f.time_s - (f.boot_s - 30.0) for f in got]
    assert 0.15 < max(late) < 0.3


def test_silence_is_a_hole_and_the_clock_goes_on(clean):
    got = frames_with(silences=(Silence(5.0, 8.0),))
    assert [f for f in clean if not 5.0 <= f.time_s < 8.0] == got


def test_a_burst_holds_frames_back_and_delivers_them_faster(clean):
    got = frames_with(bursts=(Burst(10.0, 20.0, factor=10.0),))
    assert [f.data for f in got] == [f.data for f in clean]
    assert not [f for f in got if 10.0 <= f.time_s < 18.9]
    rate = sum(19.0 <= f.time_s < 20.0 for f in got) / sum(5.0 <= f.time_s < 6.0 for f in got)
    assert rate == pytest.approx(10.0, rel=0.05)


def test_nonsense_spoils_fields_not_frames(clean):
    got = frames_with(nonsense=0.3)
    messages = decoded(got)
    assert len(got) == len(clean)
    spoilt = sum(f.data != g.data for f, g in zip(got, clean, strict=True))
    assert spoilt / len(clean) > 0.25
    assert log_of(got).statistics.bad_checksum == 0
    yaws = [m.yaw for m in messages if m.get_type() == "ATTITUDE"]
    assert np.isnan(yaws).any()
    assert np.nanmax(np.abs(yaws)) > 1e20
    beats = [m.to_dict() for m in messages if m.get_type() == "HEARTBEAT"]
    assert all(beat == beats[0] for beat in beats)
    clocks = [m.time_boot_ms for m in messages if m.get_type() == "ATTITUDE"]
    assert set(np.diff(clocks)) == {20}


@pytest.mark.parametrize("share", ["loss", "duplicates", "reordered", "nonsense"])
def test_a_share_is_between_none_and_all(share):
    with pytest.raises(BadInput, match=share):
        Faults(**{share: 1.5})


def test_a_burst_is_not_slower_than_the_link():
    with pytest.raises(BadInput, match="factor"):
        Burst(0.0, 1.0, factor=0.5)
