"""ArduPilot's JSON interface, held against a stand-in that asks and reads as the firmware does."""

import math
import re
import time
from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from gateway import hil
from gateway.errors import BadInput, ShadowError
from gateway.hil import hearing
from gateway.hil.ardupilot_json import JsonSession, MalformedPacket, parse_packet, reply
from gateway.hil.run import LoopOptions, LoopPlan, plans_of, protocol_of
from gateway.links.transports import UdpTransport
from gateway.recording.reader import Recording
from gateway.vessel_file import load_vessel
from sim.hil import Readings
from sim.hil.boat import Boat
from sim.hil.day import Day, Moment, Wind
from tests.gateway.hil.firmware import StandIn, free_port, looping, packet, parsed, wait_for

OTTER = load_vessel("otter")
NEUTRAL = {1: 1500, 3: 1500}
AHEAD = {1: 1800, 3: 1800}


@pytest.fixture
def plan():
    return LoopPlan(f"json:127.0.0.1:{free_port()}", "otter", OTTER)


@pytest.fixture
def stand_in():
    """Makes stand-ins, and closes them."""
    made = []

    def make(plan, **options):
        made.append(StandIn(port_of(plan), **options))
        return made[-1]

    yield make
    for firmware in made:
        firmware.close()


def port_of(plan):
    return int(plan.endpoint.rpartition(":")[2])


def readings(**changed):
    still = (0.0, 0.0, 0.0)
    plain = Readings(
        1.5, still, (0.0, 0.0, -9.8), still, (1.0, 2.0, 3.0), still, None, None, 12.5, 3.0, None
    )
    return plain._replace(**changed)


def test_a_packet_of_16_and_of_32_pulses():
    for outputs in (16, 32):
        pulses = tuple(range(1100, 1100 + outputs))
        assert parse_packet(packet(7, pulses, 1200)) == (1200, 7, pulses)


@pytest.mark.parametrize(
    ("data", "wrong"),
    [
        (b"", "0 bytes"),
        (b"\x1a", "1 bytes"),
        (packet(0, [1500] * 16, magic=18459), "magic 18459"),
        (packet(0, [1500] * 16, magic=29569), "40 bytes with magic 29569"),
        (packet(0, [1500] * 16) + b"\0", "41 bytes"),
        (packet(0, [1500] * 16, rate=0), "frame rate of 0"),
        (b"GET / HTTP/1.1\r\n\r\n", "magic"),
    ],
)
def test_what_is_no_packet_is_refused_with_a_reason(data, wrong):
    with pytest.raises(MalformedPacket, match=wrong):
        parse_packet(data)


def test_a_reply_reads_as_the_firmware_reads_it():
    air = readings(wind=(3.0, -4.0), vane=(0.5, 6.0), depth=8.25)
    values = parsed(reply(air))
    assert values["timestamp"] == (1.5,)
    assert values["accel_body"] == (0.0, 0.0, -9.8)
    assert values["velocity"] == (1.0, 2.0, 3.0), "not that of the wind, though its key begins so"
    assert values["velocity_wind"] == (3.0, -4.0, 0.0)
    assert (values["direction"], values["speed"]) == ((0.5,), (6.0,))
    assert (values["voltage"], values["current"], values["rng_1"]) == ((12.5,), (3.0,), (8.25,))
    assert b": " not in reply(air), "the firmware does not skip a space"
    assert not {"velocity_wind", "direction", "rng_1"} & parsed(reply(readings())).keys()


def test_the_stand_in_is_as_strict_as_the_firmware():
    with pytest.raises(AssertionError):
        parsed(reply(readings())[1:])
    assert "gyro" not in parsed(b'\n{"imu":{"gyro": [1,2,3]}}\n')
    swapped = parsed(b'\n{"velocity_wind":[9,9,9],"velocity":[1,2,3]}\n')
    assert "velocity" not in swapped


