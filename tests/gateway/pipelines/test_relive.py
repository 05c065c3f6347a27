"""What ran live runs again from its recording to the last bit."""

from itertools import count
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import BadInput, ShadowError
from gateway.links import Datagram
from gateway.live.boats import BoatPlan, Fleet, sender
from gateway.live.outputs import start_recording
from gateway.live.rerun import fleet_of, loop_inputs, rerun
from gateway.recording.reader import Recording
from gateway.recording.recorder import TICK_LINK
from gateway.recording.thread import RecordingThread
from gateway.simulated_boat import Burst, Faults, Reboot, Silence
from sim.plants import PlantChoice
from tests.gateway.pipelines.aboard import SETTINGS, Deck, Heard, at_ns, datagrams, played
from tests.sim.vessels import IACQUABOT, WAMV

COMPARED = ("measured", "reference", "shadow", "control", "residual", "position")
ROUGH = Faults(
    reboots=(Reboot(22.0),),
    silences=(Silence(8.0, 13.0),),
    bursts=(Burst(16.0, 18.0),),
    loss=0.1,
    duplicates=0.2,
    reordered=0.2,
)


def again(path: Path, plan: BoatPlan) -> Heard:
    heard = Heard()
    for moment in rerun(fleet_of(Recording.open(path), plan, SETTINGS), path):
        heard.add(moment.rows)
    return heard


def only(folder: Path, name: str) -> Path:
    (found,) = folder.glob(f"{name}-*.mcap")
    return found


def check(live: Heard, rerun: Heard, rows: int) -> None:
    for topic in COMPARED:
        rows = rows if topic != "residual" else rows // 5  # its longest horizon is due late
        assert len(live.payloads[topic]) > rows
        assert rerun.payloads[topic] == live.payloads[topic]


@pytest.mark.slow
def test_a_rough_voyage_runs_again_to_the_last_bit_ticks_included(tmp_path: Path) -> None:
    with Deck(out=tmp_path) as deck:
        deck.hear(datagrams(played(30.0, faults=ROUGH)), until_s=32.0)
    path = only(tmp_path, "wam-v")
    links = [moment.link for moment in loop_inputs(Recording.open(path).raw())]
    assert links.count(TICK_LINK) > 40
    check(deck.heard(), again(path, BoatPlan(WAMV)), rows=500)
    assert {"telemetry_silent", "telemetry_back", "reboot"} <= set(deck.heard().events())


@pytest.mark.slow
def test_each_of_several_boats_on_one_link_runs_again_from_its_own_recording(
    tmp_path: Path,
) -> None:
    plans = [BoatPlan(WAMV, system=1), BoatPlan(IACQUABOT, PlantChoice(vessel=WAMV), system=7)]
    first = played(12.0, faults=Faults(silences=(Silence(6.0, 9.0),)))
    second = played(12.0, IACQUABOT, seed=1, system_id=7, faults=Faults(loss=0.1))
    stranger = played(12.0, seed=2, system_id=9)
    with Deck(plans, tmp_path) as deck:
        deck.hear(datagrams(first, second, stranger), until_s=13.0)
    for system, name, plan in ((1, "wam-v", plans[0]), (7, "iacquabot", plans[1])):
        check(deck.heard(system), again(only(tmp_path, name), plan), rows=200)
    assert sum("not followed" in says for says in deck.told) == 1


def test_how_frames_are_packed_into_datagrams_makes_no_difference() -> None:
    single = datagrams(played(12.0))
    receipts = [single[k - k % 7].receive_time_ns for k in range(len(single))]
    alone = [Datagram(d.link, t, d.frames) for d, t in zip(single, receipts, strict=True)]
    packed = [
        Datagram(d.link, d.receive_time_ns, tuple(f for e in alone[k : k + 7] for f in e.frames))
        for k, d in enumerate(alone)
        if k % 7 == 0
    ]
    one, other = Heard(), Heard()
    for heard, items in ((one, alone), (other, packed)):
        fleet = Fleet([BoatPlan(WAMV)], SETTINGS)
        for item in items:
            for said in fleet.datagrams([item]):
                heard.add(said.output.rows)
    check(one, other, rows=300)


def test_what_was_heard_before_the_boat_said_who_it_is_is_recorded(tmp_path: Path) -> None:
    heard = datagrams(played(5.0))
    late = [d for d in heard if d.frames[0].message.get_type() != "HEARTBEAT"][:50] + heard
    late.sort(key=lambda d: d.receive_time_ns)
    with Deck(out=tmp_path) as deck:
        deck.hear(late)
    raw = Recording.open(only(tmp_path, "wam-v")).raw()
    assert raw.frames() == [frame.raw for d in late for frame in d.frames]


def test_a_recording_that_begins_late_has_all_of_its_boat_and_nothing_of_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts = count(1)

    def refused_twice(*given: Any) -> RecordingThread:
        if next(attempts) <= 2:
            raise ShadowError("no room")
        return start_recording(*given)

    monkeypatch.setattr("gateway.live.gateway.start_recording", refused_twice)
    plans = [BoatPlan(WAMV, system=1), BoatPlan(IACQUABOT, system=7)]
    first = datagrams(played(12.0, faults=Faults(silences=(Silence(1.5, 3.0),))))
    early = [d for d in first if d.frames[0].message.get_type() != "HEARTBEAT"][:50]
    first = sorted(early + first, key=lambda d: d.receive_time_ns)
    later = datagrams(played(12.0, IACQUABOT, seed=1, system_id=7))
    later = [d for d in later if d.receive_time_ns > at_ns(8.0)]
    with Deck(plans, tmp_path) as deck:
        deck.hear(sorted(first + later, key=lambda d: d.receive_time_ns))
    assert next(attempts) == 5
    boat, other = only(tmp_path, "wam-v"), only(tmp_path, "iacquabot")
    check(deck.heard(), again(boat, plans[0]), rows=200)
    frames = Recording.open(boat).raw().frames()
    assert [f for f in frames if f and sender(f) == 1] == [d.frames[0].raw for d in first]
    assert {sender(frame) for frame in Recording.open(other).raw().frames()} == {7}


def test_a_recording_that_did_not_run_live_is_refused_in_one_line(tmp_path: Path) -> None:
    from tests.gateway.voyages import record

    (path,) = record(tmp_path / "a.mcap")
    with pytest.raises(BadInput, match=r"a\.mcap: not a recording of `shadow live`"):
        fleet_of(Recording.open(path), BoatPlan(WAMV), SETTINGS)
