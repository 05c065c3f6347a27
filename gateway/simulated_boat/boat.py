"""A simulated boat: seconds in, MAVLink frames out; pure, the same for the same seed.

    program → hull → sensors → streams → frames → link with faults

It moves in ticks of the autopilot's loop, so it does not matter how time is cut into calls.
"""

from dataclasses import dataclass, field, replace
from typing import Any

from numpy.random import PCG64, Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.ingest.mapping import Origin
from gateway.simulated_boat import FaultyLink, SimulatedBoatSettings, TimedFrame
from gateway.simulated_boat.command_responder import (
    TOLERANCE_S,
    CommandResponder,
    FramePacker,
    Streams,
    after_sending,
    due_messages,
    start_streams,
    with_invalid_field,
)
from gateway.simulated_boat.hull import (
    ActuatorOutputs,
    GroundMotion,
    Program,
    SensedValues,
    SensorModel,
    SensorState,
    SimulatedHull,
    program_of,
)
from gateway.simulated_boat.telemetry import (
    BANNER,
    CHANNELS,
    BoatSnapshot,
    Message,
    messages_named,
    parameter_messages,
    parameters,
)
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

STATION_SYSTEM = 255  # system id of a ground station on the same link
MAX_QUEUE = 1000  # answers that wait; what is requested beyond is not answered
ANSWERS_PER_TICK = 4  # a link is not flooded with parameters


@dataclass(frozen=True)
class BoatState:
    """Everything that a simulated boat remembers."""

    tick: int  # the next one
    hull: Floats  # (nx,)
    past: tuple[ActuatorOutputs, ...]  # those that may still act late
    sensors: SensorState
    used_as: float  # charge drawn from the battery [A s]
    zero_s: float  # when the boat's clock was zero [s since the start]
    sends_s: float  # from when on it sends
    reboots: int
    local: tuple[float, float]  # where the local frame starts [m]
    streams: Streams
    queue: tuple[Message, ...]  # answers that wait for their turn
    frames: int  # sent since boot
    station_frames: int
    waiting: tuple[TimedFrame, ...]  # on the link
    sensor_rng: Any  # state of the random generator of sensor errors …
    fault_rng: Any  # … and of faults: they do not change what the boat sends
    held: dict[str, SensedValues] = field(default_factory=dict)  # by frozen sensors
    track: tuple[GroundMotion, ...] = ()  # that is still to be reported


