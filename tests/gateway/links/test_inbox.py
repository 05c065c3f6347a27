"""The queue between receivers and loop."""

from queue import Empty

import pytest

from gateway.links import PER_LINK, Datagram, Inbox, LinkEvent, LinkEventKind

BYTES = Datagram("link", 0, ())
LOST = LinkEvent("link", 0, LinkEventKind.LOST, "gone")


def test_a_minute_of_a_busy_link_fits():
    assert Inbox().capacity >= 60 * 1000
    assert Inbox().capacity == PER_LINK


def test_the_newest_datagram_is_dropped_but_no_event():
    inbox = Inbox(capacity=2)
    assert [inbox.put(item) for item in (BYTES, BYTES, BYTES, LOST)] == [True, True, False, True]
    assert [inbox.get(0) for _ in range(len(inbox))] == [BYTES, BYTES, LOST]


@pytest.mark.parametrize("timeout", [0.0, 0.001])
def test_an_empty_inbox_says_so(timeout):
    with pytest.raises(Empty):
        Inbox().get(timeout)
