"""LinkRequests for rates: what is asked, when, how often, and what is made of the answers."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.links.rate_requests import (
    ANSWER_TIMEOUTS_NS,
    FULL_HZ,
    MAX_ROUNDS,
    REPEAT_NS,
    SECOND,
    STEPS_HZ,
    Address,
    LinkRequests,
)
from gateway.links.transmitter import WANTED, Identity
from tests.gateway.links.boats import Autopilot, decoded

BOAT = Address(1, 1)
TWO = {"ATTITUDE": 50.0, "SYSTEM_TIME": 1.0}
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, BUSY = 0, 1, 2, 3, 4, 5


class Play:
    """LinkRequests with a clock: what is said is noted."""

    def __init__(self, rates=TWO, **options):
        self.requests = LinkRequests(Identity(), rates, **options)
        self.now, self.sequence = 0, 0

    def wait(self, seconds):
        self.now += round(seconds * SECOND)

    def due(self):
        """(message, tries) of what is asked, number of heartbeats, answers in words."""
        said = self.requests.due(self.now)
        self.requests = said.requests
        asks = [
            (dialect.mavlink_map[int(m.param1)].msgname, m.confirmation)
            for m in said.messages
            if m.get_type() == "COMMAND_LONG"
        ]
        return asks, len(said.messages) - len(asks), [outcome.text for outcome in said.outcomes]

    def answer(self, result=ACCEPTED, boat=BOAT):
        self.sequence += 1
        self.requests = self.requests.acknowledged(boat, result, self.sequence, self.now)

    def accept_all(self):
        asked = []
        while asks := self.due()[0]:
            asked += asks
            self.answer()
        return asked


@pytest.fixture
def play():
    made = Play()
    made.requests = made.requests.found(BOAT, 0)
    return made


def test_nothing_is_said_before_a_boat_is_heard():
    play = Play()
    assert play.due() == ([], 0, [])
    assert play.requests.next_ns is None


def test_one_after_the_other_with_a_heartbeat_ahead(play):
    said = play.requests.due(0)
    assert [m.get_type() for m in said.messages] == ["HEARTBEAT", "COMMAND_LONG"]
    ask = said.messages[1]
    assert (ask.target_system, ask.target_component, ask.command) == (1, 1, 511)
    assert (ask.param1, ask.param2) == (30, 20_000)
    play.due()
    assert play.due() == ([], 0, [])
    play.answer()
    assert play.due() == ([("SYSTEM_TIME", 0)], 0, ["system 1: ATTITUDE at 50 Hz: accepted"])
    play.answer()
    assert play.due() == ([], 0, ["system 1: SYSTEM_TIME at 1 Hz: accepted"])
    play.wait(1)
    assert play.due() == ([], 1, [])


def test_the_default_table_is_asked_for_whole():
    play = Play(FULL_HZ)
    play.requests = play.requests.found(BOAT, 0)
    assert play.accept_all() == [(name, 0) for name in FULL_HZ]


def test_a_rate_of_zero_is_not_asked_for_nor_missed():
    play = Play({"ATTITUDE": 0.0, "SYSTEM_TIME": 1.0})
    play.requests = play.requests.found(BOAT, 0)
    assert play.accept_all() == [("SYSTEM_TIME", 0)]
    play.now += REPEAT_NS
    play.requests = play.requests.observed(BOAT, {"SYSTEM_TIME": 1.0}, play.now)
    assert play.due()[0] == []
    play.requests = play.requests.rebooted(BOAT, play.now)
    assert play.accept_all() == [("SYSTEM_TIME", 0)]


def test_three_tries_further_and_further_apart_then_no_answer(play):
    for tries, wait in enumerate(ANSWER_TIMEOUTS_NS):
        assert play.due()[0] == [("ATTITUDE", tries)]
        play.now += wait - 1
        assert play.due()[0] == []
        play.now += 1
    asks, _, says = play.due()
    assert asks == [("SYSTEM_TIME", 0)]
    assert says == [
        "system 1: ATTITUDE at 50 Hz: no answer: the link may go one way only (then --silent), or "
        "the boat takes signed frames alone (then --signing-key)"
    ]


def test_why_nothing_answers_is_told_once_also_after_a_reboot(play):
    told = []
    for moment in range(60):
        told += play.due()[2]
        play.wait(1)
        if moment == 30:
            play.requests = play.requests.rebooted(BOAT, play.now)
    assert len(told) == 4
    assert "one way" in told[0]
    assert [line.split(": ")[2:] for line in told[1:]] == [["no answer"]] * 3


def test_a_boat_that_has_answered_before_needs_no_key(play):
    play.due()
    play.answer()
    for wait in ANSWER_TIMEOUTS_NS:
        play.due()
        play.now += wait
    assert play.due()[2] == ["system 1: SYSTEM_TIME at 1 Hz: no answer"]


def test_a_lost_answer_is_asked_for_again(play):
    play.due()
    play.wait(1)
    assert play.due()[0] == [("ATTITUDE", 1)]
    play.answer()
    assert play.due()[0] == [("SYSTEM_TIME", 0)]


def test_a_refusal_is_said_and_the_next_asked(play):
    play.due()
    play.answer(42)
    told = ["system 1: ATTITUDE at 50 Hz: refused with result 42"]
    assert play.due() == ([("SYSTEM_TIME", 0)], 0, told)


def test_answers_of_a_boat_whose_numbers_stand_still_are_no_repeats():
    """It sends 0 in all frames: only its first answer counted, the others were asked for again."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    requests = LinkRequests(Identity(), TWO)
    (beat,) = decoded(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3).pack(mav))
    requests = requests.take(beat, 0)
    for _ in TWO:
        requests = requests.due(0).requests
        mav.seq = 0
        ack = dialect.MAVLink_command_ack_message(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, ACCEPTED)
        (answer,) = decoded(ack.pack(mav))
        requests = requests.take(answer, 0)
    assert [outcome.result for outcome in requests.outcomes] == ["accepted"]
    assert requests.boats[BOAT].pending == ()


