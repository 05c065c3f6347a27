"""Two boats under one system id, and one boat over two links: what is lost, and what is told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.log import MavlinkLog, tlog_from_bytes
from gateway.ingest.survey import survey
from gateway.offline.trials import load_trials
from tests.gateway.pipelines import sailing
from tests.gateway.pipelines.sailing import frames, voyage


def mixed(*senders: list[bytes]) -> bytes:
    """Frames of several senders in order of receipt."""
    return b"".join(sorted((frame for sent in senders for frame in sent), key=lambda raw: raw[:8]))


def opened(*senders: list[bytes]) -> MavlinkLog:
    return tlog_from_bytes(mixed(*senders), "mixed.tlog")


def told(log: MavlinkLog) -> list[str]:
    (boat,) = survey(log).boats
    return [text for text in boat.notices if "share system id" in text]


@pytest.fixture(scope="module")
def one() -> list[bytes]:
    return frames(voyage(40.0))


def booted_earlier(monkeypatch: pytest.MonkeyPatch, seconds: float) -> list[Any]:
    monkeypatch.setattr(sailing, "BOOT_S", sailing.BOOT_S + seconds)
    return voyage(40.0, noise=0.9)


@pytest.mark.parametrize("skipped", [0, 10, 100])  # numbers of the second are so far ahead
def test_two_boats_of_one_id_are_told_and_no_frame_is_lost(
    one: list[bytes], monkeypatch: pytest.MonkeyPatch, skipped: int, tmp_path: Path
) -> None:
    other = frames(booted_earlier(monkeypatch, 900.0))[skipped:]
    log = opened(one, other)
    assert log.statistics.lost <= 2
    (text,) = told(log)
    assert text.startswith("2 senders share system id 1")
    assert "SYSID_THISMAV" in text
    file = tmp_path / "mixed.tlog"
    file.write_bytes(mixed(one, other))
    assert all(text in trial.notices for trial in load_trials(file))


def test_boats_that_booted_together_are_told_by_their_places(
    one: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sailing, "local_position", lambda boot, n, e, *v: LOCAL_POSITION(boot, n + 300.0, e, *v)
    )
    assert told(opened(one, frames(booted_earlier(monkeypatch, 0.013))[50:])) != []


LOCAL_POSITION = sailing.local_position


def test_one_boat_over_two_links_is_one_boat(one: list[bytes]) -> None:
    """Each link counts its own frames."""
    log = opened(one, frames(voyage(40.0))[100:])
    assert log.statistics.lost <= 2
    assert told(log) == []


def test_losses_of_one_sender_are_losses(one: list[bytes]) -> None:
    keep = np.random.default_rng(3).random(len(one)) > 0.4
    thinned = [frame for frame, kept in zip(one, keep, strict=True) if kept]
    log = opened(thinned)
    assert log.statistics.lost == pytest.approx(len(one) - len(thinned), rel=0.05)
    assert log.frames.several == {}


def test_a_boat_that_boots_again_is_one_sender(one: list[bytes]) -> None:
    again = b"".join(one[:150]) + b"".join(one[:150])
    assert tlog_from_bytes(again, "again.tlog").frames.several == {}


def readdressed(raw: list[bytes], component: int, numbers: slice) -> list[bytes]:
    """The same frames, some of them of another component."""
    out = list(raw)
    for k in range(*numbers.indices(len(raw))):
        message = PARSER.decode(bytearray(raw[k][8:]))
        sender = dialect.MAVLink(None, message.get_srcSystem(), component)
        sender.seq = message.get_seq()
        out[k] = raw[k][:8] + message.pack(sender)
    return out


PARSER = dialect.MAVLink(None)


def test_a_component_that_changes_inside_a_log_is_told_and_most_of_it_is_read(
    one: list[bytes], tmp_path: Path
) -> None:
    """Half was read, in silence, and `info` listed "system 1" twice."""
    first = readdressed(one, 3, slice(len(one) // 4, None))
    log = opened(first)
    assert [boat.component for boat in log.boats()] == [3, 1]
    assert [str(boat).split(" (")[0] for boat in log.boats()] == [
        "system 1, component 3",
        "system 1",
    ]
    file = tmp_path / "changed.tlog"
    file.write_bytes(b"".join(first))
    (trial,) = load_trials(file)
    assert trial.time[-1] - trial.time[0] > 25.0
    (text,) = (text for text in trial.notices if "component" in text)
    assert text.startswith("component 1 of system 1 tells of motion too, from 0 to 10 s")
    assert text.endswith("what is read here is component 3 alone")


def test_of_one_component_nothing_is_told(one: list[bytes]) -> None:
    assert all("component" not in text for text in survey(opened(one)).boats[0].notices)


def test_frames_of_a_radio_out_of_order_are_late_and_not_lost(one: list[bytes]) -> None:
    """Delays of up to 1.2 s at ten frames a second made three senders that lost 23,129 frames."""
    rng = np.random.default_rng(4)
    thin = [frame for frame in renumbered(one[::8]) if rng.random() > 0.05]
    due = np.arange(len(thin)) + rng.uniform(0.0, 12.0, len(thin))
    stamps = [frame[:8] for frame in thin]
    log = opened([stamps[k] + thin[n][8:] for k, n in enumerate(np.argsort(due))])
    assert log.frames.several == {}
    assert log.statistics.lost == pytest.approx(0.05 * len(one) / 8, abs=12)


def renumbered(raw: list[bytes]) -> list[bytes]:
    """The same frames, numbered one by one."""
    out = []
    for number, frame in enumerate(raw):
        message = PARSER.decode(bytearray(frame[8:]))
        sender = dialect.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
        sender.seq = number % 256
        out.append(frame[:8] + message.pack(sender))
    return out
