"""Messages and statuses of made-up vessels, and a free endpoint, for tests of the monitor."""

import json
import socket
import time
from collections.abc import Callable
from typing import Any

from gateway.monitor import Latest, VesselStatus
from gateway.topics import TOPICS
from tests.gateway.test_schemas import some_message

SECOND = 1_000_000_000


def message(topic: str, **values: Any) -> dict[str, Any]:
    """A message with all of its fields."""
    return {**json.loads(some_message(topic)), **values}


def status(name: str = "otter", **changed: dict[str, Any]) -> VesselStatus:
    """A vessel of which everything is known."""
    latest = {topic: Latest(message(topic, **changed.get(topic, {})), 0.1) for topic in TOPICS}
    events = tuple(
        message("event", says=f"event {i}", receive_time_ns=i * SECOND) for i in range(9)
    )
    return VesselStatus(name, True, latest, 50.0, events, 9)


def free_endpoint() -> str:
    """An endpoint of this machine that nothing listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def wait(condition: Callable[[], Any], patience_s: float = 30.0) -> Any:
    """What `condition` returns, once it is true."""
    end = time.monotonic() + patience_s
    while not (value := condition()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.02)
    return value
