"""Everything that links, boats and strangers do wrong: the shadow stays sane and says what it saw.

Without sockets, see `test_live_process` for those.
"""

import errno
import random
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import count
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mapping import Origin, to_local
from gateway.links import Datagram, Frame
from gateway.links.frame_reader import split_frames
from gateway.live import outputs
from gateway.recording.reader import Recording
from gateway.recording.recorder import Recorder, TopicsKept, open_new
from gateway.simulated_boat import Burst, Faults, Reboot, Silence, SimulatedBoatSettings
from tests.gateway.pipelines.aboard import SETTINGS, Deck, Heard, at_ns, datagrams, played, truth
from tests.gateway.pipelines.running import wait

SECONDS = 30.0
HOME = Origin(*SimulatedBoatSettings().origin_deg)


def shadowed(frames: Any, **around: Any) -> Heard:
    with Deck(**around) as deck:
        return deck.hear(datagrams(frames)).heard()


@cache
def voyage() -> list[Datagram]:
    """What arrives while nothing goes wrong."""
    return datagrams(played(SECONDS))


@cache
def true_track() -> Any:
    return truth(SECONDS)


@pytest.fixture(scope="module")
def clean() -> Heard:
    """The same voyage when nothing goes wrong."""
    with Deck() as deck:
        return deck.hear(voyage()).heard()


def track(heard: Heard, who: str = "shadow") -> Any:
    """(K, 3): receipt [s since play began], north, east [m from home]."""
    rows = heard.messages("position")
    times = [row["receive_time_ns"] * 1e-9 - 1.7e9 for row in rows]
    names = f"{who}_latitude_deg", f"{who}_longitude_deg"
    places = np.array([[row[name] for name in names] for row in rows])
    return np.column_stack([times, to_local(places, HOME)])


def off(heard: Heard, true: Any, from_s: float = 3.0) -> Any:
    """(K,) m: how far the shadow is from where the boat is."""
    mine = track(heard)
    mine = mine[(mine[:, 0] > from_s) & (mine[:, 0] < SECONDS)]
    assert len(mine) > 100
    there = [np.interp(mine[:, 0], true[:, 0], true[:, k]) for k in (1, 2)]
    return np.hypot(mine[:, 1] - there[0], mine[:, 2] - there[1])


UNHEARD = {"telemetry_silent", "reference_model", "telemetry_back", "reference_measured"}
# what goes wrong, how far off the shadow may be [m], which events there must be
TROUBLES: dict[str, tuple[Faults, float, set[str]]] = {
    "link silent and back": (
        Faults(silences=(Silence(10.0, 18.0),)),
        12.0,  # eight seconds of a pilot unheard
        UNHEARD,
    ),
    "reboot": (Faults(reboots=(Reboot(12.0, 3.0),)), 6.0, {"reboot", *UNHEARD}),
    "doubled and reordered": (Faults(duplicates=0.3, reordered=0.3), 2.0, set()),
    "lost": (Faults(loss=0.3), 2.0, set()),
    "burst": (Faults(bursts=(Burst(10.0, 12.0),)), 4.0, UNHEARD),
    "nonsense": (Faults(nonsense=0.1), 2.0, set()),
    "all at once": (
        Faults((Reboot(20.0),), (Silence(8.0, 10.0),), (Burst(13.0, 14.0),), 0.2, 0.2, 0.2, 0.03),
        8.0,
        {"reboot", *UNHEARD},
    ),
}


@cache
def troubled(trouble: str) -> Heard:
    return shadowed(played(SECONDS, faults=TROUBLES[trouble][0]))


@pytest.mark.slow
@pytest.mark.parametrize("trouble", TROUBLES)
def test_the_shadow_stays_near_the_boat_and_says_what_happened(trouble: str) -> None:
    faults, metres, events = TROUBLES[trouble]
    heard = troubled(trouble)
    true = truth(SECONDS, faults=faults) if faults.reboots else true_track()
    assert off(heard, true).max() < metres
    assert off(heard, true, 27.0).max() < 1.5
    speeds = np.array([heard.column("shadow", n) for n in ("surge_mps", "sway_mps")])
    assert np.abs(speeds).max() < 5.0
    kinds = set(heard.events())
    assert events | {"started"} <= kinds
    assert kinds <= events | {"started", "jump"} | (UNHEARD if "reboot" in events else set())


