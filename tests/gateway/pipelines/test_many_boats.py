"""What one boat costs does not grow with the number of others: calls are counted, no time."""

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from gateway.bus import Bus
from gateway.links import Datagram
from gateway.live.boats import BoatPlan
from gateway.live.outputs import BoatOutputs
from gateway.shadow.health import SECOND
from tests.gateway.pipelines.aboard import Deck, datagrams, played
from tests.gateway.voyages import rows_of
from tests.sim.vessels import WAMV

SPOKEN_S = 3.2  # each boat, before calls are counted: the checks of the second are over


def calls(work: Callable[[], Any]) -> int:
    """Calls of Python functions and of builtins that it makes."""
    count = 0

    def note(frame: Any, event: str, arg: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


def harbour(boats: int) -> Deck:
    """So many boats that are still."""
    return Deck([BoatPlan(replace(WAMV, name=f"b{k}"), system=1 + k) for k in range(boats)])


def spoken(boats: int) -> list[Datagram]:
    one_by_one = (played(SPOKEN_S, system_id=1 + k) for k in range(boats))
    return datagrams(*one_by_one)


def counted(boats: int) -> list[int]:
    """Calls for each of the last datagrams of the first boat, where there are so many."""
    heard = spoken(boats)
    last = [d for d in heard if d.frames[0].message.get_srcSystem() == 1][-40:]
    with harbour(boats) as deck:
        deck.hear(d for d in heard if d not in last)
        deck.gateway.turn(None)
        found = []
        for datagram in last:  # the clock stands: nothing else is due
            found.append(calls(lambda given=datagram: deck.gateway.turn(given)))  # type: ignore[misc]
    return found


@pytest.mark.slow
def test_a_datagram_costs_the_same_however_many_boats_there_are() -> None:
    counted(1)  # fills caches
    alone, among_many = counted(1), counted(6)
    assert max(alone) > 500  # an estimate with all its topics
    assert among_many == alone


def test_boats_are_looked_after_one_a_turn() -> None:
    with harbour(3) as deck:
        deck.hear(spoken(3))
        told = [len(deck.heard(system).payloads["health"]) for system in (1, 2, 3)]
        deck.now_ns = (deck.now_ns // SECOND + 1) * SECOND
        news = list[int]()
        for _ in range(4):
            deck.gateway.turn(None)
            now = [len(deck.heard(system).payloads["health"]) for system in (1, 2, 3)]
            news.append(sum(now) - sum(told))
    assert news == [1, 2, 3, 3]


def test_whoever_is_late_to_be_looked_after_is_not_left_out() -> None:
    """A loop that takes a second for a turn still comes round to all of them."""
    with harbour(3) as deck:
        deck.hear(spoken(3))
        told = [len(deck.heard(system).payloads["health"]) for system in (1, 2, 3)]
        for _ in range(6):
            deck.now_ns += SECOND
            deck.gateway.turn(None)
        now = [len(deck.heard(system).payloads["health"]) for system in (1, 2, 3)]
    assert [after - before for before, after in zip(told, now, strict=True)] == [2, 2, 2]


@pytest.mark.parametrize("wanted", [True, False])
def test_what_nobody_subscribes_to_is_not_encoded(wanted: bool) -> None:
    given: list[Any] = []

    class Silent(Bus):
        def wants(self, topic: str) -> bool:
            return wanted

        def publish(self, topic: str, payload: Any) -> None:
            given.append(payload)

    rows = rows_of("control", 3)
    BoatOutputs(bus=Silent("a")).publish([rows, rows.chosen([])])
    assert (rows._payloads is not None) is wanted
    made = [payload() if callable(payload) else payload for payload in given]
    assert made == (rows.payloads if wanted else rows.payloads[-1:])
    assert all(callable(payload) is not wanted for payload in given)


@pytest.mark.slow
def test_seconds_are_judged_when_nobody_waits_and_come_to_the_same() -> None:
    """Half a second late at most, in the same order, and never lost."""
    heard = datagrams(played(40.0))
    with harbour(1) as deck:
        at_once = deck.hear(heard).heard()
    with harbour(1) as deck:
        inbox = deck.gateway.inbox
        inbox.put(heard[0])  # somebody waits all the time
        later = deck.hear(heard).heard()
        deck.gateway.catch_up()
    judged = ("surroundings", "wind")
    assert len(at_once.payloads["surroundings"]) > 5
    assert {t: later.payloads[t] for t in judged} == {t: at_once.payloads[t] for t in judged}
    assert later.payloads["shadow"] == at_once.payloads["shadow"]
