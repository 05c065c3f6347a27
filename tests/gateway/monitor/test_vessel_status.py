"""What is decoded of the bus and what is not, and a vessel as a line of JSON."""

import pytest

from gateway.monitor import decode
from tests.gateway.monitor.statuses import status
from tests.gateway.test_schemas import some_message


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"{", b"[]", b"null", b"{}", b'"text"', b"\xff\xfe",
        some_message("event").replace(b'"text"', b"7", 1),
        some_message("measured"),
    ],
)  # fmt: skip
def test_what_is_no_message_is_not_decoded(payload: bytes) -> None:
    assert decode("event", payload) is None


def test_numbers_are_numbers() -> None:
    assert decode("measured", some_message("measured")) is not None
    for wrong in ("true", "null", '"1"'):
        text = some_message("measured").replace(b'"surge_mps":0.5', f'"surge_mps":{wrong}'.encode())
        assert decode("measured", text) is None


def test_events_stand_once_in_lines_for_programs() -> None:
    now = status()
    assert [event["says"] for event in now.to_dict(7)["events"]] == ["event 7", "event 8"]
    assert now.to_dict(9)["events"] == ()
    assert len(now.to_dict()["events"]) == 9
