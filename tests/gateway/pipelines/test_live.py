"""The loop without sockets: hand-over to the model and back, predictions, health, recording."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest

from gateway.config import FollowingSettings
from gateway.errors import BadInput, ShadowError
from gateway.links import Datagram, LinkEvent, LinkEventKind
from gateway.live.boats import BoatPlan, Fleet, sender
from gateway.monitor import decode
from gateway.recording.reader import Recording
from gateway.recording.recorder import TICK_LINK
from gateway.shadow.topic_rows import EventRow
from gateway.simulated_boat import THIN, Faults, Reboot, Silence
from sim.following.follower import ReferenceMode
from sim.model import Model
from tests.gateway.pipelines.aboard import (
    LINK,
    SETTINGS,
    UNIX_S,
    Deck,
    Heard,
    at_ns,
    datagrams,
    played,
)
from tests.sim.vessels import WAMV

VELOCITY = ("surge_mps", "sway_mps", "yaw_rate_radps")
SILENT = Silence(20.0, 32.0)


@pytest.fixture(scope="module")
def blind() -> Heard:
    """A voyage with twelve seconds of silence, and the silence of the link's end."""
    frames = played(45.0, faults=Faults(silences=(SILENT,)))
    with Deck() as deck:
        return deck.hear(datagrams(frames), until_s=90.0).heard()


def table(heard: Heard, topic: str, *names: str) -> Any:
    """Columns (K, 1 + n) of a topic, the boat's time [s since play began] first."""
    times = np.array(heard.column(topic, "vehicle_time_ns")) * 1e-9 - 1.7e9
    return np.column_stack([times, *(heard.column(topic, name) for name in names)])


def test_the_model_takes_over_while_the_link_is_silent_and_both_are_events(blind: Heard) -> None:
    kinds = [k for k in blind.events() if k.startswith(("telemetry", "reference"))]
    assert kinds[:4] == [
        "telemetry_silent", "reference_model", "telemetry_back", "reference_measured",
    ]  # fmt: skip
    shadow = table(blind, "shadow")[:, 0]
    source = np.array(blind.column("shadow", "source"))
    while_blind = (shadow > SILENT.from_s + 1.1) & (shadow < SILENT.to_s)
    assert set(source[while_blind]) == {"model"}
    assert set(source[(shadow > SILENT.to_s + 0.5) & (shadow < 45.0)]) == {"measured"}
    assert np.diff(shadow[while_blind]).max() < 0.13  # ticks
    measured = table(blind, "measured")[:, 0]
    assert not ((measured > SILENT.from_s + 1.1) & (measured < SILENT.to_s)).any()


def test_the_shadow_never_jumps_by_more_than_the_estimate_is_uncertain(blind: Heard) -> None:
    names = (*VELOCITY, *(f"{name}_std" for name in VELOCITY))
    rows = table(blind, "shadow", *names)[50:]
    steps, std = np.abs(np.diff(rows[:, 1:4], axis=0)), rows[:-1, 4:]
    step_s = np.diff(rows[:, 0])[:, None]
    assert (steps < std + 1.0 * step_s).all()  # and what a boat's acceleration explains
    back = table(blind, "measured", *VELOCITY)
    k = np.searchsorted(rows[:, 0], SILENT.to_s) - 1
    gap = np.abs(back[back[:, 0] > SILENT.to_s][:10, 1:] - rows[k, 1:4])
    assert (gap < 3.0 * rows[k, 4:]).all()  # the pilot went on unheard; that is what std is for


def test_uncertainty_grows_while_blind_and_is_small_again_after(blind: Heard) -> None:
    names = [f"{name}_std" for name in (*VELOCITY, "north_m", "yaw_rad")]
    rows = table(blind, "shadow", *names)
    at = [np.searchsorted(rows[:, 0], t) for t in (19.9, 22.0, 26.0, 31.9, 34.0)]
    before, two, six, twelve, after = rows[at, 1:]
    assert (before < two).all()
    assert (two[3:] < six[3:]).all()  # position and heading wander on
    assert (six[3:] < twelve[3:]).all()
    assert (two[:3] <= six[:3] + 1e-9).all()
    assert (twelve > 2.0 * before).all()
    assert (after < 1.2 * before).all()


def test_after_thirty_seconds_the_shadow_stands_still_and_says_so(blind: Heard) -> None:
    shadow = table(blind, "shadow")[:, 0]
    assert 74.0 < shadow[-1] < 75.2
    assert blind.events().count("shadow_rests") == 1
    ages = table(blind, "health", "link_age_s")
    assert ages[-1, 1] == pytest.approx(ages[-1, 0] - 45.0, abs=1.1)


