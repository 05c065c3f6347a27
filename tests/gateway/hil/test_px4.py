"""PX4's simulator protocol, held against a stand-in that connects and answers as PX4 does."""

import contextlib
import math
import os
import select
import socket
import time
import tty
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.hil.px4 import GYRO_STEP, STEP_S, magnetic_field, pulses_of, quaternion
from gateway.hil.run import LoopOptions, LoopPlan
from gateway.ingest.mapping import Origin
from gateway.vessel_file import load_vessel
from sim.hil.day import Day
from tests.gateway.hil.firmware import looping, wait_for

OTTER = load_vessel("otter")
FAST = LoopOptions(speed=1000.0)


class StandIn:
    """Firmware that connects and answers each HIL_SENSOR with controls."""

    def __init__(self, wire):
        self._socket = wire
        self._socket.settimeout(5.0)
        self._parser = mavlink.MAVLink(None)
        self._packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._waiting = []
        self.last = {}

    def close(self):
        self._socket.close()

    def send(self, data):
        self._socket.sendall(data)

    def controls(self, left, right, *, armed=True, flags=1):
        row = [left, 0.0, right] + [0.0] * 13
        message = mavlink.MAVLink_hil_actuator_controls_message(0, row, 1 | 128 * armed, flags)
        self.send(message.pack(self._packer))

    def sensor(self):
        """The next HIL_SENSOR; what came before it is in `last` by name."""
        while True:
            while self._waiting:
                message = self._waiting.pop(0)
                self.last[message.get_type()] = message
                if message.get_type() == "HIL_SENSOR":
                    return message
            self._waiting += self._parser.parse_buffer(self._socket.recv(65536)) or []

    def drain(self, seconds):
        """How many HIL_SENSOR come within that time."""
        count, end = 0, time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._socket.settimeout(left)
            with contextlib.suppress(TimeoutError):
                self.sensor()
                count += 1
        self._socket.settimeout(5.0)
        return count

    def sail(self, left, right, seconds, **options):
        """Lock-step for that long -> the last HIL_STATE_QUATERNION and what else came."""
        for _ in range(round(seconds / STEP_S)):
            self.controls(left, right, **options)
            self.sensor()
        return self.last


@pytest.fixture
def stand_in():
    made = []

    def make(plan):
        port = int(plan.endpoint.rpartition(":")[2])
        made.append(StandIn(socket.create_connection(("127.0.0.1", port))))
        return made[-1]

    yield make
    for firmware in made:
        firmware.close()


@pytest.fixture
def plan():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return LoopPlan(f"px4:127.0.0.1:{port}", "otter", OTTER)


def test_sensors_come_without_being_asked_then_each_waits_for_controls(plan, stand_in):
    with looping([plan], FAST):
        firmware = stand_in(plan)
        first = firmware.sensor()
        assert firmware.sensor().time_usec - first.time_usec == pytest.approx(4000, abs=1)
        firmware.sail(0.0, 0.0, 1.0)
        firmware.drain(0.3)
        assert firmware.drain(0.3) == 0, "no controls: no sensors"
        firmware.controls(0.0, 0.0)
        assert firmware.drain(0.3) == 1


def test_what_the_sensors_read_at_rest(plan, stand_in):
    place = (51.5, -0.1)
    with looping([plan], replace(FAST, day=Day(place=place, start=(0.0, 0.0, math.pi / 2)))):
        firmware = stand_in(plan)
        sensor = firmware.sensor()
        while not {"HIL_GPS", "HIL_STATE_QUATERNION"} <= firmware.last.keys():
            firmware.sensor()
    assert (sensor.xacc, sensor.yacc) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert sensor.zacc == pytest.approx(-9.80665)
    assert sensor.time_usec > 0
    assert sensor.abs_pressure == pytest.approx(1013.25)
    assert sensor.fields_updated == 0x7 | 0x38 | 0x1C0 | 0x1A00
    north, east, down = magnetic_field(Origin(*place), time.gmtime().tm_year)
    assert (sensor.xmag, sensor.ymag) == pytest.approx((east, -north), abs=1e-3), "bow to the east"
    assert sensor.zmag == pytest.approx(down, abs=1e-3)
    gps = firmware.last["HIL_GPS"]
    assert (gps.lat, gps.lon, gps.fix_type) == (515000000, -1000000, 3)
    state = firmware.last["HIL_STATE_QUATERNION"]
    assert state.attitude_quaternion == pytest.approx([0.5**0.5, 0.0, 0.0, 0.5**0.5])


