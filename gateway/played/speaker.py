"""Messages to frames, signed where there is a key; and fields that hold nonsense."""

from typing import Any

from numpy.random import Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.played.telemetry import Message

SIGNING_EPOCH_S = 1_420_070_400  # 1 January 2015
CLOCKS = ("time_boot_ms", "time_usec", "time_unix_usec")  # not touched: another kind of fault
ABSURD = (float("nan"), float("inf"), 1e30)
EXTREMES = {
    "uint8_t": 255, "int8_t": -128, "uint16_t": 65535, "int16_t": -32768,
    "uint32_t": 4294967295, "int32_t": -2147483648,
}  # fmt: skip


class Speaker:
    """Gives frames their address, number and signature; holds pymavlink's packer, no state."""

    def __init__(self, system: int, component: int, key: bytes | None, unix_s: float) -> None:
        self._mav = mavlink.MAVLink(None, system, component)
        self._since = round((unix_s - SIGNING_EPOCH_S) * 1e5)  # units of 10 µs
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.link_id = 0
            self._mav.signing.sign_outgoing = True

    def frame(self, message: Message, number: int) -> bytes:
        """The `number`-th frame of this speaker."""
        self._mav.seq = number % 256
        self._mav.signing.timestamp = self._since + number
        return bytes(message.pack(self._mav))


def spoiled(message: Message, dice: Generator) -> Any:
    """The same message with a value in one field that no boat has."""
    names = [
        (name, kind)
        for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True)
        if name not in CLOCKS and (kind in EXTREMES or kind == "float")
        and isinstance(getattr(message, name), int | float)
    ]  # fmt: skip
    if names:
        name, kind = names[int(dice.integers(len(names)))]
        value = ABSURD[int(dice.integers(3))] if kind == "float" else EXTREMES[kind]
        setattr(message, name, value)
    return message