def test_lock_step_goes_by_the_rate_that_is_asked_for(plan, stand_in):
    with looping([plan]):
        firmware = stand_in(plan, rate=1200)
        at = 0.0
        for rate in (1200, 400, 50, 1, 400):
            firmware.rate = rate
            time = firmware.frame(AHEAD)["timestamp"][0]
            assert time - at == pytest.approx(1.0 / rate)
            at = time
        assert firmware.sail(AHEAD, 5.0)["velocity"][0] > 0.5


def test_a_repeated_count_gets_the_same_answer_and_no_step(plan, stand_in):
    with looping([plan]) as running:
        firmware = stand_in(plan)
        firmware.sail(AHEAD, 1.0)
        before = firmware.last
        again = firmware.frame(AHEAD, count=firmware.count - 1)
        assert firmware.last == before
        assert firmware.frame(AHEAD)["timestamp"][0] == pytest.approx(
            again["timestamp"][0] + 1 / 400
        )
    assert running.said("asked again")
    assert "1 repeated" in running.lines[-1]


def test_count_0_is_a_restart_and_the_boat_starts_anew(plan, stand_in):
    with looping([plan]) as running:
        first = stand_in(plan)
        assert first.sail(AHEAD, 4.0)["position"][0] > 0.5
        first.close()
        second = stand_in(plan)
        values = second.frame(NEUTRAL)
        assert values["timestamp"][0] == pytest.approx(1 / 400)
        assert values["position"] == (0.0, 0.0, 0.0)
    assert running.said("has restarted")
    assert running.loops[0].played.restarts == 1
    assert not running.said("speaks as well")


def test_a_second_firmware_on_one_port_neither_moves_nor_resets_the_boat(plan, stand_in):
    """Two programs were started for one port: the first sails on, until it has fallen silent."""
    with looping([plan]) as running:
        first, second = stand_in(plan), stand_in(plan)
        at = first.sail(AHEAD, 1.0)["timestamp"][0]
        for count in (0, 7):
            second.send(packet(count, [2000] * 16))
            with pytest.raises(TimeoutError):
                second.receive(0.2)
            at += 1 / 400
            assert first.frame(AHEAD)["timestamp"][0] == pytest.approx(at)
        assert second.frame(NEUTRAL, count=0)["timestamp"][0] == pytest.approx(1 / 400)
    assert running.said("speaks as well: one firmware for each endpoint")
    assert len(running.said("has restarted")) == running.loops[0].played.restarts == 1


def test_firmware_that_runs_already_is_taken_as_it_is(plan, stand_in):
    """The gateway was restarted: the count is high, and goes on."""
    with looping([plan]) as running:
        firmware = stand_in(plan)
        firmware.count = 5000
        assert firmware.sail(AHEAD, 2.0)["timestamp"][0] == pytest.approx(2.0)
    (line,) = running.said("frame 5000")
    assert "the boat begins anew at its start, since where it was is not kept with --no-rec" in line
    assert line.endswith("will not follow a boat that jumps: restart the firmware")
    assert not running.said("restarted")


def test_a_firmware_that_has_just_started_is_not_asked_to_restart(plan, stand_in):
    with looping([plan]) as running:
        stand_in(plan).frame(AHEAD)
    assert running.said("the firmware is there, frame 0")[0].endswith("frame 0")