def test_an_echo_sounder_where_the_day_has_a_depth(plan, stand_in):
    with looping([plan], replace(FAST, day=Day(depth=7.5))):
        firmware = stand_in(plan)
        heard = firmware.sail(0.0, 0.0, 0.2)
    sounder = heard["DISTANCE_SENSOR"]
    assert sounder.current_distance == pytest.approx(750, abs=1)
    assert sounder.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270  # down
    with looping([plan], FAST):
        assert "DISTANCE_SENSOR" not in stand_in(plan).sail(0.0, 0.0, 0.2)


def test_no_sensor_of_a_boat_at_rest_is_stale(plan, stand_in):
    """PX4 takes a magnetometer or barometer for failed whose numbers are the same 100 times."""
    with looping([plan], FAST):
        firmware = stand_in(plan)
        slow = []
        while len(slow) < 300:
            message = firmware.sensor()
            if message.fields_updated & 0x1C0:
                slow.append((message.xmag, message.ymag, message.zmag, message.abs_pressure))
            firmware.controls(0.0, 0.0)
    for values in zip(*slow, strict=True):
        changed = [k for k in range(1, 300) if values[k] != values[k - 1]]
        assert all(b - a < 50 for a, b in zip([0, *changed], [*changed, 300], strict=True))
        assert max(values) - min(values) < 1e-3


def test_a_known_field():
    """Zürich, 2026: 48.4 µT, 3.6° east of north, 63.5° down, by the model's own calculator."""
    north, east, down = magnetic_field(Origin(47.397742, 8.545594), 2026.5)
    assert math.degrees(math.atan2(east, north)) == pytest.approx(3.61, abs=0.05)
    assert math.hypot(north, east, down) == pytest.approx(0.484, abs=1e-3)
    assert down > 0.43


def test_controls_move_the_boat_only_when_armed(plan, stand_in):
    with looping([plan], FAST):
        firmware = stand_in(plan)
        assert firmware.sail(0.8, 0.8, 2.0, armed=False)["HIL_STATE_QUATERNION"].vx == 0
        moved = firmware.sail(0.8, 0.8, 8.0)
    assert moved["HIL_STATE_QUATERNION"].vx > 50, "cm/s"
    assert moved["HIL_GPS"].lat > round(47.397742e7)
    assert moved["HIL_GPS"].vel == pytest.approx(moved["HIL_STATE_QUATERNION"].vx, abs=5)
    assert moved["HIL_GPS"].cog in range(100)


def test_opposite_controls_turn_it_clockwise(plan, stand_in):
    with looping([plan], FAST):
        last = stand_in(plan).sail(0.5, -0.5, 2.0)
    assert last["HIL_SENSOR"].zgyro > 0.1


@pytest.mark.parametrize("flags", [1, 0])
def test_a_program_that_cuts_to_whole_steps_reads_what_a_sensor_rounds(plan, stand_in, flags):
    """As PX4's `SimulatorMavlink` keeps its first IMU; a board, not in lock-step, keeps floats."""
    with looping([plan], FAST):
        firmware = stand_in(plan)
        sent, true = {}, {}
        for k in range(400):
            side = 0.5 if k < 100 else -0.5
            firmware.controls(side, -side, flags=flags)
            sensor = firmware.sensor()
            sent[sensor.time_usec] = sensor.zgyro
            state = firmware.last.get("HIL_STATE_QUATERNION", sensor)  # of the sensor before
            true[state.time_usec] = getattr(state, "yawspeed", 0.0)
    both = [(sent[t], true[t]) for t in sorted(sent.keys() & true.keys())[5:]]
    assert min(w for _, w in both) < -0.02
    assert max(w for _, w in both) > 0.02
    if flags:
        assert all(int(s / GYRO_STEP) == round(w / GYRO_STEP) for s, w in both)
    else:
        assert all(s == w for s, w in both)


