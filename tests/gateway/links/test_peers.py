"""Where answers go, and when two addresses are two boats."""

from gateway.links.frame_reader import (
    ADDRESS_TIMEOUT_NS,
    CHANGE_WINDOW_NS,
    MAX_ADDRESSES,
    SHARED_ID_CHANGES,
    Peers,
    SenderChange,
)

A, B = ("10.0.0.1", 1), ("10.0.0.2", 2)


def test_answers_go_to_where_a_system_was_heard():
    peers = Peers()
    peers.note(1, A, 0)
    peers.note(2, B, 0)
    assert peers.addresses(1, 0) == (A,)
    assert peers.addresses(None, 0) == (A, B)
    assert peers.addresses(3, 0) == ()


def test_an_old_address_is_left_but_the_latest_never():
    peers = Peers()
    peers.note(1, A, 0)
    peers.note(1, B, 1)
    assert set(peers.addresses(1, 2)) == {A, B}
    assert peers.addresses(1, ADDRESS_TIMEOUT_NS) == (B,)
    assert peers.addresses(1, 10 * ADDRESS_TIMEOUT_NS) == (B,)


def test_a_flood_of_addresses_is_bounded():
    peers = Peers()
    for k in range(100):
        peers.note(1, ("10.0.0.3", k), k)
    assert len(peers.addresses(1, 100)) == MAX_ADDRESSES


def test_only_turns_close_together_are_two_boats():
    def changes(gap_ns):
        peers = Peers()
        return [peers.note(1, (A, B)[k % 2], k * gap_ns) for k in range(SHARED_ID_CHANGES + 3)]

    none, first, shared = SenderChange.NONE, SenderChange.FIRST, SenderChange.SHARED
    assert changes(1) == [first] + [none] * (SHARED_ID_CHANGES - 1) + [shared] + [none] * 2
    assert shared not in changes(CHANGE_WINDOW_NS)