def test_a_boat_goes_on_where_its_program_ended(plan, stand_in, tmp_path):
    """Firmware waits while `shadow hil` is started again: nothing may jump."""
    options = LoopOptions(out=tmp_path)
    with looping([plan], options):
        firmware = stand_in(plan)
        before = firmware.sail(AHEAD, 4.0)
    with looping([plan], options) as running:
        after = firmware.frame(AHEAD)
        assert after["timestamp"][0] == pytest.approx(before["timestamp"][0] + 1 / 400)
        for name, size in (("position", 0.02), ("velocity", 0.01), ("attitude", 0.01)):
            assert after[name] == pytest.approx(before[name], abs=size)
        assert after["position"][0] > 0.5
        more = firmware.sail(AHEAD, 1.0)
        assert more["position"][0] > after["position"][0]
    assert running.said("the boat goes on where it was")
    times = Recording.open(running.loops[0].recording.paths[0]).columns("truth/otter")
    assert (np.diff(times["vehicle_time_ns"]) > 0).all()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("frame", "ends at frame 799"),
        ("seed", "is of another vessel, day or seed"),
        ("vessel", "is of another vessel, day or seed"),
        ("folder", "holds no earlier boat"),
    ],
)
def test_it_goes_on_for_no_other_frame_seed_or_vessel(plan, stand_in, tmp_path, change, reason):
    with looping([plan], LoopOptions(out=tmp_path)):
        firmware = stand_in(plan)
        firmware.sail(AHEAD, 2.0)
    seed = 1 if change == "seed" else 0
    if change == "vessel":
        plan = replace(plan, vessel=replace(OTTER, hull=replace(OTTER.hull, beam=1.2)))
    if change == "frame":
        firmware.count += 1
    out = tmp_path / "other" if change == "folder" else tmp_path
    with looping([plan], LoopOptions(out=out, seed=seed)) as running:
        assert firmware.frame(AHEAD)["position"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)
    assert not running.said("goes on where it was")
    (line,) = running.said("begins anew at its start")
    assert f"otter-hil.state {reason}. The firmware's filter will not follow" in line


def test_lost_and_late_frames_are_noticed(plan, stand_in):
    with looping([plan]) as running:
        firmware = stand_in(plan)
        firmware.sail(NEUTRAL, 0.1)
        firmware.frame(NEUTRAL, count=firmware.count + 3)
        time = firmware.frame(NEUTRAL)["timestamp"][0]
        firmware.send(packet(5, [1500] * 16))
        with pytest.raises(TimeoutError):
            firmware.receive(0.3)
        assert firmware.frame(NEUTRAL)["timestamp"][0] == pytest.approx(time + 1 / 400)
    assert running.said("3 frames of the firmware were lost")
    assert "1 gap, 1 late" in running.lines[-1]


def test_malformed_packets_are_survived_each_kind_one_line(plan, stand_in):
    with looping([plan]) as running:
        firmware = stand_in(plan)
        firmware.frame(NEUTRAL)
        for junk in (b"", b"x", packet(1, [1500] * 16, magic=1), packet(1, [0] * 16) * 2):
            firmware.send(junk)
            with pytest.raises(TimeoutError):
                firmware.receive(0.1)
        assert firmware.sail(AHEAD, 3.0)["velocity"][0] > 0.3
    assert len(running.said("passed over")) == 1, "what repeats is not said each time"
    assert "4 malformed" in running.lines[-1]


@pytest.mark.parametrize("dead", [0, 65535])
def test_no_pulse_is_no_thrust(plan, dead, stand_in):
    with looping([plan]):
        firmware = stand_in(plan)
        assert firmware.sail({1: dead, 3: dead}, 2.0)["velocity"] == (0.0, 0.0, 0.0)


def test_absurd_pulses_are_said_once_and_do_no_harm(plan, stand_in):
    with looping([plan]) as running:
        firmware = stand_in(plan)
        speed = firmware.sail({1: 60000, 3: 60000, 5: 60000}, 3.0)["velocity"][0]
    full = Boat.of(OTTER)
    state = full.start()
    for _ in range(1200):
        state, expected, _ = full.step(state, {1: 2000.0, 3: 2000.0}, 1 / 400)
    assert speed == pytest.approx(expected.velocity[0], rel=1e-3)
    assert len(running.said("60000 µs on output 1")) == 1
    assert not running.said("output 5"), "the vessel knows nothing of it"


def test_an_output_that_the_vessel_does_not_have_is_said_once(plan, stand_in):
    with looping([plan]) as running:
        firmware = stand_in(plan)
        for k in range(200):
            firmware.frame({1: 1500, 3: 1500, 4: 1500 + k})
    assert len(running.said("drives output 4, where the vessel has nothing: it has 1 (left)")) == 1