def test_health_tells_rates_loss_and_the_filters_honesty() -> None:
    with Deck() as deck:
        heard = deck.hear(datagrams(played(20.0, faults=Faults(loss=0.3)))).heard()
    last = heard.messages("health")[-1]
    assert last["rate_attitude_hz"] == pytest.approx(35.0, abs=4.0)
    assert last["rate_local_position_hz"] == pytest.approx(17.5, abs=4.0)
    assert last["loss"] == pytest.approx(0.3, abs=0.05)
    assert 0.1 < last["nis"] < 1.5
    assert last["clock_offset_s"] == pytest.approx(0.0, abs=0.03)
    assert last["link_age_s"] < 0.1
    assert np.diff(heard.column("health", "receive_time_ns")) == pytest.approx(1e9, abs=1e8)


@pytest.mark.slow
def test_telemetry_as_thin_as_a_radios_is_shadowed_all_the_same() -> None:
    with Deck() as deck:
        heard = deck.hear(datagrams(played(40.0, rates=THIN))).heard()
    assert set(heard.column("shadow", "source")) == {"measured"}
    assert heard.events() == ["started"]


def errors_by_hand(rows: list[tuple[float, Any, Any]], horizon: float) -> Any:
    """Rows of time, motion, commands -> the last error of u, v, r that has come due."""
    starts, known = [0], None
    for k in range(1, len(rows)):
        if rows[k][0] >= rows[starts[-1]][0] + 1.0:
            starts.append(k)
    model = Model.of(WAMV)
    for start in starts:
        state = np.array(rows[start][1][:6])
        for (before, _, _), (now, motion, commands) in zip(
            rows[start:], rows[start + 1 :], strict=False
        ):
            states, _ = model.simulate(commands[None], now - before, state)
            state = states[0, -1]
            if now - rows[start][0] >= horizon:
                known = motion[3:6] - state[3:6]
                break
    return known


@pytest.mark.slow
def test_errors_of_predictions_are_those_of_a_run_by_hand() -> None:
    fleet, rows, errors = Fleet([BoatPlan(WAMV)], SETTINGS), [], None
    pulses = np.full(16, np.nan)
    for datagram in datagrams(played(13.5)):
        message = datagram.frames[0].message
        if message.get_type() == "SERVO_OUTPUT_RAW":
            pulses = np.array([getattr(message, f"servo{i}_raw") for i in range(1, 17)], float)
        for said in fleet.datagrams([datagram]):
            for out in filter(None, [said.output.out]):
                commands = WAMV.commands(range(1, 17), pulses)
                rows += [
                    (float(t), m, commands) for t, m in zip(out.time_s, out.estimate, strict=True)
                ]
                errors = out.residuals.errors[-1] if len(out) else errors
    assert errors is not None
    for k, horizon in enumerate((1.0, 5.0, 10.0)):
        assert errors[3 * k : 3 * k + 3] == pytest.approx(errors_by_hand(rows, horizon), abs=1e-6)


@pytest.mark.slow
def test_in_mode_model_the_measurement_is_only_the_beginning() -> None:
    settings = replace(SETTINGS, following=FollowingSettings(reference=ReferenceMode.MODEL))
    with Deck(settings=settings) as deck:
        heard = deck.hear(datagrams(played(20.0))).heard()
    assert set(heard.column("shadow", "source")) == {"model"}
    far = table(heard, "measured", *VELOCITY)[-1, 1:] - table(heard, "shadow", *VELOCITY)[-1, 1:]
    assert np.abs(far).max() < 0.3


def test_what_happens_to_a_link_is_an_event_of_every_boat_on_it(tmp_path: Path) -> None:
    heard = datagrams(played(3.0))
    with Deck(out=tmp_path) as deck:
        deck.hear(heard)
        event = LinkEvent("tcp:boat:5760", at_ns(3.1), LinkEventKind.LOST, "closed; trying again")
        deck.gateway.turn(event)
    (lost,) = [m for m in deck.heard().messages("event") if m["kind"] == "link_lost"]
    assert lost["severity"] == "warning"
    assert lost["says"] == "tcp:boat:5760: closed; trying again"
    assert "tcp:boat:5760: closed; trying again" in deck.told


