"""Rules that turn messages into quantities, and the conversions that several formats share.

A mapping function takes one message (attributes are scalars) or all messages of one name
(attributes are columns) and returns facts: pairs of a quantity and its values, in SI units. A
value that the boat did not give is NaN: sentinels, scales and units end here. The functions and
the table of rules of each format stand in its own folder (`mavlink/mapping.py`, …).

Parameters of the autopilot say which output channel drives what (for `shadow init`); its banner is
read here too.

Latitude and longitude become metres on the plane that touches WGS-84 at an origin, and back:

    north = (φ − φ0) M,   east = (λ − λ0) N cos φ0
    M = a (1 − e²) / (1 − e² sin² φ0)^1.5,   N = a / (1 − e² sin² φ0)^0.5

Valid for: some kilometres around the origin, at sea level. Source: NIMA TR8350.2 (WGS-84).
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import IntEnum, IntFlag, StrEnum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from gateway.samples import CHANNELS, Quantity, Samples
from sim.state import Floats

Column = Any  # a scalar or a (K,) array: mapping functions do not ask which
Facts = tuple[tuple[Quantity, tuple[Column, ...]], ...]

PX4_STOPPED_US = 900.0  # of an output that is disarmed or stopped: PX4's pwm_out_sim
PX4_CONSTANT = 0  # of `estimator_faults`
SHORTEST_US, LONGEST_US = 400.0, 2600.0  # outside these a servo gets no pulse that it understands
FIX_2D, FIX_3D = 2, 3  # GNSS fix type
LEVEL_RAD = 0.1  # of roll and pitch; chosen
MIN_COS_PITCH = 0.4  # of a bow that points nearly straight up or down; chosen
UNIX_FROM_US = 1_000_000_000_000_000  # larger counters are Unix time (2001), not time since boot
CREDIBLE_US = 1 << 52  # 142 years: a larger one is damaged


def moment_of(unix_s: float) -> datetime | None:
    """The moment in UTC of a time of the boat's clock [s]; None before 2001: such a clock counts
    from something else, or was never set.
    """
    return datetime.fromtimestamp(unix_s, UTC) if unix_s * 1e6 >= UNIX_FROM_US else None


STATUS_CONFIRMED_S = 1.2  # of fix and EKF: longer than one damaged report a second lasts


class EstimatorFault(IntFlag):
    """What an autopilot's filter says is wrong with it."""

    ATTITUDE = 1  # it has none
    VELOCITY = 2  # none over ground
    POSITION = 4  # none, or it is held constant
    GLITCH = 8  # of the GNSS receiver
    REJECTS = 16  # innovations at or near the gate: the estimate and a sensor disagree


STATUS_ATTITUDE, STATUS_VELOCITY, STATUS_POSITION = 1, 2, 8 | 16  # relative or absolute position
STATUS_CONSTANT_POSITION = 128
EKF_GATE = 0.8  # square root of the test ratio: ArduPilot's own failsafe (FS_EKF_THRESH)


def estimator_faults(
    flags: Any, glitch: int, ratios: tuple[Any, ...], constant: int = STATUS_CONSTANT_POSITION
) -> Any:
    """Solution status of an autopilot's filter, square roots of its test ratios -> its faults.

    The low bits are alike in EKF_STATUS_REPORT, ESTIMATOR_STATUS and XKF4; `glitch` is not. With
    `constant` the position is held and not measured; PX4 has no such bit: it sets ArduPilot's of a
    healthy filter at rest too. A ratio of a sensor that there is not is NaN.
    """
    bits = np.asarray(flags, np.int64)
    largest = np.fmax.reduce(np.asarray(np.broadcast_arrays(*ratios), np.float64), axis=0)
    rejects = largest >= EKF_GATE
    wrong = (
        ((bits & STATUS_ATTITUDE) == 0) * int(EstimatorFault.ATTITUDE)
        + ((bits & STATUS_VELOCITY) == 0) * int(EstimatorFault.VELOCITY)
        + (((bits & STATUS_POSITION) == 0) | ((bits & constant) != 0))
        * int(EstimatorFault.POSITION)
        + ((bits & glitch) != 0) * int(EstimatorFault.GLITCH)
        + rejects * int(EstimatorFault.REJECTS)
    )
    return np.asarray(wrong, np.float64)