@pytest.mark.parametrize("later", [False, True])
def test_a_repeated_answer_is_still_no_answer_to_the_next_request(play, later):
    play.due()
    play.answer()
    if later:
        play.requests = play.requests.rebooted(BOAT, play.now)
        play.due()
        play.answer()
    play.due()
    play.sequence -= 1
    play.answer()  # the same frame once more
    assert play.requests.boats[BOAT].pending == ("SYSTEM_TIME",)


@pytest.mark.parametrize("refusal", [DENIED, UNSUPPORTED, FAILED])
def test_a_rate_that_is_refused_is_stepped_down_until_it_is_taken(play, refusal):
    """PX4 says "failed" of a rate that it cannot have."""
    intervals = []
    for result in (refusal, refusal, ACCEPTED):
        said = play.requests.due(play.now)
        play.requests = said.requests
        intervals += [m.param2 for m in said.messages if m.get_type() == "COMMAND_LONG"]
        assert said.outcomes == ()
        play.answer(result)
    assert intervals == [20_000, 25_000, 40_000]
    assert play.due()[2] == [
        "system 1: ATTITUDE at 25 Hz: accepted, 50 Hz refused: "
        "values are up to 40 ms old instead of 20"
    ]
    play.answer()
    play.now += REPEAT_NS  # 13 Hz are enough of 25 Hz, not of 50
    play.requests = play.requests.observed(BOAT, {"ATTITUDE": 13.0, "SYSTEM_TIME": 1.0}, play.now)
    assert play.due()[0] == []
    play.requests = play.requests.rebooted(BOAT, play.now)
    again = play.requests.due(play.now).messages
    assert [m.param2 for m in again if m.get_type() == "COMMAND_LONG"] == [20_000]


@pytest.mark.parametrize(
    ("refusal", "word"), [(DENIED, "denied"), (UNSUPPORTED, "unsupported"), (FAILED, "failed")]
)
def test_a_boat_that_refuses_every_rate_is_left_at_last(play, refusal, word):
    for _ in range(1 + len(STEPS_HZ)):
        play.due()
        play.answer(refusal)
    assert play.due() == ([("SYSTEM_TIME", 0)], 0, [f"system 1: ATTITUDE at 10 Hz: {word}"])


@pytest.mark.parametrize(
    ("arrives", "says"),
    [
        (1.0, ["not taken, 1 Hz arrive: values are up to 1000 ms old instead of 20"]),
        (49.0, []),  # somebody else has asked for it
        (0.0, []),  # and what it does not have costs no age
    ],
)
def test_what_a_refusal_costs_is_said_once(play, arrives, says):
    for _ in range(1 + len(STEPS_HZ)):
        play.due()
        play.answer(DENIED)
    play.due()
    play.answer()
    play.due()
    play.now += REPEAT_NS
    rates = {"ATTITUDE": arrives, "SYSTEM_TIME": 1.0}
    play.requests = play.requests.observed(BOAT, rates, play.now)
    assert play.due()[2] == [f"system 1: ATTITUDE at 50 Hz: {text}" for text in says]
    play.now += REPEAT_NS
    play.requests = play.requests.observed(BOAT, rates, play.now)
    assert play.due()[2] == []


def parameters_asked(play, seconds):
    """Names of the parameters that are asked for within that time."""
    names = []
    for _ in range(round(10 * seconds)):
        said = play.requests.due(play.now)
        play.requests = said.requests
        asks = [m for m in said.messages if m.get_type() == "PARAM_REQUEST_READ"]
        names += [m.param_id for m in asks]
        play.wait(0.1)
    return names


