"""How often boats are asked for which messages: everything, or what a slow radio can carry.

A radio pair at 57600 baud carries less than half of the 5.8 kB/s of its serial line one way, and
the autopilot's own streams share it. `radio` takes 1.2 kB/s at most and keeps what the model needs:
heading, velocity, and commands above the 5 Hz below which nothing can be said of their lag.
"""

from collections.abc import Mapping
from types import MappingProxyType

from gateway.errors import BadInput

MOST_HZ = 1000.0
FULL_HZ: Mapping[str, float] = MappingProxyType(
    {
        "ATTITUDE": 50.0,
        "LOCAL_POSITION_NED": 25.0,
        "SERVO_OUTPUT_RAW": 25.0,
        "GLOBAL_POSITION_INT": 5.0,
        "GPS_RAW_INT": 5.0,
        "SYS_STATUS": 2.0,
        "BATTERY_STATUS": 2.0,
        "SYSTEM_TIME": 1.0,
    }
)
RADIO_HZ: Mapping[str, float] = MappingProxyType(
    {
        "ATTITUDE": 10.0,
        "LOCAL_POSITION_NED": 5.0,
        "SERVO_OUTPUT_RAW": 8.0,
        "GLOBAL_POSITION_INT": 1.0,
        "GPS_RAW_INT": 1.0,
        "SYS_STATUS": 1.0,
        "BATTERY_STATUS": 0.0,  # the voltage is in SYS_STATUS too
        "SYSTEM_TIME": 1.0,
    }
)
PRESETS: Mapping[str, Mapping[str, float]] = MappingProxyType({"full": FULL_HZ, "radio": RADIO_HZ})


def check_rates(rates_hz: Mapping[str, float]) -> None:
    """Raise BadInput for what cannot be asked for; a rate of 0 is not asked for."""
    for name, rate in rates_hz.items():
        if name not in FULL_HZ and not _is_message(name):
            raise BadInput(f"[links.rates] {name}: there is no such MAVLink message")
        if not 0.0 <= rate <= MOST_HZ:
            raise BadInput(
                f"[links.rates] {name} = {rate}: expected Hz, 0 (not asked for) to {MOST_HZ:.0f}"
            )


def _is_message(name: str) -> bool:
    from gateway.ingest.definitions import ids_by_name  # loads pymavlink, half a second

    return name in ids_by_name()
