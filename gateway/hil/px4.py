"""PX4's simulator protocol: sensors out, actuator controls in, as MAVLink. Pure.

HIL_SENSOR with id 0 is the firmware's clock: it goes out 250 times a second of the boat's time.
With it go HIL_STATE_QUATERNION (the truth, for the firmware's log alone) and, ten times a second,
HIL_GPS and, where the day has a depth, DISTANCE_SENSOR. HIL_ACTUATOR_CONTROLS come back, −1 … 1 per
output, 0 … 1 for a motor that cannot reverse, all 0 unless armed. Firmware that runs as a program
says by a flag that it is in lock-step: then the next sensors wait for its controls. Before the
first controls, and for a board, sensors go out at the pace of the clock.

PX4's rover modules set their motors 100 times a second, and 20 while disarmed, so that not every
sample is answered. Where controls stay away for a second, twice as many samples may go out before
they are waited for again, up to 100 ms of them; after a second in which every sample was answered
each is waited for.

PX4 as a program keeps its first IMU in whole steps of 2000/32768 °/s and g/2048, cut towards zero
(`SimulatorMavlink.cpp`, since v1.12): each yaw rate was 0.03 °/s too small. Half a step is added,
which makes of the cut a rounding, as a sensor does it. A board takes the numbers as they are.

The magnetic field is that of the World Magnetic Model at the place of the run: the firmware takes
the declination that it expects from the same model.

Source: PX4 user guide, "Simulation" (MAVLink messages, default ports, lock-step); scaling of
outputs from PX4's pwm_out_sim.
"""

from datetime import UTC, datetime
from functools import lru_cache
from math import atan2, copysign, cos, degrees, hypot, radians, sin
from typing import Any

from pygeomag import GeoMag
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.hil import Played, Session
from gateway.ingest.mapping import Origin
from gateway.links import Peer
from gateway.simulated_boat.telemetry import degrees_e7
from sim.hil import Attitude, Readings, to_hull
from sim.plants.waves import GRAVITY
from sim.vessel import Vessel

STEP_S = 0.004  # what PX4 expects of a simulator: 250 Hz
SLOW_STEPS = 5  # magnetometer and barometer: each 20 ms
GPS_STEPS = 25  # each 100 ms
FIRST_S = 1.0  # on the firmware's clock: 0 means that there is none
PATIENCE_S = 1.0  # for controls, before the sensors go on without them
MOST_AHEAD = 25  # samples that may wait for controls: PX4 sets disarmed outputs each 50 ms
COUNTED = 250  # samples after which it is seen whether each was answered
BEHIND_S = 0.25  # what is later than this is not made up for
ACCELEROMETER, GYRO, MAGNETOMETER, BAROMETER = 0x7, 0x38, 0x1C0, 0x1A00  # of fields_updated
ARMED, LOCK_STEP = 128, 1  # of mode; of flags
SEA_LEVEL_HPA, HPA_PER_M = 1013.25, 0.12
TEMPERATURE_C = 15.0
SOUNDER_CM = 30, 10_000  # nearest and farthest bottom that the echo sounder tells
GAUSS_PER_NT = 1e-5
LAST_DIGIT_GAUSS, LAST_DIGIT_HPA = 1e-5, 5e-4  # they move: numbers that never do are stale to PX4
BOTH_WAYS_US, AHEAD_US = (1000.0, 1500.0, 2000.0), (1000.0, 1000.0, 2000.0)  # of pwm_out_sim
GYRO_STEP, ACCEL_STEP = radians(2000.0) / 2**15, GRAVITY / 2**11  # of PX4's simulated IMU 0
SYSTEM, COMPONENT = 1, mavlink.MAV_COMP_ID_USER1  # of this side: there is no id for simulators


@lru_cache(maxsize=4)
def magnetic_field(place: Origin, year: float) -> tuple[float, float, float]:
    """North, east, down [gauss] at sea level."""
    model = GeoMag(coefficients_file="wmm/WMM_2025.COF")
    found = model.calculate(
        glat=place.latitude_deg, glon=place.longitude_deg, alt=0.0, time=year,
        allow_date_outside_lifespan=True,
    )  # fmt: skip
    return found.x * GAUSS_PER_NT, found.y * GAUSS_PER_NT, found.z * GAUSS_PER_NT


