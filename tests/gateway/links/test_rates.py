"""What presets ask for, against what lines carry."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.frames import ids_by_name
from gateway.links.rate_requests import FULL_HZ, PRESETS, RADIO_HZ, check_rates

HEADER = 12  # bytes of MAVLink 2 around a payload
LINE = 57600 / 10  # bytes/s of a serial line


def bytes_per_s(rates_hz):
    """At most: payloads whole, though trailing zeros are split_frames off on the wire."""
    sizes = {name: dialect.mavlink_map[ids_by_name()[name]].unpacker.size for name in rates_hz}
    return sum(rate * (sizes[name] + HEADER) for name, rate in rates_hz.items())


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_can_be_asked_for_and_names_every_message(preset):
    check_rates(PRESETS[preset])
    assert PRESETS[preset].keys() == FULL_HZ.keys()  # what one left out, another would leave on


def test_a_radio_keeps_most_of_its_line_for_others():
    assert bytes_per_s(RADIO_HZ) < LINE / 4
    assert bytes_per_s(FULL_HZ) > LINE / 2  # why there is another preset


def test_a_radio_still_brings_commands_fast_enough_to_see_a_lag():
    assert RADIO_HZ["SERVO_OUTPUT_RAW"] > 5.0
    assert min(RADIO_HZ["ATTITUDE"], RADIO_HZ["LOCAL_POSITION_NED"]) >= 5.0
