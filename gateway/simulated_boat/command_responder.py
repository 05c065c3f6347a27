"""Message streams: each has an interval and a moment at which it is due next.

Messages to frames, signed where there is a key; and fields with invalid values.

The autopilot's answers to requests for rates, messages and parameters. Pure.

Every other command is refused: a simulated boat is not steered over the link.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from numpy.random import Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.simulated_boat import Rates
from gateway.simulated_boat.telemetry import BY_ID, MESSAGES, Message

PHASE_STEP = 0.618034  # of successive streams: a golden ratio, so that their phases never meet
TOLERANCE_S = 1e-6  # for sums of binary fractions


class Stream(NamedTuple):
    """Interval [s] (infinite: once) and when it is due next [s since the start]."""

    interval: float
    due: float


Streams = Mapping[str, Stream]  # in the order of `MESSAGES`


def start_streams(rates: Rates, now: float) -> Streams:
    """All streams from a moment on, spread over their intervals; the heartbeat comes first."""
    order = [name for name in MESSAGES if name in rates]
    return {
        name: Stream(1.0 / rates[name], now + (i * PHASE_STEP % 1.0) / rates[name])
        for i, name in enumerate(order)
    }


def due_messages(streams: Streams, now: float) -> list[str]:
    """Names of the messages to send at this moment."""
    return [name for name, stream in streams.items() if stream.due <= now + TOLERANCE_S]


def after_sending(streams: Streams, names: list[str], now: float) -> Streams:
    """The streams after these messages were sent; one that cannot keep up skips."""
    after = dict(streams)
    for name in names:
        interval, was_due = streams[name]
        next_due = was_due + interval
        after[name] = Stream(interval, next_due if next_due > now else now + interval)
    return {name: stream for name, stream in after.items() if stream.due < math.inf}


def with_interval(streams: Streams, name: str, interval: float, now: float) -> Streams:
    """One stream at another interval [s] from now on; 0 ends it."""
    after = {**streams, name: Stream(interval, now)} if interval > 0.0 else dict(streams)
    if interval <= 0.0:
        after.pop(name, None)
    return {key: after[key] for key in MESSAGES if key in after}


def with_one_message(streams: Streams, name: str, now: float) -> Streams:
    """One message now; its stream goes on from here."""
    interval = streams[name].interval if name in streams else math.inf
    return with_interval(streams, name, interval, now)


SIGNING_EPOCH_S = 1_420_070_400  # 1 January 2015
CLOCKS = ("time_boot_ms", "time_usec", "time_unix_usec")  # left alone: another kind of fault
INVALID_FLOATS = (float("nan"), float("inf"), 1e30)
EXTREME_INTEGERS = {
    "uint8_t": 255, "int8_t": -128, "uint16_t": 65535, "int16_t": -32768,
    "uint32_t": 4294967295, "int32_t": -2147483648,
}  # fmt: skip


class FramePacker:
    """Packs messages with address, number and signature; holds pymavlink's packer, no state."""

    def __init__(self, system: int, component: int, key: bytes | None, unix_s: float) -> None:
        self._mav = mavlink.MAVLink(None, system, component)
        self._since = round((unix_s - SIGNING_EPOCH_S) * 1e5)  # units of 10 µs
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.link_id = 0
            self._mav.signing.sign_outgoing = True

    def frame(self, message: Message, number: int) -> bytes:
        """The `number`-th frame of this sender."""
        self._mav.seq = number % 256
        self._mav.signing.timestamp = self._since + number
        return bytes(message.pack(self._mav))


def with_invalid_field(message: Message, rng: Generator) -> Any:
    """The same message, one field of it with a value that no boat has."""
    names = [
        (name, kind)
        for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True)
        if name not in CLOCKS and (kind in EXTREME_INTEGERS or kind == "float")
        and isinstance(getattr(message, name), int | float)
    ]  # fmt: skip
    if names:
        name, kind = names[int(rng.integers(len(names)))]
        value = INVALID_FLOATS[int(rng.integers(3))] if kind == "float" else EXTREME_INTEGERS[kind]
        setattr(message, name, value)
    return message


ACCEPTED, DENIED, UNSUPPORTED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)
GROUPS: Mapping[int, tuple[str, ...]] = {  # REQUEST_DATA_STREAM, as ArduPilot groups them
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: ("RAW_IMU",),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: ("SYS_STATUS", "GPS_RAW_INT"),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: ("SERVO_OUTPUT_RAW",),
    mavlink.MAV_DATA_STREAM_POSITION: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    mavlink.MAV_DATA_STREAM_EXTRA1: ("ATTITUDE",),
    mavlink.MAV_DATA_STREAM_EXTRA2: ("VFR_HUD",),
    mavlink.MAV_DATA_STREAM_EXTRA3: ("BATTERY_STATUS", "SYSTEM_TIME"),
}