@pytest.mark.slow
def test_health_counts_what_was_lost_late_and_refused() -> None:
    lossy = troubled("lost").messages("health")[-1]
    assert lossy["loss"] == pytest.approx(0.3, abs=0.06)
    last = troubled("doubled and reordered").messages("health")[-1]
    assert last["loss"] < 0.02
    assert last["rate_hz"] > 1.2 * 115.0
    absurd = troubled("nonsense").messages("health")[-1]
    assert absurd["gated"] > 20


@pytest.mark.slow
def test_a_burst_is_worked_off_without_loss() -> None:
    frames = played(20.0, faults=Faults(bursts=(Burst(5.0, 15.0, 10.0),)))
    heard = shadowed(frames)
    assert max(heard.column("health", "rate_hz")) > 230.0
    assert max(heard.column("health", "loss")) == 0.0
    assert heard.messages("health")[-1]["late"] == 0
    waited = 9.0
    assert len(heard.payloads["shadow"]) > 0.95 * (50 * (20 - waited) + 10 * waited)


@pytest.mark.slow
def test_a_machine_that_is_too_slow_says_how_old_its_picture_is_and_loses_nothing() -> None:
    """From 3 to 15 s something else has the processor: that is no silence of the boat."""
    items, k = datagrams(played(25.0)), 0
    with Deck() as deck:
        inbox = deck.gateway.inbox
        while k < len(items) or len(inbox):
            busy = at_ns(3.0) < deck.now_ns < at_ns(15.0)
            deck.now_ns = at_ns(15.0) if busy else deck.now_ns + 1_000_000
            while k < len(items) and items[k].receive_time_ns <= deck.now_ns:
                inbox.put(items[k])
                k += 1
            deck.gateway.turn(inbox.get(0.0) if len(inbox) else None)
    heard = deck.heard()
    assert heard.payloads["shadow"] == shadowed(played(25.0)).payloads["shadow"]
    assert "telemetry_silent" not in heard.events()
    slow = [line for line in map(str, deck.told) if "this machine is too slow" in line]
    assert slow == ["wam-v: this machine is too slow: what is shown is 12 s old"]
    assert heard.events().count("overload") == heard.events().count("overload_over") == 1
    assert heard.events().index("overload") < heard.events().index("overload_over")


@pytest.mark.slow
def test_a_ground_station_on_the_link_is_no_boat_and_no_harm() -> None:
    with Deck() as deck:
        heard = deck.hear(datagrams(played(8.0, station=True))).heard()
    assert list(deck.gateway.fleet.boats) == [1]
    alone = shadowed(played(8.0)).payloads["shadow"]
    assert heard.payloads["shadow"] == alone
    assert len(alone) > 200


@cache
def zigzag() -> tuple[Any, Any]:
    """What arrives from a boat in a zigzag, and its track when it is alone."""
    frames = played(20.0, program="zigzag")
    return frames, track(shadowed(frames), "boat")


@pytest.mark.slow
@pytest.mark.parametrize("apart_s", [0.0, 3.0, 200.0])
def test_of_two_boats_with_one_system_id_the_shadow_follows_what_can_be(apart_s: float) -> None:
    """Nobody can tell them apart by their frames; one that booted long before is left out."""
    near, alone = zigzag()
    far = played(20.0, seed=5, program="turns", start=(30.0, 20.0, 1.0), boot_s=30.0 + apart_s)
    with Deck() as deck:
        heard = deck.hear(datagrams(near, far)).heard()
    places = track(heard)
    boats = [alone, track(shadowed(far), "boat")]
    distance = [
        np.hypot(*(np.interp(places[:, 0], b[:, 0], b[:, k]) - places[:, k] for k in (1, 2)))
        for b in boats
    ]
    assert np.isfinite(places).all()
    if apart_s > 10.0:
        assert distance[0][50:].max() < 2.0
    assert np.minimum(*distance).max() < 60.0