def test_an_output_that_the_firmware_does_not_drive_is_said_once(plan, stand_in):
    """Real firmware sends 1500 on all outputs at first, later nothing where it has no function."""
    with looping([plan]) as running:
        firmware = stand_in(plan, rate=50)
        firmware.sail(dict.fromkeys(range(1, 17), 1500), 0.5)
        firmware.sail({1: 1600}, 21.0)
    assert len(running.said("output 3 (right) gets no pulses: set SERVO3_FUNCTION")) == 1
    assert not running.said("output 1 (left) gets no pulses")


@pytest.mark.parametrize(("first", "lines"), [(0, 1), (5000, 0)])
def test_an_output_that_never_moves_is_said_of_firmware_from_its_start_on(
    plan, stand_in, first, lines
):
    with looping([plan]) as running:
        firmware = stand_in(plan, rate=50)
        firmware.count = first
        firmware.sail({1: 1500, 3: 1000}, 20.0)
        for k in range(600):
            firmware.frame({1: 1500 + k % 100, 3: 1000})
    assert len(running.said("output 3 (right) has held 1000 µs")) == lines


def test_a_silence_is_said_once_and_again_only_after_the_firmware_was_heard(
    plan, stand_in, monkeypatch
):
    monkeypatch.setattr(hearing, "SILENT_S", 0.05)
    monkeypatch.setattr(hil, "QUIET_S", 0.0)
    monkeypatch.setattr(JsonSession, "wait_s", lambda self, now: 0.01)
    with looping([plan]) as running:
        firmware = stand_in(plan, rate=50)
        firmware.frame(NEUTRAL)
        assert wait_for(lambda: running.said("is silent for"))
        time.sleep(0.3)
        assert len(running.said("is silent for")) == 1
        firmware.frame(NEUTRAL)
        assert wait_for(lambda: len(running.said("is silent for")) == 2)


def test_a_program_that_was_itself_stopped_does_not_call_the_autopilot_silent(
    plan, stand_in, monkeypatch
):
    """As after SIGSTOP, or when the machine slept: the wait ends late and nothing has come."""
    monkeypatch.setattr(hearing, "SILENT_S", 0.6)
    monkeypatch.setattr(hearing, "HELD_UP_S", 0.6)
    monkeypatch.setattr(JsonSession, "wait_s", lambda self, now: 0.01)
    receive, stopped = UdpTransport.receive, Event()

    def held_up(transport, seconds):
        arrivals = receive(transport, seconds)
        if not arrivals and stopped.is_set():
            stopped.clear()
            time.sleep(1.5)
        return arrivals

    monkeypatch.setattr(UdpTransport, "receive", held_up)
    with looping([plan]) as running:
        firmware = stand_in(plan, rate=50)
        firmware.frame(NEUTRAL)
        stopped.set()
        assert wait_for(lambda: running.said("this program itself was stopped or kept waiting for"))
        firmware.frame(NEUTRAL)
        assert not running.said("is silent for")
        assert wait_for(lambda: running.said("is silent for 1 s")), "now it is"


def test_firmware_that_does_not_call_may_wait_for_a_ground_station(plan, stand_in, monkeypatch):
    monkeypatch.setattr("gateway.hil.hearing.SILENT_S", 0.3)
    with looping([plan]) as running:
        assert wait_for(lambda: running.said("no ArduPilot has called yet"))
        stand_in(plan).sail(NEUTRAL, 0.5)
        assert wait_for(lambda: running.said("is silent for"))
    assert len(running.said("waits for a ground station")) == 1
    with looping([plan]) as running:
        firmware, end = stand_in(plan), time.monotonic() + 1.0
        while time.monotonic() < end:
            firmware.frame(NEUTRAL)
    assert not running.said("waits for a ground station")


@pytest.mark.slow
def test_it_sails_a_square_to_places(plan, stand_in):
    with looping([plan]) as running:
        firmware = stand_in(plan, rate=100)
        for place in ((20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)):
            assert firmware.go_to(*place, seconds=90.0), place
    assert "restarts" not in running.lines[-1]
    p50, p99 = map(int, re.findall(r"after (\d+) µs \(p99 (\d+)\)", running.lines[-1])[0])
    assert 0 < p50 <= p99 < 1_000_000


