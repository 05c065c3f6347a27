"""Who plays to nobody is told so, once, and again when somebody is there."""

import socket

import pytest

from gateway.simulated_boat.play import Played
from gateway.simulated_boat.port import open_port
from gateway.simulated_boat.session import PATIENCE_S, Company, play_until_stopped
from tests.sim.vessels import WAMV

HOST = "127.0.0.1"


def told(*moments: tuple[float, str | None]) -> list[str]:
    """What is said where, at these seconds, somebody (None) or nobody (why) was there."""
    said: list[str] = []
    company = Company("tcp:a:1", said.append)
    for seconds, alone in moments:
        company.note(Played(seconds=seconds, alone=alone))
    return said


def test_nothing_is_said_where_somebody_is_there_in_time() -> None:
    assert told((0.0, "x"), (PATIENCE_S - 0.1, "x"), (PATIENCE_S, None), (9.0, None)) == []


def test_nobody_is_said_once_and_somebody_after_it() -> None:
    moments = [(0.1 * k, "no answer") for k in range(100)]
    assert told(*moments) == ["tcp:a:1: no answer"]
    assert told(*moments, (10.0, None)) == ["tcp:a:1: no answer", "tcp:a:1: connected"]


def test_who_goes_away_is_missed_after_as_long() -> None:
    gone = [(100.0, None), (100.1, "gone"), (100.0 + PATIENCE_S - 0.1, "gone")]
    assert told(*gone) == []
    assert told(*gone, (100.0 + PATIENCE_S, "gone")) == ["tcp:a:1: gone"]


@pytest.fixture
def deaf() -> int:
    """A port at which nobody answers."""
    with socket.socket() as plug:
        plug.bind((HOST, 0))
        return int(plug.getsockname()[1])


def test_each_kind_of_port_knows_whether_it_is_alone(deaf: int) -> None:
    with open_port(f"udpout:{HOST}:{deaf}") as port:
        assert port.alone is None  # datagrams tell nothing
    with open_port(f"udpin:{HOST}:0") as port:
        assert port.alone == "nobody has spoken yet; waiting"
    with open_port(f"tcp:{HOST}:{deaf}") as port:
        port.heard()
        assert port.alone == "Connection refused; calling again every second"
        with socket.create_server((HOST, deaf)):
            port._redial = -1e9  # type: ignore[attr-defined]
            port.heard()
            assert port.alone is None
    with open_port(f"tcpin:{HOST}:0") as port:
        assert port.alone == "nobody has called; waiting"
        with socket.create_connection(port.address):  # type: ignore[attr-defined]
            port.heard()
            assert port.alone is None


def test_the_command_says_it(deaf: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr("gateway.simulated_boat.session.PATIENCE_S", 0.2)
    said: list[str] = []
    play_until_stopped(
        WAMV, f"tcp:{HOST}:{deaf}", said.append, program="mixed", system=1, fast=False, seed=0,
        seconds=0.5,
    )  # fmt: skip
    assert said[1] == f"tcp:{HOST}:{deaf}: Connection refused; calling again every second"
    assert said[2].startswith("played ")