def test_all_that_was_published_is_recorded_and_ticks_are(tmp_path: Path) -> None:
    with Deck(out=tmp_path) as deck:
        deck.hear(datagrams(played(12.0, faults=Faults(silences=(Silence(5.0, 8.0),)))))
    (path,) = tmp_path.glob("*.mcap")
    recording = Recording.open(path)
    assert recording.finished
    for topic, payloads in deck.heard().payloads.items():
        recorded = [p for rows in recording.rows(topic) for p in rows.payloads]
        assert recorded == payloads
    raw = recording.raw()
    assert len(raw) > 1000
    assert TICK_LINK in raw.links
    assert recording.metadata["shadow"]["vessel"] == "wam-v"
    assert set(recording.attachments) == {"vessel.toml", "config.json"}


def test_the_recording_of_a_second_start_takes_another_name(tmp_path: Path) -> None:
    for _ in range(3):
        with Deck(out=tmp_path) as deck:
            deck.hear(datagrams(played(1.0)))
    assert 1 <= len(list(tmp_path.glob("*.mcap"))) == 3


def test_a_folder_that_cannot_be_is_bad_input_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot record there"), Deck(out=tmp_path / "file" / "a"):
        pass


def test_a_clock_set_back_by_an_hour_stops_neither_ticks_nor_health() -> None:
    first, then = datagrams(played(20.0)), []
    for d in first:
        late = d.receive_time_ns > at_ns(10.0)
        then.append(Datagram(d.link, d.receive_time_ns - late * 3600 * 10**9, d.frames))
    with Deck() as deck:
        deck.hear(first[:1])
        for d in then:
            deck.now_ns = d.receive_time_ns
            deck.gateway.turn(d)
        end = deck.now_ns
        before = len(deck.heard().payloads["shadow"])
        while deck.now_ns < end + 3 * 10**9:
            deck.now_ns += 25_000_000
            deck.gateway.turn(None)
    heard = deck.heard()
    assert len(heard.payloads["shadow"]) - before > 20
    health = heard.messages("health")
    assert [h["receive_time_ns"] < at_ns(0.0) for h in health].count(True) >= 11
    assert health[-4]["rate_attitude_hz"] == pytest.approx(50.0, abs=2.0)


