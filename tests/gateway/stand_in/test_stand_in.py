"""The stand-in: it steers, and its log is what a radio would have heard of that boat."""

import math

import numpy as np
import pytest

from gateway import stand_in
from gateway.errors import ShadowError
from gateway.hil.run import LoopOptions, LoopPlan
from gateway.offline.compare import compare_logs
from gateway.simulated_boat.play import tlog_bytes
from gateway.stand_in import JsonClient, MissionPilot, PlanPilot, StandIn, parse_reply
from gateway.vessel_file import load_vessel
from sim.excitation import StickLimits, plan_of
from sim.excitation.catalogue import BY_NAME
from sim.model import Model
from tests.gateway.hil.firmware import free_port, looping

REPLY = (
    b'\n{"timestamp":1.5,"imu":{"gyro":[0,0,0.1],"accel_body":[1,2,-9.8]},"position":[3,4,0],'
    b'"attitude":[0,0,0.5],"velocity":[1,0,0],"battery":{"voltage":15,"current":1}}\n'
)


def read_at(north: float, east: float, yaw: float, yaw_rate: float = 0.0):
    return parse_reply(REPLY)._replace(
        position=(north, east, 0.0), attitude=(0.0, 0.0, yaw), gyro=(0.0, 0.0, yaw_rate)
    )


@pytest.fixture(scope="module")
def otter():
    return load_vessel("otter")


@pytest.fixture
def sail(otter):
    """A pilot -> the frames that the stand-in sends while it drives the Otter in the loop."""

    def work(pilot, longest_s=300.0, **options):
        port = free_port()
        with looping([LoopPlan(f"json:127.0.0.1:{port}", "ferry", otter)], LoopOptions()):
            return StandIn(otter).drive(f"127.0.0.1:{port}", pilot, longest_s, **options)

    return work


def test_a_reply_is_read_or_refused():
    found = parse_reply(REPLY)
    assert (found.time, found.accel, found.attitude[2]) == (1.5, (1.0, 2.0, -9.8), 0.5)
    for wrong in (b"", b"{}", b"[1]", REPLY.replace(b"gyro", b"gyr"), REPLY.replace(b"15,", b"x,")):
        with pytest.raises(ValueError, match="no line of readings"):
            parse_reply(wrong)


def test_a_mission_steers_towards_the_waypoint_and_ends():
    pilot = MissionPilot([(10.0, 0.0), (10.0, 10.0)], throttle=0.5)
    assert pilot.sticks(0.0, read_at(0.0, 0.0, 0.0)) == (0.5, 0.0)
    assert pilot.sticks(0.0, read_at(0.0, 0.0, -0.2))[1] > 0.0, "the waypoint lies to starboard"
    turning = pilot.sticks(0.0, read_at(0.0, 0.0, -0.2, yaw_rate=0.2))[1]
    assert turning < pilot.sticks(0.0, read_at(0.0, 0.0, -0.2))[1], "it turns there already"
    assert pilot.sticks(0.0, read_at(0.0, 0.0, math.pi))[0] == 0.0, "it points away"
    next_leg = pilot.sticks(0.0, read_at(9.0, 0.0, math.pi / 2))
    assert next_leg == pytest.approx((0.5, 0.0), abs=0.1), "the first one is reached"
    assert pilot.sticks(0.0, read_at(10.0, 9.0, 0.0)) is None


@pytest.mark.slow
def test_a_square_is_sailed_in_the_loop(sail):
    tracks = []

    class Watched(MissionPilot):
        def sticks(self, seconds, read):
            tracks.append(read.position[:2])
            return super().sticks(seconds, read)

    corners = [(20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)]
    frames = sail(Watched(corners, 0.5))
    assert 60.0 < frames[-1].time_s < 200.0
    for corner in corners:
        assert np.hypot(*(np.array(tracks) - corner).T).min() < 2.0


@pytest.mark.slow
def test_its_log_is_that_of_the_boat_in_the_loop(sail, otter, tmp_path):
    """A model that is right is no further from it than noise; one that is wrong is."""
    from dataclasses import replace

    plan = plan_of(BY_NAME["steps"], Model.of(otter), StickLimits(throttle=0.7), 0)
    frames = sail(PlanPilot(plan))
    assert frames[-1].time_s == pytest.approx(plan.seconds + 6.0, abs=0.5)
    (tmp_path / "steps.tlog").write_bytes(tlog_bytes(frames, 1.7e9))
    wrong = replace(otter, dynamics=replace(otter.dynamics, X_u=4.0 * otter.dynamics.X_u))
    right, far = compare_logs([tmp_path / "steps.tlog"], [otter, wrong])
    assert right.nrmse < 1.2 * right.noise_floor_nrmse < far.nrmse


def test_a_boat_that_is_not_there_is_one_line(monkeypatch):
    monkeypatch.setattr(stand_in, "REPLY_S", 0.01)
    address = f"127.0.0.1:{free_port()}"
    with JsonClient(address, 50) as client, pytest.raises(ShadowError, match="run shadow hil"):
        client.frame({1: 1500})


def test_a_boat_that_falls_silent_is_not_told_as_one_that_never_was(otter, monkeypatch):
    address = f"127.0.0.1:{free_port()}"
    with JsonClient(address, 50) as client:
        with looping([LoopPlan(f"json:{address}", "ferry", otter)]):
            client.frame({})
        monkeypatch.setattr(stand_in, "REPLY_S", 0.02)
        with pytest.raises(ShadowError, match=r"answers no more.*start shadow hil again"):
            client.frame({})