def test_several_boats_on_several_ports_do_not_mix(stand_in):
    plans = [LoopPlan(f"json:127.0.0.1:{free_port()}", name, OTTER) for name in ("one", "two")]
    with looping(plans) as running:
        one, two = (stand_in(plan) for plan in plans)
        for _ in range(800):
            ahead, astern = one.frame(AHEAD), two.frame({1: 1200, 3: 1200})
        assert ahead["position"][0] > 0.1
        assert astern["position"][0] < -0.1
    assert {line.partition(":")[0] for line in running.lines} == {"one", "two"}


def test_a_boat_that_ends_says_so_at_once_and_the_others_go_on(stand_in, monkeypatch):
    plans = [LoopPlan(f"json:127.0.0.1:{free_port()}", name, OTTER) for name in ("one", "two")]
    step = Boat.step

    def breaking(boat, state, pulses, dt):
        if pulses.get(1) == 1999:
            raise ArithmeticError("the hull has gone")
        return step(boat, state, pulses, dt)

    monkeypatch.setattr(Boat, "step", breaking)
    said = []

    def scene():
        with looping(plans) as running:
            one, two = (stand_in(plan) for plan in plans)
            for firmware in (one, two):
                firmware.frame(AHEAD)
            assert not running.said("ended")
            one.send(packet(1, [1999] + [1500] * 15))
            assert wait_for(lambda: running.said("ended"))
            assert two.frame(AHEAD)["timestamp"][0] > 0.0
            said.extend(running.said("ended"))

    with pytest.raises(ShadowError, match=r"^one: the hull has gone$"):
        scene()
    assert said == ["one: it has ended: the hull has gone"]


def test_two_runs_of_one_seed_are_the_same_byte_for_byte(plan, stand_in):
    def track(seed):
        with looping([plan], LoopOptions(seed=seed, day=Day(wind=Wind(5.0, 1.0)))):
            firmware = stand_in(plan)
            out = []
            for _ in range(50):
                firmware.frame(AHEAD)
                out.append(firmware.last)
            return out

    noisy = replace(OTTER, sensors=replace(OTTER.sensors, gyro_noise=1e-3))
    plan = replace(plan, vessel=noisy)
    assert track(1) == track(1)
    assert track(1) != track(2)


def test_a_motor_fails_at_its_moment(plan, stand_in):
    day = Day(moments=(Moment(at=3.0, thruster="left", gain=0.0),))
    with looping([plan], LoopOptions(day=day)):
        firmware = stand_in(plan)
        assert abs(firmware.sail(AHEAD, 2.9)["gyro"][2]) < 1e-6
        assert firmware.sail(AHEAD, 1.0)["gyro"][2] < -0.1, "the right one turns it to port"


def test_a_port_that_is_taken_is_one_line(plan):
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port_of(plan)))
        told = r"cannot listen there: .*; another program has the port: end that one"
        with pytest.raises(ShadowError, match=told), looping([plan]):
            pass


def test_boats_that_cannot_begin_leave_no_files(plan, tmp_path):
    """One of two has no port: neither waits for anybody, and nothing was recorded."""
    import socket

    other = replace(plan, endpoint=f"json:127.0.0.1:{free_port()}", name="other")
    out = LoopOptions(out=tmp_path / "out")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port_of(plan)))
        with pytest.raises(ShadowError, match="cannot listen there"), looping([other, plan], out):
            pass
    assert not (tmp_path / "out").exists()