def take(play, raw):
    """A frame of the boat came."""
    for message in decoded(raw):
        play.requests = play.requests.take(message, play.now)


def test_parameters_are_read_once_behind_the_rates_and_what_is_missing_once_more():
    play, boat = Play(), Autopilot()
    take(play, boat.heartbeat())
    play.due()
    play.answer()
    assert parameters_asked(play, 0.9) == []  # the second rate is not answered yet
    play.answer()
    wanted = WANTED["ArduPilot"]
    assert parameters_asked(play, 1.0) == list(wanted[:5])
    for name in wanted[1:]:
        take(play, boat.frame(dialect.MAVLink_param_value_message(name.encode(), 1.0, 9, 99, 3)))
    assert parameters_asked(play, 100.0) == [wanted[0]]  # the one that was not answered


def test_px4_is_asked_for_what_it_has():
    play, boat = Play({"ATTITUDE": 50.0, "EKF_STATUS_REPORT": 1.0}), Autopilot()
    take(play, boat.frame(dialect.MAVLink_heartbeat_message(11, 12, 0, 0, 4, 3)))
    assert play.accept_all() == [("ATTITUDE", 0), ("ESTIMATOR_STATUS", 0)]
    asked = parameters_asked(play, 100.0)
    assert {"IMU_GYRO_CUTOFF", "PWM_MAIN_FUNC1"} <= set(asked)
    assert not any(name.startswith(("SERVO", "INS_", "GPS")) for name in asked)
    play.requests = play.requests.rebooted(BOAT, play.now)
    assert play.accept_all() == [("ATTITUDE", 0), ("ESTIMATOR_STATUS", 0)]


def test_a_rate_of_px4s_own_name_counts_before_that_of_the_other():
    play = Play({"ESTIMATOR_STATUS": 5.0, "EKF_STATUS_REPORT": 1.0})
    play.requests = play.requests.found(BOAT, 0, "PX4")
    assert play.requests.boats[BOAT].rates_hz == {"ESTIMATOR_STATUS": 5.0}


def test_another_autopilot_and_a_silent_link_are_not_asked_for_parameters():
    play = Play()
    play.requests = play.requests.found(BOAT, 0)
    play.accept_all()
    assert parameters_asked(play, 5.0) == []
    silent = Play()
    silent.requests = LinkRequests(None, TWO)
    take(silent, Autopilot().heartbeat())
    assert silent.requests.due(SECOND).messages == ()


def test_rejected_for_now_is_tried_again_and_remembered(play):
    for tries, wait in enumerate(ANSWER_TIMEOUTS_NS):
        assert play.due()[0] == [("ATTITUDE", tries)]
        play.answer(REJECTED)
        assert play.due()[0] == []
        play.now += wait
    assert play.due()[2] == ["system 1: ATTITUDE at 50 Hz: rejected for now"]


def test_in_progress_gives_it_more_time(play):
    play.due()
    play.wait(0.9)
    play.answer(BUSY)
    play.wait(3.9)
    assert play.due()[0] == []
    play.answer(ACCEPTED)
    assert play.due()[2] == ["system 1: ATTITUDE at 50 Hz: accepted"]


def test_a_repeated_answer_counts_once(play):
    play.due()
    play.answer()
    play.due()
    play.sequence -= 1  # the same frame again
    play.answer(DENIED)
    assert play.due() == ([], 0, [])


def test_an_answer_nobody_asked_for_is_ignored(play):
    play.answer(DENIED)
    play.answer(DENIED, boat=Address(9, 1))
    assert play.due()[2] == []


def test_a_reboot_starts_it_all_again(play):
    play.accept_all()
    play.wait(100)
    play.due()
    play.requests = play.requests.rebooted(BOAT, play.now).rebooted(Address(9, 1), play.now)
    assert play.accept_all() == [("ATTITUDE", 0), ("SYSTEM_TIME", 0)]


def test_another_heartbeat_starts_nothing(play):
    play.accept_all()
    play.requests = play.requests.found(BOAT, play.now)
    assert play.due()[0] == []


def test_what_was_accepted_but_does_not_arrive_is_asked_again(play):
    play.accept_all()
    slow, fast = {"ATTITUDE": 4.0, "SYSTEM_TIME": 1.0}, {"ATTITUDE": 48.0, "SYSTEM_TIME": 1.0}
    play.requests = play.requests.observed(BOAT, slow, play.now)
    assert play.due()[0] == []  # too soon to check
    for _ in range(MAX_ROUNDS):
        play.now += REPEAT_NS
        play.requests = play.requests.observed(BOAT, fast, play.now).observed(BOAT, {}, play.now)
        assert play.due()[0] == []
        play.requests = play.requests.observed(BOAT, slow, play.now)
        assert play.accept_all() == [("ATTITUDE", 0)]