def limits_told(vessel: Vessel) -> str:
    """That the log of firmware that runs as a program has other pulses; empty where it has not.

    Its simulated outputs report −1 … 1, and 0 … 1 of a motor that does not reverse, as 1000 … 2000
    µs, whatever the limits of the boat's own are.
    """
    servos = [actuator.servo for actuator in vessel.actuators]
    odd = sorted({servo.channel for servo in servos if servo.pwm not in (BOTH_WAYS_US, AHEAD_US)})
    if not odd:
        return ""
    return (
        "PX4's own log and MAVLink tell all outputs in 1000 … 2000 µs, and the vessel file has "
        f"other limits of {', '.join(map(str, odd))}: for them use a copy of it with "
        "pwm = [1000, 1500, 2000], or [1000, 1000, 2000] of a motor that does not reverse"
    )


def pulses_of(controls: tuple[float, ...], vessel: Vessel) -> dict[int, float]:
    """Controls of outputs 1 … 16 (−1 … 1) -> the pulses [µs] that stand for them, by channel."""
    out = {n: 1500.0 + 500.0 * control for n, control in enumerate(controls, 1)}
    for servo in (actuator.servo for actuator in vessel.actuators):
        if servo.channel <= len(controls):
            low, neutral, high = servo.pwm
            control = controls[servo.channel - 1]
            span = high - neutral if control > 0.0 else neutral - low
            out[servo.channel] = neutral + span * control
    return out


