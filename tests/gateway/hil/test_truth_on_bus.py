"""The truth of a boat in the loop, beside its shadow on the bus, for people who watch."""

import pytest

from gateway.bus import Bus, BusSettings
from gateway.hil.run import LoopOptions, LoopPlan
from gateway.monitor import VesselSubscriber, join_bus
from gateway.vessel_file import load_vessel
from tests.gateway.hil.firmware import StandIn, free_port, looping
from tests.gateway.monitor.statuses import free_endpoint, wait
from tests.gateway.test_schemas import some_message

OTTER = load_vessel("otter")


@pytest.fixture
def plan():
    return LoopPlan(f"json:127.0.0.1:{free_port()}", "otter", OTTER)


def test_it_is_beside_the_shadow_and_gives_no_silent_boat_a_life(plan):
    endpoint = free_endpoint()
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        wait(lambda: join_bus(endpoint, None)) as session,
        VesselSubscriber(session) as subscriber,
        looping([plan], LoopOptions(bus=endpoint)),
    ):
        firmware = StandIn(int(plan.endpoint.rpartition(":")[2]), rate=50)

        def told():
            values = firmware.sail({1: 1700, 3: 1700}, 0.2)
            found = [s for s in subscriber.statuses() if s.message("truth")]
            return found and (found[0], values)

        status, values = wait(told)
        assert status.name == "otter"
        truth = status.message("truth")
        assert 0.0 < truth["north_m"] <= values["position"][0]
        assert truth["surge_mps"] <= values["velocity"][0]
        assert status.silent_s == float("inf")  # nothing of the shadow came
        bus.publish("shadow", some_message("shadow"))
        wait(lambda: subscriber.statuses()[0].message("shadow"))
        assert subscriber.statuses()[0].message("truth")
        firmware.close()


def test_without_a_gateway_the_loop_runs_on_and_no_boat_is_invented(plan):
    endpoint = free_endpoint()
    with looping([plan], LoopOptions(bus=endpoint)) as running:
        firmware = StandIn(int(plan.endpoint.rpartition(":")[2]), rate=50)
        firmware.sail({1: 1700, 3: 1700}, 1.0)
        with (
            Bus("other", settings=BusSettings(endpoint)),
            wait(lambda: join_bus(endpoint, None)) as session,
            VesselSubscriber(session) as subscriber,
        ):
            came = []
            listening = session.declare_subscriber("shadow/otter/truth", came.append)
            wait(lambda: firmware.sail({1: 1700, 3: 1700}, 0.2) and came)
            listening.undeclare()
            assert [s.name for s in subscriber.statuses()] == ["other"]
        firmware.close()
    assert not running.errors