@dataclass(frozen=True)
class Response:
    """The streams from now on, and messages to send."""

    streams: Streams
    messages: tuple[Message, ...] = ()


@dataclass(frozen=True)
class CommandResponder:
    """Answers the requests to one boat."""

    system_id: int
    rates: Rates
    parameters: tuple[Message, ...]

    def answer(self, streams: Streams, request: Message, now: float) -> Response:
        """Any message received -> response; nothing changes where it is not for this boat."""
        handler = _HANDLERS.get(request.get_type())
        if handler is None or request.target_system not in (0, self.system_id):
            return Response(streams)
        if request.target_component not in (0, mavlink.MAV_COMP_ID_AUTOPILOT1):
            return Response(streams)
        return handler(self, streams, request, now)

    def command(self, streams: Streams, request: Message, now: float) -> Response:
        """COMMAND_LONG, COMMAND_INT: done or not, it is acknowledged."""
        result, after = self._execute(streams, request, now)
        ack = mavlink.MAVLink_command_ack_message(
            request.command, result, 0, 0, request.get_srcSystem(), request.get_srcComponent()
        )
        return Response(after.streams, (ack, *after.messages))

    def _execute(self, streams: Streams, request: Message, now: float) -> tuple[int, Response]:
        same = Response(streams)
        if request.command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return ACCEPTED, Response(with_one_message(streams, "AUTOPILOT_VERSION", now))
        name = _message_name(request.param1)
        if request.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            if name is None or not math.isfinite(request.param2):
                return DENIED, same
            return ACCEPTED, Response(
                with_interval(streams, name, self._interval(name, request.param2), now)
            )
        if request.command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL and name is not None:
            interval_us = round(streams[name].interval * 1e6 if name in streams else -1.0)
            number = int(request.param1)
            return ACCEPTED, Response(
                streams, (mavlink.MAVLink_message_interval_message(number, interval_us),)
            )
        if request.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return (
                (DENIED, same)
                if name is None
                else (ACCEPTED, Response(with_one_message(streams, name, now)))
            )
        return UNSUPPORTED, same

    def _interval(self, name: str, wanted_us: float) -> float:
        """Requested interval [µs], −1 off, 0 the default -> [s], 0 for off."""
        if wanted_us == 0.0:
            return 1.0 / self.rates[name] if name in self.rates else 0.0
        return max(wanted_us, 0.0) * 1e-6

    def list_parameters(self, streams: Streams, request: Message, now: float) -> Response:
        """PARAM_REQUEST_LIST."""
        return Response(streams, self.parameters)

    def read_parameter(self, streams: Streams, request: Message, now: float) -> Response:
        """PARAM_REQUEST_READ by index, or by name where the index is −1."""
        index, name = request.param_index, _parameter_name(request)
        found = [
            m for i, m in enumerate(self.parameters)
            if i == index or (index < 0 and _parameter_name(m) == name)
        ]  # fmt: skip
        return Response(streams, tuple(found))

    def data_stream(self, streams: Streams, request: Message, now: float) -> Response:
        """REQUEST_DATA_STREAM: a whole group at one rate."""
        rate = request.req_message_rate if request.start_stop else 0
        groups = GROUPS if request.req_stream_id == 0 else [request.req_stream_id]
        for name in (name for group in groups for name in GROUPS.get(group, ())):
            streams = with_interval(streams, name, 1.0 / rate if rate else 0.0, now)
        return Response(streams)


def _message_name(number: float) -> str | None:
    """Message id as a command's float -> its name; None where the boat cannot send it."""
    return BY_ID.get(int(number)) if math.isfinite(number) else None


def _parameter_name(message: Message) -> str:
    raw = message.param_id
    text = raw.decode(errors="replace") if isinstance(raw, bytes) else str(raw)
    return text.rstrip("\0")


_HANDLERS: Mapping[str, Callable[[CommandResponder, Streams, Message, float], Response]] = {
    "COMMAND_LONG": CommandResponder.command,
    "COMMAND_INT": CommandResponder.command,
    "PARAM_REQUEST_LIST": CommandResponder.list_parameters,
    "PARAM_REQUEST_READ": CommandResponder.read_parameter,
    "REQUEST_DATA_STREAM": CommandResponder.data_stream,
}
