"""What a simulated boat answers to a gateway or a ground station; it obeys no command."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.simulated_boat import Faults, Reboot
from gateway.simulated_boat.boat import SimulatedBoat
from tests.gateway.simulated_boat.frames import messages_named, simulated_boat

ASKING = 200  # system id of the sender of requests
IDS = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}
SET, GET = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL


def received(message):
    """As it comes out of a parser on the boat's side."""
    sender = mavlink.MAVLink(None, ASKING, 190)
    return mavlink.MAVLink(None).parse_buffer(message.pack(sender))[0]


def command(number, *values, system=1):
    padded = (*values, *[0.0] * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(system, 1, number, 0, *padded)


def after(request, seconds=10.0, boat: SimulatedBoat | None = None):
    """What is sent from the request on: 5 s after the start."""
    boat = boat or simulated_boat(parameters=False)
    state, _ = boat.advance(boat.start(), 5.0)
    return boat.advance(boat.receive(state, received(request)), 5.0 + seconds)[1]


@pytest.mark.parametrize(
    ("name", "interval_us", "rate"),
    [
        ("ATTITUDE", 20_000.0, 50.0),
        ("SERVO_OUTPUT_RAW", 40_000.0, 25.0),
        ("AUTOPILOT_VERSION", 500_000.0, 2.0),  # a stream that was not there
        ("ATTITUDE", -1.0, 0.0),
        ("RAW_IMU", 0.0, 2.0),  # the default
    ],
)
def test_set_message_interval_is_obeyed_and_acknowledged(name, interval_us, rate):
    frames = after(command(SET, IDS[name], interval_us))
    assert abs(len(messages_named(frames, name)) - rate * 10.0) <= 1
    (ack,) = messages_named(frames, "COMMAND_ACK")
    assert (ack.command, ack.result) == (SET, mavlink.MAV_RESULT_ACCEPTED)
    assert (ack.target_system, ack.target_component) == (ASKING, 190)


def test_an_unknown_message_is_denied():
    (ack,) = messages_named(after(command(SET, 11001.0, 1e5)), "COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_DENIED


def test_a_reboot_forgets_the_rates_that_were_asked_for():
    boat = simulated_boat(parameters=False, faults=Faults(reboots=(Reboot(10.0),)))
    frames = after(command(SET, IDS["ATTITUDE"], 20_000.0), 17.0, boat)
    before = messages_named([f for f in frames if f.time_s < 10.0], "ATTITUDE")
    again = messages_named([f for f in frames if f.time_s >= 12.0], "ATTITUDE")
    assert abs(len(before) - 250) <= 1
    assert abs(len(again) - 40) <= 1


def test_requests_while_it_boots_are_lost():
    boat = simulated_boat(parameters=False, faults=Faults(reboots=(Reboot(4.0, down_s=3.0),)))
    assert not messages_named(
        after(command(SET, IDS["ATTITUDE"], 20_000.0), 10.0, boat), "COMMAND_ACK"
    )


def test_the_interval_in_use_is_reported():
    (answer,) = messages_named(after(command(GET, IDS["ATTITUDE"])), "MESSAGE_INTERVAL")
    assert (answer.message_id, answer.interval_us) == (IDS["ATTITUDE"], 250_000)


def test_one_message_is_sent_on_request():
    asked = command(mavlink.MAV_CMD_REQUEST_MESSAGE, IDS["AUTOPILOT_VERSION"])
    (version,) = messages_named(after(asked), "AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 24 == 4
    origin = command(mavlink.MAV_CMD_REQUEST_MESSAGE, IDS["GPS_GLOBAL_ORIGIN"])
    assert messages_named(after(origin, 0.1), "GPS_GLOBAL_ORIGIN")


def test_data_streams_as_older_ground_stations_ask_for_them():
    asked = mavlink.MAVLink_request_data_stream_message(1, 1, 6, 20, 1)
    assert abs(len(messages_named(after(asked), "LOCAL_POSITION_NED")) - 200) <= 1


def test_parameters_are_listed_once_each_and_read_one_by_one():
    frames = after(mavlink.MAVLink_param_request_list_message(1, 1))
    sent = messages_named(frames, "PARAM_VALUE")
    assert [m.param_index for m in sent] == list(range(sent[0].param_count))
    for index, name in ((-1, b"SERVO2_FUNCTION"), (3, b"")):
        asked = mavlink.MAVLink_param_request_read_message(1, 1, name, index)
        (value,) = messages_named(after(asked), "PARAM_VALUE")
        assert value.param_id == (name.decode() or sent[3].param_id)


def test_any_other_command_is_refused():
    quiet = after(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    disarm = command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
    frames = after(disarm)
    (ack,) = messages_named(frames, "COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_UNSUPPORTED
    assert [m.to_dict() for m in messages_named(frames, "HEARTBEAT")] == [
        m.to_dict() for m in messages_named(quiet, "HEARTBEAT")
    ]


def test_what_is_meant_for_another_boat_is_left_alone():
    asked = command(SET, IDS["ATTITUDE"], 20_000.0, system=7)
    assert not messages_named(after(asked), "COMMAND_ACK")