def test_that_the_log_of_a_program_has_other_pulses_is_said_once(plan, stand_in):
    """A boat of 1100 … 1900 µs: half of its thrust stands in PX4's log as 1750 µs, not as 1700."""
    for vessel, told in ((load_vessel("blueboat"), 1), (OTTER, 0)):
        with looping([replace(plan, vessel=vessel)], FAST) as running:
            stand_in(plan).sail(0.5, 0.5, 1.0)
        assert len(running.said("pwm = [1000, 1500, 2000]")) == told


def test_the_time_of_the_gps_counts_from_when_the_firmware_came(plan, stand_in):
    """And not from when somebody began to wait for it: the log's clock would be early by that."""
    with looping([plan], FAST):
        for _ in range(2):
            time.sleep(0.2)
            began = time.time()
            firmware = stand_in(plan)
            heard = firmware.sail(0.0, 0.0, 0.02)
            assert began <= heard["HIL_GPS"].time_usec * 1e-6 <= time.time()
            firmware.close()


def test_firmware_that_comes_again_finds_the_boat_at_its_start(plan, stand_in):
    with looping([plan], FAST) as running:
        firmware = stand_in(plan)
        firmware.sail(0.8, 0.8, 4.0)
        firmware.close()
        assert wait_for(lambda: running.said("went away"))
        again = stand_in(plan)
        assert again.sensor().time_usec == pytest.approx(1e6 + 4000, abs=1)
        again.sensor()
        assert again.last["HIL_STATE_QUATERNION"].vx == 0
    assert running.said("the firmware is there again")


def test_firmware_that_does_not_come_may_be_one_that_ran_before(plan, stand_in, monkeypatch):
    """PX4 as a program opens its simulator's link once: after a kill of `hil` it waits for ever."""
    monkeypatch.setattr("gateway.hil.hearing.SILENT_S", 0.3)
    with looping([plan]) as running:
        assert wait_for(lambda: running.said("no PX4 has connected yet"))
        firmware = stand_in(plan)
        firmware.sail(0.2, 0.2, 0.5)
    assert len(running.said("no PX4 has connected yet")) == 1


def test_firmware_that_is_there_is_not_looked_for(plan, stand_in, monkeypatch):
    monkeypatch.setattr("gateway.hil.hearing.SILENT_S", 0.3)
    with looping([plan]) as running:
        firmware = stand_in(plan)
        firmware.sail(0.2, 0.2, 0.5)
        firmware.close()
        assert wait_for(lambda: running.said("is silent for"))
    assert not running.said("no PX4 has connected yet")


def test_controls_that_stay_away_are_said_and_it_goes_on(plan, stand_in):
    with looping([plan], FAST) as running:
        firmware = stand_in(plan)
        firmware.sail(0.0, 0.0, 0.1)
        firmware.drain(0.3)
        assert firmware.drain(3.0) >= 1
        assert running.said("no controls for 1 s")


def test_firmware_that_answers_every_third_sample_is_not_held_up(plan, stand_in):
    """PX4's rover modules set their motors at 100 Hz: a strict lock-step gave 4 ms a second."""
    with looping([plan], FAST) as running:
        firmware = stand_in(plan)
        firmware.sail(0.0, 0.0, 0.1)
        begun, first = time.monotonic(), firmware.last["HIL_SENSOR"].time_usec
        for n in range(1000):
            if n % 3 == 0:
                firmware.controls(0.5, 0.5)
            last = firmware.sensor().time_usec
        assert last - first == pytest.approx(4e6, abs=1e4)
        assert time.monotonic() - begun < 30.0, "held up by a few seconds of patience, not by 600"
        assert len(running.said("no controls for 1 s")) <= 2
        firmware.drain(0.3)
        assert firmware.drain(0.3) == 0, "it is still waited for"
        firmware.sail(0.0, 0.0, 3.0)  # each sample is answered
        firmware.drain(0.3)
        firmware.controls(0.0, 0.0)
        assert firmware.drain(0.3) == 1, "lock-step is strict again"


