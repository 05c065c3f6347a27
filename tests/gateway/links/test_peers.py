"""Where answers go, and when two addresses are two boats."""

from gateway.links.frame_reader import (
    ADDRESS_TIMEOUT_NS,
    HOLD_NS,
    MAX_ADDRESSES,
    SHARED_ID_TURNS,
    TURN_WINDOW_NS,
    Peers,
    SenderChange,
)

A, B = ("10.0.0.1", 1), ("10.0.0.2", 2)


NONE, FIRST = SenderChange.NONE, SenderChange.FIRST
APART, SHARED, CHANGED = SenderChange.APART, SenderChange.SHARED, SenderChange.CHANGED


def test_answers_go_to_where_a_system_was_heard():
    peers = Peers()
    peers.note(1, 1, A, 0)
    peers.note(2, 1, B, 0)
    assert peers.addresses(1, 0) == (A,)
    assert peers.addresses(None, 0) == (A, B)
    assert peers.addresses(3, 0) == ()


def test_an_old_address_is_left_but_the_latest_never():
    peers = Peers()
    peers.note(1, 1, A, 0)
    peers.note(1, 2, B, 1)
    assert set(peers.addresses(1, 2)) == {A, B}
    assert peers.addresses(1, ADDRESS_TIMEOUT_NS) == (B,)
    assert peers.addresses(1, 10 * ADDRESS_TIMEOUT_NS) == (B,)


def test_a_flood_of_addresses_is_bounded():
    peers = Peers()
    for k in range(100):
        peers.note(1, k, ("10.0.0.3", k), k)
    assert len(peers.addresses(1, 100)) == MAX_ADDRESSES


def test_the_first_sender_holds_an_id_until_it_was_silent():
    peers = Peers()
    assert peers.note(1, 1, A, 0) is FIRST
    assert peers.note(1, 1, B, 1) is APART
    assert peers.addresses(1, 2) == (A,)
    assert peers.note(1, 1, B, HOLD_NS) is APART
    assert peers.note(1, 1, B, HOLD_NS + 1) is CHANGED
    assert peers.note(1, 1, B, HOLD_NS + 1) is NONE
    assert peers.note(1, 1, A, HOLD_NS + 2) is APART


def test_whoever_hung_up_holds_nothing():
    connected = [A, B]
    peers = Peers(lambda: tuple(connected))
    assert peers.note(1, 1, A, 0) is FIRST
    assert peers.note(1, 1, B, 1) is APART
    connected.remove(A)
    assert peers.note(1, 1, B, 2) is CHANGED


def test_components_that_go_over_together_are_one_change():
    peers = Peers()
    for component in (1, 191):
        peers.note(1, component, A, 0)
    late = HOLD_NS + 1
    assert [peers.note(1, component, B, late) for component in (1, 191)] == [CHANGED, NONE]


def test_other_components_of_a_system_may_speak_from_elsewhere():
    peers = Peers()
    assert peers.note(1, 1, A, 0) is FIRST
    assert peers.note(1, 191, B, 1) is NONE
    assert peers.note(1, 1, A, 2) is NONE


def test_an_address_alone_holds_nothing():
    peers = Peers()
    peers.note_address(1, A, 0)
    assert peers.addresses(1, 0) == (A,)
    assert peers.note(1, 1, B, 1) is NONE


def test_only_turns_close_together_are_two_boats():
    def changes(gap_ns, count=SHARED_ID_TURNS + 3):
        peers, found = Peers(), []
        for k in range(count):
            found.append(peers.note(1, 1, A, k * gap_ns))
            found.append(peers.note(1, 1, B, k * gap_ns))
        return found

    turns = [APART, NONE] * (SHARED_ID_TURNS - 1)
    assert changes(1) == [FIRST, *turns, APART, SHARED, APART, NONE, APART, NONE, APART]
    assert SHARED not in changes(HOLD_NS)[: 2 * SHARED_ID_TURNS]


def test_turns_far_apart_count_anew():
    peers = Peers()
    step, found = HOLD_NS, []
    for k in range(40):
        found.append(peers.note(1, 1, A, k * step))
        if k * step % TURN_WINDOW_NS == 0:
            peers.note(1, 1, B, k * step)
    assert SHARED not in found
