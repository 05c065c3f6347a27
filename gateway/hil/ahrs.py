"""A flight controller on the bench: the boat as its external AHRS, its outputs back by MAVLink.

ArduPilot on a board takes no simulated sensors, but it does take a VectorNav on a serial port for
its attitude, place and velocity (EAHRS_TYPE 1, AHRS_EKF_TYPE 11). The boat is that VectorNav: its
packets go out at the rates that the driver asks for, at the pace of the clock.
"""

from datetime import UTC, datetime

from gateway.hil.px4 import magnetic_field
from gateway.hil.servo_outputs import ServoOutputs
from gateway.hil.session import Played, Session
from gateway.hil.vectornav import (
    GNSS,
    GPS_EPOCH_UNIX_S,
    IMU,
    INS,
    LEAP_S,
    Fix,
    Registers,
    gnss_packet,
    imu_packet,
    ins_packet,
)
from gateway.ingest.earth import Origin
from gateway.links.transport import Peer
from gateway.simulated_boat.telemetry import degrees_e7
from sim.hil.inertial import Attitude, to_hull
from sim.hil.sensors import Readings

WARNING = (
    "MOTORS MAY TURN: a real board drives its outputs from now on as if it were afloat. Take the "
    "propellers off, or cut the motors' power, before anything is armed"
)
STEP_S = 0.005  # of the boat, at most
WAIT_S = 0.5
BEHIND_S = 0.25  # what is later than this is not made up for
PACKETS = {IMU: imu_packet, INS: ins_packet, GNSS: gnss_packet}


class AhrsSession(Session):
    """One board; nothing goes out before its driver has asked."""

    talks = False

    def __init__(self, played: Played, outputs: ServoOutputs) -> None:
        super().__init__(played)
        self._outputs, self._place = outputs, Origin(*played.boat.day.place)
        now = datetime.now(UTC)
        self._gps_ns = round((now.timestamp() - GPS_EPOCH_UNIX_S + LEAP_S) * 1e9)
        self._field = magnetic_field(self._place, now.year + now.month / 12.0)
        self._registers = Registers()
        self._next = 0.0
        self._due: dict[int, float] = {}
        self._begun = False

    def received(self, data: bytes, peer: Peer, now: float) -> list[bytes]:
        """Commands of the driver -> its answers."""
        was = self._registers.streaming
        answers, wrong, anew = self._registers.received(data)
        if wrong:
            self.played.notice("malformed", "a command with a wrong checksum; it is passed over")
        if self._registers.streaming and (anew or not was):
            rates = ", ".join(f"{hertz:g} Hz" for hertz in self._registers.hertz.values())
            if self._begun:
                text = f"the board has begun anew ({rates}): the boat starts anew"
            else:
                text = f"a board asks ({rates})"
            self.played.start("restart" if self._begun else "there", text)
            self._begun, self._next = True, now
            self._due = dict.fromkeys(self._registers.hertz, 0.0)
        return answers

    def wait_s(self, now: float) -> float:
        """How long nothing is due [s]."""
        return min(max(self._next - now, 0.0), WAIT_S) if self._registers.streaming else WAIT_S

    def due(self, now: float, peers: tuple[Peer, ...]) -> list[bytes]:
        """The packets whose time has come."""
        if not peers:
            self._registers.streaming = False  # whoever comes next will ask anew
        if not self._registers.streaming or now < self._next:
            return []
        self._next = max(self._next + STEP_S, now - BEHIND_S)
        pulses = self._outputs.pulses()
        if pulses is None:
            self.played.notice("deaf", "no servo outputs are heard: motors stand still")
        readings = self.played.step(pulses or {}, STEP_S)
        at = self._fix(readings)
        return [PACKETS[register](readings, at) for register in self._registers_due(readings.time)]

    def _registers_due(self, time: float) -> list[int]:
        """Those whose packet is due; one that was held up is not made up for."""
        found = [r for r in self._registers.hertz if time >= self._due.get(r, 0.0)]
        for register in found:
            self._due[register] = max(self._due.get(register, 0.0), time - STEP_S) + (
                1.0 / self._registers.hertz[register]
            )
        return found

    def _fix(self, r: Readings) -> Fix:
        lat, lon = degrees_e7(self._place, *r.position[:2])
        field = to_hull(Attitude(*r.attitude, *(0.0,) * 6), *self._field)
        place = (lat * 1e-7, lon * 1e-7, -r.position[2])
        return Fix(place, field, self._gps_ns + round(r.time * 1e9))
