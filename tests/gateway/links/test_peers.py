"""Where answers go, and when two addresses are two boats."""

from gateway.links.link import FORGOTTEN_NS, MOST, SWITCHES, TOGETHER_NS
from gateway.links.peers import News, Peers

A, B = ("10.0.0.1", 1), ("10.0.0.2", 2)


def test_answers_go_to_where_a_system_was_heard():
    peers = Peers()
    peers.hear(1, A, 0)
    peers.hear(2, B, 0)
    assert peers.towards(1, 0) == (A,)
    assert peers.towards(None, 0) == (A, B)
    assert peers.towards(3, 0) == ()


def test_an_old_address_is_left_but_the_latest_never():
    peers = Peers()
    peers.hear(1, A, 0)
    peers.hear(1, B, 1)
    assert set(peers.towards(1, 2)) == {A, B}
    assert peers.towards(1, FORGOTTEN_NS) == (B,)
    assert peers.towards(1, 10 * FORGOTTEN_NS) == (B,)


def test_a_flood_of_addresses_is_bounded():
    peers = Peers()
    for k in range(100):
        peers.hear(1, ("10.0.0.3", k), k)
    assert len(peers.towards(1, 100)) == MOST


def test_only_turns_close_together_are_two_boats():
    def news(gap_ns):
        peers = Peers()
        return [peers.hear(1, (A, B)[k % 2], k * gap_ns) for k in range(SWITCHES + 3)]

    assert news(1) == [News.FIRST] + [News.NONE] * (SWITCHES - 1) + [News.SHARED] + [News.NONE] * 2
    assert News.SHARED not in news(TOGETHER_NS)
