"""The example of a zenoh router: gateways publish, watchers read, and a watcher cannot publish."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from gateway.bus import Bus, BusSettings
from gateway.monitor import join_bus
from tests.gateway.test_tls import (  # fixtures and marks of the same certificates
    PAYLOAD,
    certificate,
    endpoint,
    filled,
    keys,
    pytestmark,
)

__all__ = ["endpoint", "keys", "pytestmark"]
FORGED = PAYLOAD.replace(b"0", b"9")


@pytest.fixture
def router(keys: Path, endpoint: str, tmp_path: Path) -> Iterator[None]:
    """A router with the example's rules."""
    certificate(keys, "router", "ca")
    path = filled("zenoh-router.json5", keys, endpoint, tmp_path)
    with zenoh.open(zenoh.Config.from_file(str(path))):
        yield


def joined(who: str, keys: Path, endpoint: str, folder: Path) -> Path:
    """The configuration of a client of that name."""
    (folder / who).mkdir()
    path = filled("zenoh-tls-watch.json5", keys, endpoint, folder / who)
    path.write_text(path.read_text("utf-8").replace("watcher.", f"{who}."), "utf-8")
    return path


def soon(values: list[bytes], wanted: bytes, seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while wanted not in values and time.monotonic() < end:
        time.sleep(0.02)
    return wanted in values


@pytest.mark.usefixtures("router")
def test_a_gateway_publishes_and_a_watcher_can_only_read(
    keys: Path, endpoint: str, tmp_path: Path
) -> None:
    gateway = joined("gateway", keys, endpoint, tmp_path)
    watcher = joined("watcher", keys, endpoint, tmp_path)
    key, came = "shadow/otter/measured", list[bytes]()
    with Bus("otter", settings=BusSettings(config_file=gateway)) as bus:
        session, other = join_bus("", watcher), join_bus("", watcher)
        assert session is not None
        assert other is not None
        with session, other:
            session.declare_subscriber(key, lambda sample: came.append(sample.payload.to_bytes()))
            time.sleep(0.5)
            bus.publish("measured", PAYLOAD)
            assert soon(came, PAYLOAD)
            other.put(key, FORGED)
            assert not soon(came, FORGED, 1.0)
            replies = [r.ok.payload.to_bytes() for r in session.get(key) if r.ok is not None]
            assert replies == [PAYLOAD]


@pytest.mark.usefixtures("router")
def test_what_a_gateway_puts_does_arrive(keys: Path, endpoint: str, tmp_path: Path) -> None:
    """So that the test above can fail: the same put with a gateway's certificate."""
    gateway = joined("gateway", keys, endpoint, tmp_path)
    watcher = joined("watcher", keys, endpoint, tmp_path)
    key, came = "shadow/otter/measured", list[bytes]()
    session, other = join_bus("", watcher), join_bus("", gateway)
    assert session is not None
    assert other is not None
    with session, other:
        session.declare_subscriber(key, lambda sample: came.append(sample.payload.to_bytes()))
        time.sleep(0.5)
        other.put(key, FORGED)
        assert soon(came, FORGED)