def test_a_link_too_slow_is_said_and_left():
    play = Play()
    play.requests = play.requests.found(BOAT, 0)
    play.accept_all()
    slow = {"ATTITUDE": 4.0, "SYSTEM_TIME": 1.0}
    for _ in range(MAX_ROUNDS):
        play.now += REPEAT_NS
        play.requests = play.requests.observed(BOAT, slow, play.now)
        assert play.accept_all() == [("ATTITUDE", 0)]
    play.now += REPEAT_NS
    play.requests = play.requests.observed(BOAT, slow, play.now)
    asks, _, says = play.due()
    assert (asks, says) == ([], ["system 1: ATTITUDE at 50 Hz: accepted, but 4 Hz arrive"])
    play.now += REPEAT_NS
    play.requests = play.requests.observed(BOAT, slow, play.now)
    assert play.due()[0] == []


def test_a_link_that_recovers_is_not_held_against_the_boat(play):
    play.accept_all()
    slow, fast = {"ATTITUDE": 4.0, "SYSTEM_TIME": 1.0}, {"ATTITUDE": 48.0, "SYSTEM_TIME": 1.0}
    for _ in range(2 * MAX_ROUNDS):
        play.now += REPEAT_NS
        play.requests = play.requests.observed(BOAT, slow, play.now)
        assert play.accept_all() == [("ATTITUDE", 0)]
        play.now += REPEAT_NS
        play.requests = play.requests.observed(BOAT, fast, play.now)


def test_what_was_refused_is_not_asked_again(play):
    for _ in range(1 + len(STEPS_HZ)):
        play.due()
        play.answer(UNSUPPORTED)
    play.due()
    play.answer()
    play.now += REPEAT_NS
    play.requests = play.requests.observed(BOAT, {"SYSTEM_TIME": 1.0}, play.now)
    assert play.due()[0] == []


def test_two_boats_each_have_their_own_conversation():
    play = Play()
    play.requests = play.requests.found(BOAT, 0).found(Address(2, 1), 0)
    asks, heartbeats, _ = play.due()
    assert (len(asks), heartbeats) == (2, 1)
    play.answer(boat=Address(2, 1))
    assert play.due()[2] == ["system 2: ATTITUDE at 50 Hz: accepted"]


def test_the_next_moment_is_known(play):
    play.due()
    assert play.requests.next_ns == SECOND
    play.wait(0.5)
    play.answer()
    assert play.requests.next_ns == play.now
    play.accept_all()
    assert play.requests.next_ns == SECOND  # the heartbeat alone


def test_announcing_sends_heartbeats_alone():
    play = Play(announce=True)
    assert play.due() == ([], 1, [])
    assert play.due() == ([], 0, [])
    play.wait(1)
    assert play.due() == ([], 1, [])


def test_silence_is_silence():
    silent = LinkRequests(None, TWO, announce=True).found(BOAT, 0).rebooted(BOAT, 0)
    assert silent.due(0) == (silent, (), ())
    assert silent.next_ns is None


def one(raw):
    (message,) = decoded(raw)
    return message


def test_messages_of_the_link_are_understood():
    boat = Autopilot()
    requests = LinkRequests(Identity(), TWO).take(one(boat.attitude()), 0)
    assert not requests.boats
    requests = requests.take(one(boat.heartbeat()), 0).due(0).requests
    assert set(requests.boats) == {BOAT}
    for foreign in (boat.ack(system=255), boat.ack(command=400), Autopilot(2).ack()):
        assert not requests.take(one(foreign), 1).outcomes
    assert requests.take(one(boat.ack()), 1).outcomes[0].result == "accepted"
    assert requests.take(one(boat.ack(system=0)), 1).outcomes  # MAVLink 1 names nobody


@pytest.mark.parametrize(("type_", "autopilot"), [(6, 8), (6, 0), (18, 8), (27, 8)])
def test_what_is_no_boat_is_not_asked(type_, autopilot):
    other = Autopilot(7)
    raw = other.frame(dialect.MAVLink_heartbeat_message(type_, autopilot, 0, 0, 4, 3))
    assert not LinkRequests(Identity(), TWO).take(one(raw), 0).boats


@pytest.mark.parametrize("rates", [{"ATITUDE": 50.0}, {"ATTITUDE": -1.0}, {"ATTITUDE": 1e6},
                                   {"ATTITUDE": float("nan")}])  # fmt: skip
def test_wrong_rates_are_refused(rates):
    with pytest.raises(BadInput, match=r"^\[links.rates\] AT"):
        LinkRequests(Identity(), rates)


@pytest.mark.parametrize(
    ("system", "component"), [(255, 191), (0, 191), (256, 1), (1, 0), (1, 256)]
)
def test_an_identity_is_checked(system, component):
    with pytest.raises(BadInput, match=r"own (system|component) id"):
        Identity(system, component)