def test_two_programs_of_one_name_in_one_folder_do_not_share_a_boat(
    plan, stand_in, tmp_path, monkeypatch
):
    """Either would go on where the other's boat was."""
    monkeypatch.setattr("gateway.hil.RELEASE_S", 0.0)
    options = LoopOptions(out=tmp_path)
    other = replace(plan, endpoint=f"json:127.0.0.1:{free_port()}")
    with looping([plan], options):
        before = stand_in(plan).sail(AHEAD, 2.0)
        there = sorted(tmp_path.iterdir())
        with pytest.raises(BadInput, match="--vessel NAME=FILE"), looping([other], options):
            pass
        assert sorted(tmp_path.iterdir()) == there
    with looping([replace(other, name="another")], options), looping([plan], options):
        firmware = stand_in(plan)
        firmware.count = 800
        assert firmware.frame(AHEAD)["position"] == pytest.approx(before["position"], abs=0.02)


@pytest.mark.parametrize(
    ("endpoint", "wrong"),
    [
        ("udpin:127.0.0.1:9002", "not an endpoint of an autopilot; expected json:HOST:PORT"),
        ("json:127.0.0.1", "host or port is missing"),
        ("json:127.0.0.1:port", 'the port "port" is no positive number'),
        ("json:127.0.0.1:99999", "there is no port 99999"),
    ],
)
def test_an_endpoint_that_is_none(endpoint, wrong):
    with pytest.raises(BadInput, match=wrong):
        protocol_of(endpoint)


def test_plans_need_a_vessel_for_each_endpoint_and_names_of_their_own():
    ends = ["json:127.0.0.1:9002", "json:127.0.0.1:9012"]
    load = lambda file: load_vessel(file)  # noqa: E731
    assert [p.name for p in plans_of(ends, ["a=otter", "b=otter"], load)] == ["a", "b"]
    assert plans_of(ends[:1], ["otter"], load)[0].name == "otter"
    for wrong, ends_given, vessels in (
        ("2 endpoints and 1 vessels", ends, ["otter"]),
        ("two boats of one name", ends, ["otter", "otter"]),
        ("given twice", ends[:1] * 2, ["a=otter", "b=otter"]),
    ):
        with pytest.raises(BadInput, match=wrong):
            plans_of(ends_given, vessels, load)


@pytest.mark.parametrize("name", ["", "a#b", "*", "../up", "x/y", "a\nb"])
def test_a_name_that_is_no_key_and_no_file_is_refused_before_anything_is_read(name):
    with pytest.raises(BadInput, match=r"the name .* must not be empty nor contain"):
        plans_of(["json:127.0.0.1:9002"], [f"{name}=otter"], lambda file: pytest.fail("read"))


def test_a_vessel_whose_name_makes_no_key_needs_one():
    with pytest.raises(BadInput, match="give --vessel NAME=FILE"):
        plans_of(["json:127.0.0.1:9002"], ["boat"], lambda file: replace(OTTER, name="!?"))


def test_a_file_with_an_equals_sign_in_its_name_is_that_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a=b.toml").write_text("")
    read = []
    (plan,) = plans_of(["json:127.0.0.1:9002"], ["a=b.toml"], lambda f: read.append(f) or OTTER)
    assert (read, plan.name) == (["a=b.toml"], "otter")


def test_nothing_is_sent_to_anybody_but_who_asked(plan, stand_in):
    """A second socket that has not asked receives nothing, and no answer comes unasked."""
    import socket

    with looping([plan]), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(0.2)
        firmware = stand_in(plan)
        firmware.sail(AHEAD, 0.2)
        with pytest.raises(TimeoutError):
            other.recv(100)
        with pytest.raises(TimeoutError):
            firmware.receive(0.2)


def test_true_wind_and_the_vane_agree_when_the_boat_lies_still(plan, stand_in):
    with looping([plan], LoopOptions(day=Day(wind=Wind(6.0, math.pi / 2)))) as running:
        values = stand_in(plan).frame(NEUTRAL)
        assert running.said("the day's wind of 6 m/s turns the wind vane and pushes nothing")
        assert values["velocity_wind"] == pytest.approx((0.0, -6.0, 0.0), abs=1e-9)
        assert values["direction"][0] == pytest.approx(math.pi / 2)  # bow north: on starboard
        assert values["speed"][0] == pytest.approx(6.0)