class Counter(IntEnum):
    """Which clock of the boat a message carries."""

    RECEIPT = 0  # none: the moment follows from the receipt
    BOOT_MS = 1  # time_boot_ms: uint32, ms since boot, at sending
    BOOT_US = 2  # time_usec or TimeUS: uint64, µs since boot, at sending
    BOOT_US32 = 3  # time_usec that is, or may be, a uint32: wraps every 71.6 minutes
    SAMPLE_US = 4  # time_usec: uint64, µs since boot at the measurement, which may be old


COUNTER_FIELD = {
    Counter.BOOT_MS: "time_boot_ms",
    Counter.BOOT_US: "time_usec",
    Counter.BOOT_US32: "time_usec",
    Counter.SAMPLE_US: "time_usec",
}


@dataclass(frozen=True)
class Rule:
    """How one message (or some of its instances) becomes samples of `source`.

    equivalent, channels, on_change: as in `Samples`
    """

    message: str
    facts: Callable[[Any], Facts]
    counter: Counter
    source: str = ""  # default: the message's name
    instance: tuple[str, ...] = ()  # names under which the definitions number instances
    number: int = 0  # the instance that counts
    field: str = ""  # field of the counter; default by `COUNTER_FIELD`
    equivalent: str = ""  # default: the source
    channels: tuple[int, int] = (1, CHANNELS)
    on_change: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", self.source or self.message)
        object.__setattr__(self, "field", self.field or COUNTER_FIELD.get(self.counter, ""))
        object.__setattr__(self, "equivalent", self.equivalent or self.source)


def instance_of(message: Any, rule: Rule, unnamed: Column) -> Column:
    """Instance number of a message (or of each row); `unnamed` where it carries none."""
    for name in rule.instance:
        if hasattr(message, name):
            return getattr(message, name)
    return unnamed


def counter_us(message: Any, rule: Rule) -> Column:
    """The boat's counter [µs] of a message or of each row; 0 where the message has none."""
    raw = getattr(message, rule.field, 0) if rule.field else 0
    unit = 1000 if rule.counter == Counter.BOOT_MS else 1
    if isinstance(raw, int):
        return min(raw, UNIX_FROM_US) * unit
    column = np.minimum(np.asarray(raw).astype(np.uint64), np.uint64(UNIX_FROM_US))
    return column.astype(np.int64) * np.int64(unit)


def as_given(names: Mapping[Quantity, str]) -> Callable[[Any], Facts]:
    """Quantity -> names of its fields, which need no conversion: a mapping function of them all."""
    plan = [(quantity, tuple(fields.split())) for quantity, fields in names.items()]
    return lambda m: tuple((q, tuple(getattr(m, field) for field in fields)) for q, fields in plan)


def known(value: Column, sentinel: float) -> Column:
    """The value as float, NaN where it is the sentinel that stands for "not known"."""
    value = np.asarray(value, dtype=np.float64)
    return np.where(value == sentinel, np.nan, value)


def only_where(condition: Column, value: Column) -> Column:
    """The value as float, NaN where the condition does not hold."""
    return np.where(condition, np.asarray(value, dtype=np.float64), np.nan)


def along(speed: Column, course: Column) -> tuple[Column, Column]:
    """Speed [m/s] towards a course [rad from north] -> north, east [m/s]."""
    return speed * np.cos(course), speed * np.sin(course)


def latitude_longitude(lat_e7: Column, lon_e7: Column) -> tuple[Column, Column]:
    """Degrees × 1e7 -> degrees; 0, 0 stands for "not known"."""
    lat, lon = np.asarray(lat_e7) * 1e-7, np.asarray(lon_e7) * 1e-7
    given = (lat != 0.0) | (lon != 0.0)
    return only_where(given, lat), only_where(given, lon)