def test_a_board_without_lock_step_is_paced_by_the_clock(plan, stand_in):
    with looping([plan], LoopOptions(speed=1.0)):
        firmware = stand_in(plan)
        firmware.sensor()
        firmware.controls(0.3, 0.3, flags=0)
        begun, first = time.monotonic(), firmware.sensor().time_usec
        while time.monotonic() - begun < 1.0:
            last = firmware.sensor().time_usec
    assert (last - first) * 1e-6 == pytest.approx(1.0, abs=0.3)


class Wire:
    """The board's end of a serial line, as a socket."""

    def __init__(self):
        self._end, self._other = os.openpty()
        tty.setraw(self._end)
        self.device = os.ttyname(self._other)

    def settimeout(self, seconds):
        self._seconds = seconds

    def sendall(self, data):
        os.write(self._end, data)

    def recv(self, size):
        if not select.select([self._end], [], [], self._seconds)[0]:
            raise TimeoutError
        return os.read(self._end, size)

    def close(self):
        os.close(self._end)
        os.close(self._other)


def test_a_board_on_a_serial_line_drives_the_boat_without_lock_step(plan):
    """HITL: sensors come whether or not controls do, and noise on the line does not end them."""
    board = StandIn(Wire())
    with looping([replace(plan, endpoint=f"px4:{board._socket.device}:921600")]) as running:
        for _ in range(5):
            board.sensor()
        board.send(b"\xfd\x00 noise \xfe")
        end = time.monotonic() + 60.0
        while time.monotonic() < end and board.last["HIL_STATE_QUATERNION"].vx < 20:  # cm/s
            board.controls(0.8, 0.8, flags=0)
            board.sensor()
    assert board.last["HIL_STATE_QUATERNION"].vx >= 20
    assert board.last["HIL_GPS"].fix_type == 3
    assert running.said("there is firmware")
    board.close()


def test_what_is_no_mavlink_or_no_number_is_survived(plan, stand_in):
    with looping([plan], FAST) as running:
        firmware = stand_in(plan)
        firmware.sail(0.0, 0.0, 0.1)
        firmware.send(b"GET / HTTP/1.1\r\n\r\n" + bytes(range(256)))
        firmware.sail(math.nan, math.nan, 0.1)
        assert firmware.sail(0.8, 0.8, 2.0)["HIL_STATE_QUATERNION"].vx > 10
    assert len(running.said("no MAVLink")) == 1
    assert len(running.said("not a number")) == 1


def test_a_second_firmware_is_said_and_not_listened_to(plan, stand_in):
    with looping([plan], FAST) as running:
        first, second = stand_in(plan), None
        first.sail(0.0, 0.0, 0.1)
        second = stand_in(plan)
        second.controls(1.0, 1.0)
        assert wait_for(lambda: running.said("one firmware for each endpoint"))
        assert first.sail(0.0, 0.0, 1.0)["HIL_STATE_QUATERNION"].vx == 0


def test_controls_are_pulses_of_the_servos_that_the_vessel_has():
    servo = replace(OTTER.thrusters[0].servo, pwm=(1000, 1400, 2000))
    vessel = replace(OTTER, thrusters=(replace(OTTER.thrusters[0], servo=servo),))
    for control, pulse in ((-1.0, 1000.0), (0.0, 1400.0), (0.5, 1700.0), (1.0, 2000.0)):
        assert pulses_of((control,) * 2, vessel) == {1: pulse, 2: 1500.0 + 500.0 * control}


def test_the_quaternion_turns_as_the_angles_do():
    assert quaternion(0.0, 0.0, 0.0) == [1.0, 0.0, 0.0, 0.0]
    w, x, y, z = quaternion(0.1, -0.2, 0.7)
    assert math.hypot(w, x, y, z) == pytest.approx(1.0)
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(0.1)
    assert math.asin(2 * (w * y - z * x)) == pytest.approx(-0.2)
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(0.7)