class SimulatedBoat:
    """A vessel under a program, with an autopilot that reports it."""

    def __init__(
        self,
        vessel: Vessel,
        settings: SimulatedBoatSettings | None = None,
        seed: int = 0,
        program: Program | None = None,
    ) -> None:
        self.settings = s = settings or SimulatedBoatSettings()
        self.dt, self._seed = 1.0 / s.loop_hz, seed
        program = program or program_of(vessel, seed=seed)
        self._hull = SimulatedHull(Model.of(vessel), program, self.dt, s.battery_v)
        self._sensors = SensorModel(self.dt, s.noise, s.gyro_filter_hz)
        values = parameters(vessel, s.system_id, s.gyro_filter_hz)
        self._responder = CommandResponder(s.system_id, s.rates, tuple(parameter_messages(values)))
        self._packer = FramePacker(s.system_id, 1, s.signing_key, s.unix_s)
        self._station_packer = FramePacker(STATION_SYSTEM, 190, None, s.unix_s)
        self._link, self._origin = FaultyLink(s.faults), Origin(*s.origin_deg)
        self._channels = [actuator.servo.channel for actuator in vessel.actuators]

    def start(self) -> BoatState:
        """The state before the first tick: at rest."""
        sensor_rng = Generator(PCG64(self._seed))
        s = self.settings
        return self._boot(
            BoatState(
                tick=0,
                hull=self._hull.start(s.start),
                past=(self._hull.outputs_at(0.0, False),) * self._hull.remembered,
                sensors=self._sensors.start(sensor_rng),
                used_as=0.0,
                zero_s=-s.boot_s,
                sends_s=0.0,
                reboots=0,
                local=(0.0, 0.0),
                streams={},
                queue=(),
                frames=0,
                station_frames=0,
                waiting=(),
                sensor_rng=sensor_rng.bit_generator.state,
                fault_rng=PCG64((self._seed, 1)).state,
            )
        )

    def advance(self, state: BoatState, until_s: float) -> tuple[BoatState, list[TimedFrame]]:
        """Go on to that moment [s since the start] -> state, frames that arrive by then."""
        sensor_rng, fault_rng = _generator(state.sensor_rng), _generator(state.fault_rng)
        arrived: list[TimedFrame] = []
        while state.tick * self.dt <= until_s + TOLERANCE_S:
            now = state.tick * self.dt
            state, sent = self._tick(state, now, sensor_rng, fault_rng)
            waiting, arrivals = self._link.deliver(state.waiting, sent, now, fault_rng)
            state = replace(state, waiting=waiting)
            arrived += arrivals
        waiting, arrivals = self._link.deliver(state.waiting, (), until_s, fault_rng)
        after = replace(
            state,
            waiting=waiting,
            sensor_rng=sensor_rng.bit_generator.state,
            fault_rng=fault_rng.bit_generator.state,
        )
        return after, arrived + arrivals

    def next_s(self, state: BoatState) -> float:
        """When there is something to do next [s since the start]."""
        return min([state.tick * self.dt, *(frame.time_s for frame in state.waiting[:1])])

    def receive(self, state: BoatState, message: Message) -> BoatState:
        """A message reached the boat; it answers with the next frames."""
        now = state.tick * self.dt
        if now < state.sends_s:
            return state
        response = self._responder.answer(state.streams, message, now)
        queue = (*state.queue, *response.messages)[:MAX_QUEUE]
        return replace(state, streams=response.streams, queue=queue)

    def _tick(
        self, state: BoatState, now: float, sensor_rng: Generator, fault_rng: Generator
    ) -> tuple[BoatState, list[TimedFrame]]:
        """One turn of the autopilot's loop."""
        state = self._reboot_if_due(state, now)
        armed = self._armed(state, now)
        past = (*state.past, self._hull.outputs_at(now, armed))[-self._hull.remembered :]
        hull, truth = self._hull.step(state.hull, state.tick, past, state.used_as)
        track, report = self._hull.late(state.track, truth.report)
        truth = truth._replace(report=report)
        sensors, sensed = self._sensors.read(state.sensors, truth, sensor_rng)
        faults = self.settings.sensor_faults
        sensed, held = faults.reported(sensed, state.held, now)
        used_as = state.used_as + truth.amperes * self.dt
        snapshot = BoatSnapshot(
            boot_us=round((now - state.zero_s) * 1e6),
            unix_us=round((self.settings.unix_s + now) * 1e6),
            armed=armed,
            sensed=sensed,
            pulses=self._pulses_by_channel(past[-1]),
            throttle=past[-1].effort,
            amperes=truth.amperes,
            used_as=used_as,
            remaining=1.0 - self._hull.battery.drained(used_as),
            local=state.local,
            origin=self._origin,
            fix=faults.fix(now),
            ekf_flags=faults.ekf_flags(now),
        )
        state = replace(
            state,
            tick=state.tick + 1,
            hull=hull,
            past=past,
            sensors=sensors,
            used_as=used_as,
            held=held,
            track=track,
        )
        return self._transmit(state, snapshot, now, fault_rng)

    def _transmit(
        self, state: BoatState, snapshot: BoatSnapshot, now: float, fault_rng: Generator
    ) -> tuple[BoatState, list[TimedFrame]]:
        """The frames that the boat and the ground station beside it send at this moment."""
        frames = self._station_frames(state, now)
        station = state.station_frames + len(frames)
        if now + TOLERANCE_S < state.sends_s:
            return replace(state, station_frames=station), frames
        names = due_messages(state.streams, now)
        streamed = [message for name in names for message in messages_named(name, snapshot)]
        messages = [
            *(self._perhaps_invalid(message, fault_rng) for message in streamed),
            *state.queue[:ANSWERS_PER_TICK],
        ]
        boot_s, system = snapshot.boot_us * 1e-6, self.settings.system_id
        frames += [
            TimedFrame(now, boot_s, system, self._packer.frame(m, state.frames + i))
            for i, m in enumerate(messages)
        ]
        return replace(
            state,
            streams=after_sending(state.streams, names, now),
            queue=state.queue[ANSWERS_PER_TICK:],
            frames=state.frames + len(messages),
            station_frames=station,
        ), frames

    def _perhaps_invalid(self, message: Message, rng: Generator) -> Message:
        share = self.settings.faults.nonsense
        if not share or message.get_type() == "HEARTBEAT" or rng.random() >= share:
            return message
        return with_invalid_field(message, rng)

    def _station_frames(self, state: BoatState, now: float) -> list[TimedFrame]:
        """The heartbeat of a ground station, once a second."""
        if not self.settings.station or (state.tick - 1) % round(self.settings.loop_hz):
            return []
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
        )
        raw = self._station_packer.frame(beat, state.station_frames)
        return [TimedFrame(now, now, STATION_SYSTEM, raw)]

    def _armed(self, state: BoatState, now: float) -> bool:
        begin, end = self.settings.armed
        return begin <= now < end and now + TOLERANCE_S >= state.sends_s

    def _pulses_by_channel(self, outputs: ActuatorOutputs) -> tuple[int, ...]:
        pulses = [0] * CHANNELS
        for channel, pulse in zip(self._channels, outputs.pulses, strict=True):
            pulses[channel - 1] = pulse
        return tuple(pulses)

    def _reboot_if_due(self, state: BoatState, now: float) -> BoatState:
        """The same state, or that of an autopilot that has just restarted."""
        ahead = self.settings.faults.reboots[state.reboots :]
        if not ahead or now + TOLERANCE_S < ahead[0].at_s:
            return state
        return self._boot(
            replace(
                state,
                zero_s=now,
                sends_s=now + ahead[0].down_s,
                reboots=state.reboots + 1,
                local=(float(state.hull[0]), float(state.hull[1])),
                queue=(),
                frames=0,
            )
        )

    def _boot(self, state: BoatState) -> BoatState:
        """Streams at their default rates; banner and parameters wait to be sent."""
        banner = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, BANNER.encode())
        parameters = self._responder.parameters if self.settings.parameters else ()
        streams = start_streams(self.settings.rates, state.sends_s)
        return replace(state, streams=streams, queue=(banner, *parameters))


def _generator(state: Any) -> Generator:
    """A generator that goes on from that state."""
    bits = PCG64(0)
    bits.state = state
    return Generator(bits)
