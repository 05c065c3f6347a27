"""What a played boat answers to a gateway or a ground station, and that it takes no orders."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.simulated_boat.boat import PlayedBoat
from gateway.simulated_boat.faults import Faults, Reboot
from tests.gateway.played.hearing import boat, named

ASKING = 200  # system id of who asks
IDS = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}
SET, GET = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL


def heard(message):
    """As it comes out of a parser on the boat's side."""
    sender = mavlink.MAVLink(None, ASKING, 190)
    return mavlink.MAVLink(None).parse_buffer(message.pack(sender))[0]


def command(number, *values, system=1):
    padded = (*values, *[0.0] * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(system, 1, number, 0, *padded)


def after(request, seconds=10.0, player: PlayedBoat | None = None):
    """What is sent from the request on: 5 s after play began."""
    player = player or boat(parameters=False)
    state, _ = player.advance(player.start(), 5.0)
    return player.advance(player.hear(state, heard(request)), 5.0 + seconds)[1]


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
    assert abs(len(named(frames, name)) - rate * 10.0) <= 1
    (ack,) = named(frames, "COMMAND_ACK")
    assert (ack.command, ack.result) == (SET, mavlink.MAV_RESULT_ACCEPTED)
    assert (ack.target_system, ack.target_component) == (ASKING, 190)


def test_an_unknown_message_is_denied():
    (ack,) = named(after(command(SET, 11001.0, 1e5)), "COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_DENIED


def test_a_reboot_forgets_the_rates_that_were_asked_for():
    player = boat(parameters=False, faults=Faults(reboots=(Reboot(10.0),)))
    frames = after(command(SET, IDS["ATTITUDE"], 20_000.0), 17.0, player)
    before = named([f for f in frames if f.time_s < 10.0], "ATTITUDE")
    again = named([f for f in frames if f.time_s >= 12.0], "ATTITUDE")
    assert abs(len(before) - 250) <= 1
    assert abs(len(again) - 40) <= 1


def test_while_it_boots_it_hears_nothing():
    player = boat(parameters=False, faults=Faults(reboots=(Reboot(4.0, down_s=3.0),)))
    assert not named(after(command(SET, IDS["ATTITUDE"], 20_000.0), 10.0, player), "COMMAND_ACK")


def test_the_interval_in_use_is_told():
    (told,) = named(after(command(GET, IDS["ATTITUDE"])), "MESSAGE_INTERVAL")
    assert (told.message_id, told.interval_us) == (IDS["ATTITUDE"], 250_000)


def test_one_message_is_sent_on_request():
    asked = command(mavlink.MAV_CMD_REQUEST_MESSAGE, IDS["AUTOPILOT_VERSION"])
    (version,) = named(after(asked), "AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 24 == 4
    origin = command(mavlink.MAV_CMD_REQUEST_MESSAGE, IDS["GPS_GLOBAL_ORIGIN"])
    assert named(after(origin, 0.1), "GPS_GLOBAL_ORIGIN")


def test_data_streams_as_older_ground_stations_ask_for_them():
    asked = mavlink.MAVLink_request_data_stream_message(1, 1, 6, 20, 1)
    assert abs(len(named(after(asked), "LOCAL_POSITION_NED")) - 200) <= 1


def test_parameters_are_listed_once_each_and_read_one_by_one():
    frames = after(mavlink.MAVLink_param_request_list_message(1, 1))
    told = named(frames, "PARAM_VALUE")
    assert [m.param_index for m in told] == list(range(told[0].param_count))
    for index, name in ((-1, b"SERVO2_FUNCTION"), (3, b"")):
        asked = mavlink.MAVLink_param_request_read_message(1, 1, name, index)
        (value,) = named(after(asked), "PARAM_VALUE")
        assert value.param_id == (name.decode() or told[3].param_id)


def test_it_takes_no_orders():
    quiet = after(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    disarm = command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
    frames = after(disarm)
    (ack,) = named(frames, "COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_UNSUPPORTED
    assert [m.to_dict() for m in named(frames, "HEARTBEAT")] == [
        m.to_dict() for m in named(quiet, "HEARTBEAT")
    ]


def test_what_is_meant_for_another_boat_is_left_alone():
    asked = command(SET, IDS["ATTITUDE"], 20_000.0, system=7)
    assert not named(after(asked), "COMMAND_ACK")