def euler(w: Column, x: Column, y: Column, z: Column) -> tuple[Column, Column, Column]:
    """Quaternion body -> NED -> roll, pitch, yaw [rad]; NaN where it has no length."""
    w, x, y, z = (np.asarray(part, dtype=np.float64) for part in (w, x, y, z))
    length = w * w + x * x + y * y + z * z
    valid = length > 0.5
    length = only_where(valid, length)
    roll = np.arctan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
    pitch = np.arcsin(np.clip(2 * (w * y - z * x) / length, -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return only_where(valid, roll), pitch, only_where(valid, yaw)


def heading_rate(roll: Column, pitch: Column, pitch_rate: Column, yaw_rate: Column) -> Column:
    """Body rates q, r -> rate of the heading, ψ̇ = (q sin φ + r cos φ) / cos θ [rad/s].

    A boat that rolls by 20° in waves turns its bow by pitching. On one that is level (`LEVEL_RAD`)
    the gyro is taken as it is: one that is frozen is known by its last bit. Within 25° of a bow
    that points straight up or down the heading means little: there cos θ is taken as 0.4. NaN where
    roll or pitch is no finite number.
    """
    level = (abs(roll) < LEVEL_RAD) & (abs(pitch) < LEVEL_RAD)
    if level is True:  # one message: nothing to turn
        return yaw_rate
    with np.errstate(invalid="ignore"):
        upright = np.maximum(np.cos(pitch), MIN_COS_PITCH)
        turned = (pitch_rate * np.sin(roll) + yaw_rate * np.cos(roll)) / upright
    return np.where(level, yaw_rate, turned)


def quaternion(q: Column) -> tuple[Column, ...]:
    """A list of four numbers or a (K, 4) column -> its four components."""
    parts = np.asarray(q, dtype=np.float64)
    return tuple(parts[..., i] for i in range(4))


def servo_pulses(first: int, columns: list[Column], stopped_us: float = np.nan) -> Facts:
    """Pulses [µs] of consecutive channels -> all 32 channels.

    NaN for 0, 65535 and what no servo takes, for the one by which an autopilot says that an output
    is stopped (NaN: it has none), and for the channels before and after.
    """
    if isinstance(columns[0], int):  # one message: for so few numpy takes four times as long
        low, high, nan = SHORTEST_US, LONGEST_US, np.nan
        found = [nan] * (first - 1)
        found += [float(w) if low <= w <= high and w != stopped_us else nan for w in columns]
        found += [nan] * (CHANNELS - len(found))
        return ((Quantity.ACTUATORS, tuple(found)),)
    width = np.array(columns, dtype=np.float64)
    taken = (width >= SHORTEST_US) & (width <= LONGEST_US) & (width != stopped_us)
    pulses = list(only_where(taken, width))
    unreported = np.full(np.shape(pulses[0]), np.nan)
    values = [unreported] * (first - 1) + pulses
    return ((Quantity.ACTUATORS, tuple(values + [unreported] * (CHANNELS - len(values)))),)


def merge_pulses(previous: Any, channels: tuple[int, int], values: Any) -> Any:
    """The 32 pulses known so far and those that a source reports -> the 32 pulses now [µs].

    Inside the source's channels NaN means "no pulse", outside them "not reported".
    """
    first, last = channels
    now = np.array(previous, dtype=np.float64)
    now[first - 1 : last] = np.asarray(values, dtype=np.float64)[first - 1 : last]
    return now


class OutputFunction(StrEnum):
    """What an output channel moves."""

    THROTTLE = "throttle"
    THROTTLE_LEFT = "throttle left"
    THROTTLE_RIGHT = "throttle right"
    MOTOR = "motor"
    STEERING = "steering"
    PASSTHROUGH = "passthrough"


THRUST_FUNCTIONS = (
    OutputFunction.THROTTLE,
    OutputFunction.THROTTLE_LEFT,
    OutputFunction.THROTTLE_RIGHT,
    OutputFunction.MOTOR,
)
FUNCTIONS: Mapping[int, OutputFunction] = {  # SERVOn_FUNCTION
    70: OutputFunction.THROTTLE,
    73: OutputFunction.THROTTLE_LEFT,
    74: OutputFunction.THROTTLE_RIGHT,
    26: OutputFunction.STEERING,
    1: OutputFunction.PASSTHROUGH,
    **dict.fromkeys(range(33, 37), OutputFunction.MOTOR),
    **dict.fromkeys(range(51, 67), OutputFunction.PASSTHROUGH),
}
LIMITS_US = (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))  # ArduPilot's own, where unset
BANNER = re.compile(r"(Ardu\w+|APM\w*|PX4|Blimp)\b.*\d+\.\d+")  # "ArduRover V4.6.3 (3fc7011a)"


@dataclass(frozen=True)
class Actuator:
    """One output channel that moves the boat."""

    channel: int  # 1-based
    function: int  # SERVOn_FUNCTION
    kind: OutputFunction
    pwm: tuple[float, float, float]  # lowest, neutral, highest [µs]
    reversed: bool

    @property
    def motor(self) -> int | None:
        """Number of the motor (1 to 4) where its function is a motor's."""
        return self.function - 32 if self.kind is OutputFunction.MOTOR else None


def actuators(parameters: Mapping[str, float]) -> list[Actuator]:
    """Parameters -> the channels that move the boat, in order."""
    found = []
    for channel in range(1, CHANNELS + 1):
        function = int(parameters.get(f"SERVO{channel}_FUNCTION", 0))
        if function in FUNCTIONS:
            low, neutral, high = (
                float(parameters.get(f"SERVO{channel}_{name}", default))
                for name, default in LIMITS_US
            )
            reversed_ = bool(parameters.get(f"SERVO{channel}_REVERSED", 0.0))
            pwm = (low, neutral, high)
            found.append(Actuator(channel, function, FUNCTIONS[function], pwm, reversed_))
    return found


def banner(lines: Iterable[str]) -> str:
    """The first text that names an autopilot's software and its version; empty without one."""
    return next((line for line in lines if BANNER.match(line)), "")


A = 6_378_137.0  # m
E2 = 6.694379990141e-3


class Origin(NamedTuple):
    """Where a local frame starts."""

    latitude_deg: float
    longitude_deg: float


@lru_cache(maxsize=64)  # more than boats of one process
def metres_per_degree(origin: Origin) -> tuple[float, float]:
    """Origin -> m per degree of latitude, of longitude."""
    sine = np.sin(np.radians(origin.latitude_deg))
    meridian = A * (1.0 - E2) / (1.0 - E2 * sine**2) ** 1.5
    parallel = A / (1.0 - E2 * sine**2) ** 0.5 * np.cos(np.radians(origin.latitude_deg))
    return float(np.radians(meridian)), float(np.radians(parallel))


def to_local(degrees: Floats, origin: Origin) -> Floats:
    """(..., 2) [latitude, longitude, degrees] -> (..., 2) [north, east, m]."""
    turned = degrees[..., 1] - origin.longitude_deg
    east = (turned + 180.0) % 360.0 - 180.0  # across the date line
    north = degrees[..., 0] - origin.latitude_deg
    return np.stack([north, east], axis=-1) * np.array(metres_per_degree(origin))


@lru_cache(maxsize=64)  # more than boats of one process
def _degrees_from(origin: Origin) -> tuple[Floats, Floats]:
    """What `to_degrees` divides by and adds (2,)."""
    return np.array(metres_per_degree(origin)), np.array(origin)


def to_degrees(metres: Floats, origin: Origin) -> Floats:
    """(..., 2) [north, east, m] -> (..., 2) [latitude, longitude, degrees]."""
    scale, place = _degrees_from(origin)
    return np.asarray(metres / scale + place)


# Beyond these it is a damaged field: chosen, not measured.
MAX_VOLTAGE_V, MAX_WIND_MPS = 1000.0, 100.0
MAX_LOCAL_M = 1e6  # no local frame reaches further


def on_earth(latitude_deg: Column, longitude_deg: Column) -> Column:
    """Are these the degrees of a place?"""
    return (abs(latitude_deg) <= 90.0) & (abs(longitude_deg) <= 180.0)


def in_local_frame(north_m: Column, east_m: Column) -> Column:
    """Can a local frame reach there?"""
    return (abs(north_m) < MAX_LOCAL_M) & (abs(east_m) < MAX_LOCAL_M)


def of_a_battery(voltage_v: Column) -> Column:
    """Can a boat's battery have that voltage?"""
    return (voltage_v > 0.0) & (voltage_v < MAX_VOLTAGE_V)


def of_the_air(north_mps: Column, east_mps: Column) -> Column:
    """Can the air move like that?"""
    return (abs(north_mps) < MAX_WIND_MPS) & (abs(east_mps) < MAX_WIND_MPS)


CREDIBLE: Mapping[Quantity, Callable[..., Column]] = {
    Quantity.VOLTAGE: of_a_battery,
    Quantity.WIND: of_the_air,
    Quantity.ORIGIN: on_earth,
    Quantity.GLOBAL_POSITION: on_earth,
}


def credible(samples: Samples) -> Samples:
    """Without what is wild: a live link passes over the same, and what came before it holds on."""
    if samples.quantity not in CREDIBLE:
        return samples
    kept = CREDIBLE[samples.quantity](*samples.values.T)
    return samples if kept.all() else samples.where(kept)


def distance_m(one: Origin, other: Origin) -> float:
    """Distance between two places."""
    return float(np.hypot(*to_local(np.array(one), other)))
