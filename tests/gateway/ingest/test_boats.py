"""Who in a log is a boat."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.ingest.log import MAX_LISTED, choose_boat, not_a_boat
from tests.gateway.ingest.scripted import ARDUPILOT, Script, attitude, heartbeat


def two_boats_and_their_company() -> Script:
    script = Script()
    for k in range(3):
        script.send(k, heartbeat(), system=1)
        script.send(k, heartbeat(autopilot=dialect.MAV_AUTOPILOT_PX4), system=7)
        script.send(k, heartbeat(autopilot=dialect.MAV_AUTOPILOT_INVALID, type_=6), system=255)
        script.send(k, heartbeat(autopilot=dialect.MAV_AUTOPILOT_INVALID, type_=18), component=191)
        script.send(k, heartbeat(autopilot=ARDUPILOT, type_=dialect.MAV_TYPE_GCS), system=200)
    return script


def test_ground_stations_and_companions_are_no_boats() -> None:
    found = two_boats_and_their_company().log().boats()
    assert [(boat.system, boat.component, boat.autopilot) for boat in found] == [
        (1, 1, "ArduPilot"),
        (7, 1, "PX4"),
    ]
    assert found[0].type == "surface boat"


@pytest.mark.parametrize("number", [19, 20, 21, 22, 23, 24, 25, 47])
def test_an_aircraft_is_called_one_whatever_the_definitions_call_it(number: int) -> None:
    script = Script()
    script.send(0.0, heartbeat(type_=number))
    (boat,) = script.log().boats()
    assert boat.type == "VTOL aircraft"
    assert "says that it is a VTOL aircraft" in not_a_boat(boat)


def test_a_log_of_several_boats_asks_which() -> None:
    log = two_boats_and_their_company().log()
    assert choose_boat(log, 7).system == 7
    with pytest.raises(
        BadInput, match=r"choose one: system 1 \(ArduPilot surface boat\), system 7"
    ):
        choose_boat(log)


def test_of_many_components_of_a_system_one_is_named_and_of_many_systems_the_first_few() -> None:
    script = Script()
    for system in range(1, MAX_LISTED + 4):
        for component in (1, 2, 3):
            script.send(0.0, heartbeat(), system=system, component=component)
    with pytest.raises(BadInput, match=r" and 3 more$") as refused:
        choose_boat(script.log())
    named = str(refused.value).split("choose one: ")[1].removesuffix(" and 3 more").split(", ")
    assert named == [f"system {k} (ArduPilot surface boat)" for k in range(1, MAX_LISTED + 1)]


def test_a_wrong_system_id_is_answered_with_those_present() -> None:
    with pytest.raises(BadInput, match="no boat with system id 3; present: system 1"):
        choose_boat(two_boats_and_their_company().log(), 3)


def test_a_boat_without_heartbeat_is_known_by_its_motion() -> None:
    script = Script()
    script.send(0.0, attitude(1.0), system=4)
    assert choose_boat(script.log()).system == 4


def test_a_log_of_a_ground_station_alone_has_no_boat() -> None:
    script = Script()
    script.send(0.0, heartbeat(autopilot=dialect.MAV_AUTOPILOT_INVALID), system=255)
    with pytest.raises(BadInput, match="no vehicle in it"):
        choose_boat(script.log())