def stranger(dice: random.Random, decoder: Any) -> Any:
    """Any message of the dialect with any content, from the boat's own address."""
    kind = dice.choice(list(dialect.mavlink_map.values()))
    message = kind.__new__(kind)
    mav = dialect.MAVLink(None, 1, 1)
    mav.seq = dice.randrange(256)
    payload = bytes(dice.randrange(256) for _ in range(kind.unpacker.size))
    raw = _blank(kind, message)._pack(mav, kind.crc_extra, payload)
    try:
        return Frame(raw, decoder.decode(bytearray(raw)))
    except Exception:
        return None


def _blank(kind: Any, message: Any) -> Any:
    dialect.MAVLink_message.__init__(message, kind.id, kind.msgname)
    return message


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_any_content_in_any_message_leaves_the_shadow_finite(seed: int) -> None:
    """One frame in five is forged, heartbeats that disarm and clocks that jump included."""
    dice, decoder, items = random.Random(seed), dialect.MAVLink(None), []
    for datagram in voyage():
        items.append(datagram)
        forged = stranger(dice, decoder) if dice.random() < 0.2 else None
        if forged is not None and datagram.receive_time_ns < 1_700_000_020 * 10**9:
            items.append(Datagram(datagram.link, datagram.receive_time_ns + 1000, (forged,)))
    assert len(items) > 4900
    with Deck() as deck:
        heard = deck.hear(items).heard()
    assert off(heard, true_track(), 27.0).max() < 3.0
    assert np.abs(heard.column("shadow", "surge_mps")).max() < 60.0
    assert np.abs(heard.column("control", "surge_n")).max() < 1e7


def test_random_bytes_are_never_more_than_frames_without_meaning() -> None:
    dice, found = random.Random(1), 0
    for _ in range(300):
        data = bytes(dice.choice((0xFD, 0xFE, 0, dice.randrange(256))) for _ in range(200))
        found += sum(piece.known for piece in split_frames(data).frames)
    assert found == 0


class Full:
    """A file on a disk that fills up."""

    def __init__(self, stream: IO[bytes], room: int) -> None:
        self._stream, self._room = stream, room

    def write(self, data: Any) -> int:
        self._room -= len(data)
        if self._room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._stream.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def full(room: int) -> Callable[[Path], Any]:
    return lambda path: Full(open_new(path), room)


@pytest.mark.slow
@pytest.mark.parametrize("room", [50_000, pytest.param(10, marks=pytest.mark.slow)])
def test_a_full_disk_is_an_event_and_the_shadow_runs_on(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clean: Heard
) -> None:
    monkeypatch.setattr(outputs, "Recorder", partial(Recorder, opener=full(room)))
    monkeypatch.setattr("gateway.recording.thread.WRITE_S", 0.001)
    everything = replace(SETTINGS.recording, topics=TopicsKept.ALL)  # thinned, it fits for long
    settings = replace(SETTINGS, recording=everything)
    with Deck(out=tmp_path, settings=settings) as deck:
        heard = deck.hear(voyage()).heard()
        shadow, later_s = list(heard.payloads["shadow"]), count(SECONDS + 1.0)

        def backlog() -> int:
            deck.hear((), until_s=next(later_s))
            return int(heard.messages("health")[-1]["recorder_backlog"])

        (outlet,) = deck.gateway.outputs.values()
        wait(lambda: outlet.backlog == 0)  # nothing waits for a disk that takes nothing …
        wait(lambda: backlog() == 0)  # … which is what health says
    events = [m for m in heard.messages("event") if m["kind"].startswith("recording_")]
    failed = events[0]  # it is tried again, more and more seldom
    assert failed["kind"] == "recording_failed"
    assert len(events) <= 8
    assert failed["severity"] == "error"
    assert "No space left on device" in failed["says"]
    assert shadow == clean.payloads["shadow"]
    if room > 10:
        assert heard.messages("health")[-1]["recorder_drops"] > 1000
        first = min(tmp_path.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)
        assert not Recording.open(first).finished