class Px4Session(Session):
    """One firmware; it is paced by its own answers, or by the clock where it gives none."""

    absent = (
        "no PX4 has connected yet. As a program it does that once, when it starts: one that ran "
        "before this waits for ever, stop it and start it again"
    )

    def __init__(self, played: Played, speed: float = 1.0) -> None:
        super().__init__(played)
        self._speed, self._place = speed, Origin(*played.boat.day.place)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._packer = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        now = datetime.now(UTC)
        self._unix_us = 0  # when the boat began
        self._field = magnetic_field(self._place, now.year + now.month / 12.0)
        self._limits = limits_told(played.boat.vessel)
        self._peer: Peer | None = None
        self._controls: tuple[float, ...] = (0.0,) * 16
        self._step = 0
        self._next = self._sent = 0.0
        self._lock_step = False
        self._ahead, self._may = 0, 1  # samples since the last controls; how many are allowed
        self._answers = 0  # controls since it was last counted

    def wait_s(self, now: float) -> float:
        """How long nothing is due [s]."""
        if self._peer is None or self._waits():
            return PATIENCE_S
        return min(max(self._next - now, 0.0), PATIENCE_S)

    def received(self, data: bytes, peer: Peer, now: float) -> list[bytes]:
        """Controls are noted; `due` answers them."""
        if peer != self._peer and self._peer is not None:
            self.played.notice("second", f"{peer} speaks as well: one firmware for each endpoint")
            return []
        for message in self._parser.parse_buffer(data) or ():
            kind = message.get_type()
            if kind == "HIL_ACTUATOR_CONTROLS":
                self._note_controls(message)
            elif kind == "BAD_DATA":
                self.played.notice("malformed", "bytes that are no MAVLink; they are passed over")
        return []

    def due(self, now: float, peers: tuple[Peer, ...]) -> list[bytes]:
        """The next sensors, where it is time for them."""
        if self._peer not in peers:
            self._peer = None
            if peers:
                self._begin(peers[0], now)
        if self._peer is None or now < self._next:
            return []
        if self._waits():
            if now - self._sent < PATIENCE_S:
                return []
            self._may = min(2 * self._may, MOST_AHEAD)
            text = (
                f"no controls for {PATIENCE_S:.0f} s: it goes on, {self._may} samples ahead of them"
            )
            self.played.notice("late", text)
        self._sent, self._ahead = now, self._ahead + 1
        speed = self._speed if self._lock_step else 1.0
        self._next = max(self._next + STEP_S / speed, now - BEHIND_S)
        pulses = pulses_of(self._controls, self.played.boat.vessel)
        readings = self.played.step(pulses, STEP_S)
        frames = [message.pack(self._packer) for message in self._messages(readings)]
        self._step += 1
        if self._step % COUNTED == 0:
            self._may = 1 if self._answers >= COUNTED - self._may else self._may
            self._answers = 0
        return [b"".join(frames)]

    def _begin(self, peer: Peer, now: float) -> None:
        again = self.played.frames > 0
        text = "the firmware is there again: the boat starts anew" if again else "there is firmware"
        self.played.start("restart" if again else "there", text)
        self._peer, self._step, self._next = peer, 0, now
        self._unix_us = round(datetime.now(UTC).timestamp() * 1e6)
        self._controls, self._lock_step = (0.0,) * 16, False
        self._ahead, self._may, self._answers = 0, 1, 0

    def _waits(self) -> bool:
        """Whether the next sensors are held back until controls come."""
        return self._lock_step and self._ahead >= self._may

    def _note_controls(self, message: Any) -> None:
        self._answers += 1
        self._ahead = 0
        self._lock_step = bool(message.flags & LOCK_STEP)
        if self._lock_step and self._limits:
            self.played.tell_once("limits", self._limits)
        controls = tuple(map(float, message.controls))
        if any(c != c for c in controls):
            self.played.notice("nan", "controls that are not a number; they are taken as 0")
        armed = message.mode & ARMED
        self._controls = tuple(c if armed and c == c else 0.0 for c in controls)

    def _messages(self, r: Readings) -> list[Any]:
        time_us = round((FIRST_S + r.time) * 1e6)
        out = [self._sensor(r, time_us), self._state(r, time_us)]
        if self._step % GPS_STEPS == 0:
            out.append(self._gps(r))
            if r.depth is not None:
                out.append(self._sounder(r.depth, time_us))
        return out

    def _sensor(self, r: Readings, time_us: int) -> Any:
        digit = self._step // SLOW_STEPS % 2
        true_field = to_hull(Attitude(*r.attitude, *(0.0,) * 6), *self._field)
        field = [axis + LAST_DIGIT_GAUSS * digit for axis in true_field]
        pressure = SEA_LEVEL_HPA + HPA_PER_M * r.position[2] + LAST_DIGIT_HPA * digit
        slow = MAGNETOMETER | BAROMETER if self._step % SLOW_STEPS == 0 else 0
        accel, gyro = self._imu(r)
        return mavlink.MAVLink_hil_sensor_message(
            time_us, *accel, *gyro, *field, pressure, 0.0, -r.position[2], TEMPERATURE_C,
            ACCELEROMETER | GYRO | slow, 0,
        )  # fmt: skip

    def _imu(self, r: Readings) -> tuple[list[float], list[float]]:
        """Accelerations, rates; for a program, which cuts, half a step more."""
        more = 0.5 if self._lock_step else 0.0
        return (
            [f + copysign(more * ACCEL_STEP, f) for f in r.accel],
            [w + copysign(more * GYRO_STEP, w) for w in r.gyro],
        )

    def _gps(self, r: Readings) -> Any:
        (north, east, down), (vn, ve, vd) = r.position, r.velocity
        speed, course = hypot(vn, ve), degrees(atan2(ve, vn)) % 360.0
        return mavlink.MAVLink_hil_gps_message(
            self._unix_us + round(r.time * 1e6), 3, *degrees_e7(self._place, north, east),
            round(-1000.0 * down), 30, 40, round(100.0 * speed), round(100.0 * vn),
            round(100.0 * ve), round(100.0 * vd), round(100.0 * course) % 36000, 14, 0, 0,
        )  # fmt: skip

    def _sounder(self, depth: float, time_us: int) -> Any:
        nearest, farthest = SOUNDER_CM
        return mavlink.MAVLink_distance_sensor_message(
            time_us // 1000, nearest, farthest, min(max(round(100.0 * depth), nearest), farthest),
            mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND, 0, mavlink.MAV_SENSOR_ROTATION_PITCH_270, 0,
        )  # fmt: skip

    def _state(self, r: Readings, time_us: int) -> Any:
        """Airspeeds are 0: a boat has none."""
        vn, ve, vd = r.velocity
        accel = [round(1000.0 * f / GRAVITY) for f in r.accel]
        return mavlink.MAVLink_hil_state_quaternion_message(
            time_us, quaternion(*r.attitude), *r.gyro, *degrees_e7(self._place, *r.position[:2]),
            round(-1000.0 * r.position[2]), *(round(100.0 * v) for v in (vn, ve, vd)), 0, 0, *accel,
        )  # fmt: skip


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """Angles [rad] -> w, x, y, z."""
    (cf, sf), (ct, st), (cy, sy) = ((cos(a / 2.0), sin(a / 2.0)) for a in (roll, pitch, yaw))
    return [
        cf * ct * cy + sf * st * sy,
        sf * ct * cy - cf * st * sy,
        cf * st * cy + sf * ct * sy,
        cf * ct * sy - sf * st * cy,
    ]
