"""A played boat: seconds in, MAVLink frames out; pure, the same for the same seed.

    program → hull → sensors → streams → frames → wire

It moves in ticks of the autopilot's loop, so it does not matter how time is cut into calls.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from numpy.random import PCG64, Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.ingest.earth import Origin
from gateway.simulated_boat.command_responder import CommandResponder
from gateway.simulated_boat.faults import Frame, Wire
from gateway.simulated_boat.hull import ENDURANCE_S, Hull, Pilot
from gateway.simulated_boat.program import Program, program_of
from gateway.simulated_boat.sensors import Sensors, SensorState
from gateway.simulated_boat.settings import PlayedSettings
from gateway.simulated_boat.streams import SLACK, Speaker, Streams, due, moved_on, spoiled, started
from gateway.simulated_boat.telemetry import (
    BANNER,
    CHANNELS,
    Message,
    Moment,
    parameter_messages,
    parameters,
    said,
)
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

STATION = 255  # system id of the ground station beside
LONGEST_QUEUE = 1000  # of answers; what is asked for beyond is not answered
ANSWERS_PER_TICK = 4  # a link is not flooded with parameters


@dataclass(frozen=True)
class BoatState:
    """Everything that a played boat remembers."""

    tick: int  # the next one to be played
    hull: Floats  # (nx,)
    past: tuple[Pilot, ...]  # outputs that may still act late
    sensors: SensorState
    used_as: float
    zero_s: float  # when the boat's clock was zero [s since play began]
    speaks_s: float  # from when on it speaks
    reboots: int
    local: tuple[float, float]  # where the local frame starts [m]
    streams: Streams
    queue: tuple[Message, ...]  # answers that wait for their turn
    frames: int  # sent since boot
    station_frames: int
    waiting: tuple[Frame, ...]  # on the wire
    dice: Any  # state of the generator of sensor errors …
    luck: Any  # … and of faults: they do not change what the boat says


class PlayedBoat:
    """A vessel under a program, with an autopilot that tells of it."""

    def __init__(
        self,
        vessel: Vessel,
        settings: PlayedSettings | None = None,
        seed: int = 0,
        program: Program | None = None,
    ) -> None:
        self.settings = s = settings or PlayedSettings()
        self.dt, self._seed = 1.0 / s.loop_hz, seed
        self._pilots = program or program_of(vessel, seed=seed)
        self._hull = Hull(Model.of(vessel), self._pilots, self.dt, s.battery_v)
        self._sensors = Sensors(self.dt, s.noise, s.gyro_filter_hz)
        values = parameters(vessel, s.system_id, s.gyro_filter_hz)
        self._office = CommandResponder(s.system_id, s.rates, tuple(parameter_messages(values)))
        self._boat = Speaker(s.system_id, 1, s.signing_key, s.unix_s)
        self._station = Speaker(STATION, 190, None, s.unix_s)
        self._wire, self._origin = Wire(s.faults), Origin(*s.origin_deg)
        self._channels = [actuator.servo.channel for actuator in vessel.actuators]

    def start(self) -> BoatState:
        """At rest, before the first tick."""
        dice = Generator(PCG64(self._seed))
        s = self.settings
        return self._booted(
            BoatState(
                tick=0,
                hull=self._hull.start(s.start),
                past=(self._hull.pilot(0.0, False),) * self._hull.remembered,
                sensors=self._sensors.start(dice),
                used_as=0.0,
                zero_s=-s.boot_s,
                speaks_s=0.0,
                reboots=0,
                local=(0.0, 0.0),
                streams={},
                queue=(),
                frames=0,
                station_frames=0,
                waiting=(),
                dice=dice.bit_generator.state,
                luck=PCG64((self._seed, 1)).state,
            )
        )

    def advance(self, state: BoatState, until_s: float) -> tuple[BoatState, list[Frame]]:
        """Play on to that moment [s since play began] -> state, frames that arrive by then."""
        dice, luck = _generator(state.dice), _generator(state.luck)
        arrived: list[Frame] = []
        while state.tick * self.dt <= until_s + SLACK:
            now = state.tick * self.dt
            state, sent = self._tick(state, now, dice, luck)
            waiting, got = self._wire.carry(state.waiting, sent, now, luck)
            state = replace(state, waiting=waiting)
            arrived += got
        waiting, got = self._wire.carry(state.waiting, (), until_s, luck)
        after = replace(
            state, waiting=waiting, dice=dice.bit_generator.state, luck=luck.bit_generator.state
        )
        return after, arrived + got

    def next_s(self, state: BoatState) -> float:
        """When there is something to do next [s since play began]."""
        return min([state.tick * self.dt, *(frame.time_s for frame in state.waiting[:1])])

    def hear(self, state: BoatState, message: Message) -> BoatState:
        """Somebody spoke to the boat; it answers with the next frames."""
        now = state.tick * self.dt
        if now < state.speaks_s:
            return state
        answer = self._office.answer(state.streams, message, now)
        queue = (*state.queue, *answer.messages)[:LONGEST_QUEUE]
        return replace(state, streams=answer.streams, queue=queue)

    def _tick(
        self, state: BoatState, now: float, dice: Generator, luck: Generator
    ) -> tuple[BoatState, list[Frame]]:
        """One turn of the autopilot's loop."""
        state = self._rebooted(state, now)
        armed = self._armed(state, now)
        past = (*state.past, self._hull.pilot(now, armed))[-self._hull.remembered :]
        hull, truth = self._hull.step(state.hull, state.tick, past, state.used_as)
        sensors, sensed = self._sensors.read(state.sensors, truth, dice)
        used_as = state.used_as + truth.amperes * self.dt
        moment = Moment(
            boot_us=round((now - state.zero_s) * 1e6),
            unix_us=round((self.settings.unix_s + now) * 1e6),
            armed=armed,
            sensed=sensed,
            pulses=self._outputs(past[-1]),
            throttle=past[-1].effort,
            amperes=truth.amperes,
            used_as=used_as,
            remaining=1.0 - min(used_as / (self._hull.full_current * ENDURANCE_S), 1.0),
            local=state.local,
            origin=self._origin,
        )
        state = replace(
            state, tick=state.tick + 1, hull=hull, past=past, sensors=sensors, used_as=used_as
        )
        return self._spoken(state, moment, now, luck)

    def _spoken(
        self, state: BoatState, moment: Moment, now: float, luck: Generator
    ) -> tuple[BoatState, list[Frame]]:
        """What the boat and the station beside it say at this moment."""
        frames = list(self._heard_beside(state, now))
        station = state.station_frames + len(frames)
        if now + SLACK < state.speaks_s:
            return replace(state, station_frames=station), frames
        names = due(state.streams, now)
        streamed = [message for name in names for message in said(name, moment)]
        messages = [
            *(self._perhaps_spoiled(message, luck) for message in streamed),
            *state.queue[:ANSWERS_PER_TICK],
        ]
        boot_s = moment.boot_us * 1e-6
        frames += [
            Frame(now, boot_s, self.settings.system_id, self._boat.frame(m, state.frames + i))
            for i, m in enumerate(messages)
        ]
        return replace(
            state,
            streams=moved_on(state.streams, names, now),
            queue=state.queue[ANSWERS_PER_TICK:],
            frames=state.frames + len(messages),
            station_frames=station,
        ), frames

    def _perhaps_spoiled(self, message: Message, luck: Generator) -> Message:
        share = self.settings.faults.nonsense
        if not share or message.get_type() == "HEARTBEAT" or luck.random() >= share:
            return message
        return spoiled(message, luck)

    def _heard_beside(self, state: BoatState, now: float) -> Iterator[Frame]:
        if self.settings.station and (state.tick - 1) % round(self.settings.loop_hz) == 0:
            beat = mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
            )
            yield Frame(now, now, STATION, self._station.frame(beat, state.station_frames))

    def _armed(self, state: BoatState, now: float) -> bool:
        begin, end = self.settings.armed
        return begin <= now < end and now + SLACK >= state.speaks_s

    def _outputs(self, pilot: Pilot) -> tuple[int, ...]:
        outputs = [0] * CHANNELS
        for channel, pulse in zip(self._channels, pilot.pulses, strict=True):
            outputs[channel - 1] = pulse
        return tuple(outputs)

    def _rebooted(self, state: BoatState, now: float) -> BoatState:
        """The same state, or that of an autopilot that has just restarted."""
        ahead = self.settings.faults.reboots[state.reboots :]
        if not ahead or now + SLACK < ahead[0].at_s:
            return state
        return self._booted(
            replace(
                state,
                zero_s=now,
                speaks_s=now + ahead[0].down_s,
                reboots=state.reboots + 1,
                local=(float(state.hull[0]), float(state.hull[1])),
                queue=(),
                frames=0,
            )
        )

    def _booted(self, state: BoatState) -> BoatState:
        """Streams at their default rates, and the words that an autopilot starts with."""
        banner = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, BANNER.encode())
        told = self._office.parameters if self.settings.parameters else ()
        streams = started(self.settings.rates, state.speaks_s)
        return replace(state, streams=streams, queue=(banner, *told))


def _generator(state: Any) -> Generator:
    """A generator that goes on from that state."""
    bits = PCG64(0)
    bits.state = state
    return Generator(bits)