def test_a_defect_is_told_and_counted_but_does_not_end_the_shadow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard = datagrams(played(6.0))
    with Deck() as deck:
        deck.hear(heard[:200])
        deck.gateway._strict = False
        good = deck.gateway.fleet.received
        monkeypatch.setattr(deck.gateway.fleet, "received", lambda d: 1 // 0)
        deck.hear(heard[200:210])
        monkeypatch.setattr(deck.gateway.fleet, "received", good)
        before = len(deck.heard().payloads["shadow"])
        deck.hear(heard[210:])
    assert deck.gateway.faults == 10
    assert sum("defect" in says for says in deck.told) == 1
    assert deck.heard().events().count("fault") == 1
    assert len(deck.heard().payloads["shadow"]) > before + 50


def test_a_defect_in_one_boat_costs_the_others_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of datagrams that waited together, and of an event that waited behind them."""
    first, second = played(3.0, system_id=1), played(3.0, system_id=2)
    given = datagrams(first, second)
    plans = [BoatPlan(WAMV, system=1, name="a"), BoatPlan(WAMV, system=2, name="b")]
    with Deck(plans, tmp_path) as deck:
        deck.hear(given[:200])
        deck.gateway._strict = False
        before = len(deck.heard(2).payloads["shadow"])
        monkeypatch.setattr(deck.gateway.fleet.boats[1], "datagrams", lambda messages: 1 // 0)
        lost = LinkEvent(LINK, given[230].receive_time_ns, LinkEventKind.LOST, "closed")
        for item in (*given[201:230], lost):
            deck.gateway.inbox.put(item)
        deck.gateway.turn(given[200])
        assert deck.gateway.faults == 1
        assert len(deck.heard(2).payloads["shadow"]) > before + 4
        assert f"{LINK}: closed" in deck.told
        recorded = {n: out.recording.paths[-1] for n, out in deck.gateway.outputs.items()}
    for n, path in recorded.items():
        frames = Recording.open(path).raw().frames()
        sent = [f.raw for d in given[:230] for f in d.frames if sender(f.raw) == n]
        assert [frame for frame in frames if sender(frame) == n] == sent
    kept = [
        payload for rows in Recording.open(recorded[2]).rows("shadow") for payload in rows.payloads
    ]
    assert kept == deck.heard(2).payloads["shadow"]


def test_a_recording_that_cannot_be_finished_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The disk is full when the last of it is written: "finished" would be false."""
    with Deck(out=tmp_path) as deck:
        deck.hear(datagrams(played(3.0)))
        (outputs,) = deck.gateway.outputs.values()
        recorder = outputs.recording._recorder
        finish = recorder.finish

        def full() -> None:
            finish()
            raise ShadowError("the disk is full")

        monkeypatch.setattr(recorder, "finish", full)
    assert deck.gateway.unfinished() == ["wam-v: the disk is full"]
    with Deck(out=tmp_path) as deck:
        deck.hear(datagrams(played(3.0)))
    assert deck.gateway.unfinished() == []


def test_a_defect_while_the_last_rows_are_judged_is_told_and_ends_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ctrl-C came: what is recorded is closed whatever the monitor makes of the rest."""
    with Deck() as deck:
        deck.hear(datagrams(played(6.0)))
        deck.gateway._strict = False
        (boat,) = deck.gateway.fleet.boats.values()
        deck.gateway._unjudged = {boat.boat.system: boat}
        monkeypatch.setattr(boat, "judge", lambda: 1 // 0)
        deck.gateway.catch_up()
    assert deck.gateway.faults == 1
    assert deck.heard().events().count("fault") == 1


FAULTS = Faults(silences=(Silence(4.0, 6.0),), reboots=(Reboot(14.0, 1.0),))


def outputs_of(fleet: Fleet, given: list[Datagram], together: int) -> Heard:
    """What a fleet of one boat says to datagrams of which so many wait at a time."""
    heard = Heard()
    for k in range(0, len(given), together):
        for found in fleet.datagrams(given[k : k + together]):
            heard.add(found.output.rows)
        end = min(k + together, len(given))
        if end % 96 == 0:
            for boat in fleet.boats.values():
                heard.add(boat.status(given[end - 1].receive_time_ns, 0, 0))
    return heard


def test_datagrams_that_wait_are_taken_in_one_go_and_give_the_same() -> None:
    given = datagrams(played(19.0, faults=FAULTS))
    plans = [BoatPlan(WAMV)]
    alone, together = (outputs_of(Fleet(plans, SETTINGS), given, n) for n in (1, 12))
    for topic in alone.payloads:
        assert together.payloads[topic] == alone.payloads[topic], topic
    assert {"shadow", "residual", "health", "event"} <= set(alone.payloads)
    assert {"started", "reboot"} <= set(together.events())


def test_a_reboot_is_printed_once_and_not_the_jump_that_it_brings() -> None:
    with Deck() as deck:
        deck.hear(datagrams(played(19.0, faults=Faults(reboots=(Reboot(12.0, 1.0),)))))
    lines = [str(line) for line in deck.told]
    assert sum("the autopilot rebooted: the estimate begins anew" in line for line in lines) == 1
    assert not any(" jumped" in line or "started afresh" in line for line in lines)


@pytest.mark.parametrize("wrong", [True, False])
def test_what_was_wrong_before_a_reboot_is_judged_anew(wrong: bool) -> None:
    """A compass that was disturbed was blamed on the model 64 s after it was put right."""
    with Deck() as deck:
        deck.hear(datagrams(played(3.0)))
        (boat,) = deck.gateway.fleet.boats.values()
    monitor = boat._model_monitor
    misfit = replace(monitor.alarm.misfit, wrong=wrong, level=9.0)
    boat._model_monitor = monitor._replace(alarm=replace(monitor.alarm, misfit=misfit))
    told = boat._restart(4_000_000_000).events
    assert [event.kind for event in told] == ["reboot", *(["model_right"] if wrong else [])]
    assert boat.judged == (told[1] if wrong else None)
    assert not boat._model_monitor.alarm.misfit.wrong
    assert boat._model_monitor.alarm.misfit.level == 0.0


SAYS = "since 14:32:05 UTC the model is wrong (after 5 s off by 0.18 m/s ahead): looks like drag"


def test_the_status_tells_by_which_event_the_model_was_judged_last() -> None:
    """A monitor that came late saw a bus that keeps one event, and that was of a request."""
    with Deck() as deck:
        deck.hear(datagrams(played(3.0)))
        (boat,) = deck.gateway.fleet.boats.values()
        assert orjson.loads(deck.gateway._status(boat)())["judged"] is None
        wrong = EventRow(1, 2, "model_explained", "warning", SAYS)
        boat._with_events([], [wrong, EventRow(3, 4, "jump", "warning", "it jumped")])
        status = orjson.loads(deck.gateway._status(boat)())
    assert decode("event", orjson.dumps(status["judged"])) == {
        "vehicle_time_ns": 1, "receive_time_ns": 2, "kind": "model_explained",
        "severity": "warning", "says": SAYS,
    }  # fmt: skip


def test_the_end_tells_where_recordings_are_and_what_stands_of_the_model(
    tmp_path: Path,
) -> None:
    """ "finished" alone was said of a model that had been wrong for a minute."""
    with Deck(out=tmp_path) as deck:
        deck.hear(datagrams(played(3.0)))
        (boat,) = deck.gateway.fleet.boats.values()
        boat._with_events([], [EventRow(1, 2, "model_explained", "warning", SAYS)])
        (outputs,) = deck.gateway.outputs.values()
    path = next(tmp_path.glob("*.mcap"))
    assert deck.gateway.left() == [f"recorded: {path}", f"wam-v, at the end: {SAYS}"]
    assert [line.level for line in deck.gateway.left()] == ["info", "warning"]
    path.unlink()
    assert outputs.paths == ()


@pytest.mark.parametrize("seconds", [3, 60])
def test_at_the_end_a_model_is_only_said_to_be_right_where_it_was_judged(seconds: int) -> None:
    with Deck() as deck:
        deck.hear(datagrams(played(3.0)))
        (boat,) = deck.gateway.fleet.boats.values()
    monitor = boat._model_monitor
    estimate = replace(monitor.alarm.estimate, count=seconds)
    boat._model_monitor = monitor._replace(alarm=replace(monitor.alarm, estimate=estimate))
    told = ["wam-v, at the end: the model was not found wrong"] if seconds == 60 else []
    assert deck.gateway.left() == told


def test_breaks_of_the_estimate_are_printed_now_and_then() -> None:
    """A source that jumps again and again is one line in ten seconds."""
    with Deck() as deck:
        deck.hear(datagrams(played(3.0)))
        (boat,) = deck.gateway.fleet.boats.values()
    times = [round(t * 1e9) for t in (1.0, 1.0, 5.0, 11.5, 12.0, 2.0)]
    kinds = ("jump", "restart", "jump", "restart", "jump", "jump")
    breaks = [
        EventRow(at, at, kind, "warning", kind) for at, kind in zip(times, kinds, strict=True)
    ]
    told = [event.receive_time_ns for event in breaks if boat._is_new_break(event)]
    assert told == [times[0], times[3], times[5]]  # the last one: the clock was set back


def test_what_waits_in_the_inbox_is_handled_in_one_turn_up_to_an_event() -> None:
    given = datagrams(played(3.0))
    event = LinkEvent(LINK, given[50].receive_time_ns, LinkEventKind.LOST, "closed")
    with Deck() as deck:
        for item in (*given[1:50], event, *given[50:60]):
            deck.gateway.inbox.put(item)
        deck.now_ns = given[60].receive_time_ns
        deck.gateway.turn(given[0])
        assert len(deck.gateway.inbox) == 10
        assert f"{LINK}: closed" in deck.told
        deck.gateway.turn(deck.gateway.inbox.get(timeout=0))
        assert len(deck.gateway.inbox) == 0
        deck.gateway.catch_up()
    with Deck() as other:
        alone = other.hear(given[:60]).heard()
    assert deck.heard().payloads["shadow"] == alone.payloads["shadow"]
    (lost,) = [m for m in deck.heard().messages("event") if m["kind"] == "link_lost"]
    assert lost["says"] == f"{LINK}: closed"


@pytest.mark.parametrize(("hz", "silences"), [(1.0, 0), (10.0, 1)])
def test_a_slow_stream_is_not_silent_between_its_messages(hz: float, silences: int) -> None:
    """An autopilot that denies every rate goes on at 1 Hz, and may lose a message."""
    with Deck() as deck:
        wire = [
            item
            for item in datagrams(played(40.0, rates=dict.fromkeys(THIN, hz)))
            if not 29.1 < item.receive_time_ns * 1e-9 - UNIX_S < 30.4
        ]
        found = deck.hear(wire, 40.0).heard()
    kinds = [m["kind"] for m in found.messages("event")]
    assert [kinds.count(kind) for kind in ("telemetry_silent", "telemetry_back")] == [silences] * 2
