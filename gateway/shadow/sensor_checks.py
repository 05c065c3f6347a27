"""Are the boat's own data fit to judge a model by? What GPS, autopilot's filter, compass and each
source say of themselves, event by event.

    compass   J = Σ (Δψ − ∫ r dt), forgotten over `JUMP_MEMORY_S`: beyond `MIN_JUMP_RAD`, and what
              r itself explains (its low-pass, scale and time stamps), the heading moved though
              the gyro saw no such turn
    frozen    the same value to the last bit for `FROZEN_S`, where the source has digits to spare;
              one with few digits only where another source says that it should have moved

What is found makes measurements unfit from that event on until it is well again, and for
`SETTLE_S` more: the autopilot's filter has to find back. A compass that jumped and stays there is
believed after `JUMP_HELD_S`: which of the two headings was right, the model's errors then tell.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from enum import IntFlag
from math import isfinite

import numpy as np

from gateway.estimation import MeasurementKind
from gateway.estimation.events import Events
from gateway.ingest.mapping import FIX_3D, STATUS_CONFIRMED_S, EstimatorFault
from gateway.shadow import FilterInputs
from sim.kernel.compiled import compiled
from sim.state import Floats, Ints, wrap

# All chosen, not measured.
SETTLE_S = 5.0
MIN_JUMP_RAD = 0.17  # ten degrees: what an autopilot's filter corrects in seconds is less
JUMP_BACK_RAD = 0.09
JUMP_MEMORY_S = 5.0
JUMP_HELD_S = 120.0
GYRO_SLACK_S = 0.25  # of the turn rate: low-pass, scale, time stamps; real logs need as much
CONFIRMED_S = 0.5  # a jump: until then it may be one wild value …
MIN_HEADINGS_TO_CONFIRM = 1.5  # … or the start of a turn, of headings that are as far apart
MAX_ANGLE_RAD = 1e4  # beyond it a heading or turn rate is a damaged field
MAX_YAW_GAP_S = 0.5  # between headings, for the gyro to be compared
FROZEN_S, FROZEN_COUNT = 3.0, 8
FROZEN_COARSE_S = 5.0  # of a source with few digits
MOVING_MPS = 0.3  # above it a position cannot stand still
TURNED_RAD = 0.2  # by the gyro, while a coarse heading stood still
UNHEARD_S = 3.0  # outputs that are told at all are mostly told more often; of a slow stream …
SLOW_UNHEARD_S = 12.0  # … so many of its gaps, at most this, as of one that has just begun
GAPS, GAP_KEPT = 2.5, 0.9  # that a stream may be silent; the longest counts less with each message
MOST_COUNTED_S = 2.0  # of one gap in their mean: a silence makes no slow stream
SELDOM_S, OFTEN_S = 0.8, 0.6  # mean gaps beyond and below which outputs are told too seldom or not
MAX_SILENT_STEP_S = 1.0  # of a longer silence of all it counts so much


class SensorFault(IntFlag):
    """Faults that make measurements unfit to judge a model by, as bits."""

    GPS = 1
    EKF_ATTITUDE = 2
    EKF_VELOCITY = 4
    EKF_POSITION = 8
    EKF_GLITCH = 16
    EKF_REJECTS = 32
    COMPASS = 64
    FROZEN_HEADING = 128
    FROZEN_TURN = 256
    FROZEN_VELOCITY = 512
    FROZEN_POSITION = 1024
    SETTLING = 2048  # all is well again, but only just
    UNDRIVEN = 4096  # a motor of the vessel file has never had a pulse, others have
    UNHEARD = 8192  # nobody tells of the outputs, or not any more
    SELDOM = 16384  # so seldom that nobody knows what the motors did between


REASONS = tuple(fault for fault in SensorFault if fault is not SensorFault.SETTLING)
# what is said while it lasts, and once it is over
WORDS: dict[SensorFault, tuple[str, str]] = {
    SensorFault.GPS: ("the GPS has no 3-D fix", "the GPS has a 3-D fix again"),
    SensorFault.EKF_ATTITUDE: (
        "the autopilot's EKF has no attitude", "the autopilot's EKF has its attitude again",
    ),
    SensorFault.EKF_VELOCITY: (
        "the autopilot's EKF has no velocity", "the autopilot's EKF has its velocity again",
    ),
    SensorFault.EKF_POSITION: (
        "the autopilot's EKF has no position", "the autopilot's EKF has its position again",
    ),
    SensorFault.EKF_GLITCH: (
        "the autopilot's EKF reports a GPS glitch", "the GPS glitch is over",
    ),
    SensorFault.EKF_REJECTS: (
        "the autopilot's EKF is at odds with its sensors",
        "the autopilot's EKF agrees with its sensors again",
    ),
    SensorFault.COMPASS: (
        "the heading jumped though the gyro saw no such turn",
        "the heading is believed again",
    ),
    SensorFault.FROZEN_HEADING: ("the heading is frozen", "the heading moves again"),
    SensorFault.FROZEN_TURN: ("the gyro is frozen", "the gyro moves again"),
    SensorFault.FROZEN_VELOCITY: ("the velocity is frozen", "the velocity moves again"),
    SensorFault.FROZEN_POSITION: ("the position is frozen", "the position moves again"),
    SensorFault.UNDRIVEN: (
        "an output of the vessel file gets no pulse", "all outputs of the vessel file get pulses",
    ),
    SensorFault.UNHEARD: ("nobody tells of the outputs", "the outputs are told again"),
    SensorFault.SELDOM: (
        "the outputs are told too seldom (twice a second is enough)",
        "the outputs are told often enough",
    ),
}  # fmt: skip

YAW, YAW_RATE = int(MeasurementKind.YAW), int(MeasurementKind.YAW_RATE)
VELOCITY, POSITION = int(MeasurementKind.VELOCITY), int(MeasurementKind.POSITION)
BODY_VELOCITY, TICK = int(MeasurementKind.BODY_VELOCITY), int(MeasurementKind.TICK)
GPS, COMPASS, SETTLING, UNHEARD, SELDOM = (
    int(fault)
    for fault in (
        SensorFault.GPS, SensorFault.COMPASS, SensorFault.SETTLING, SensorFault.UNHEARD,
        SensorFault.SELDOM,
    )
)  # fmt: skip
EKF_SHIFT = 1  # of the bits of `gateway.ingest.mapping.EstimatorFault` among these
FROZEN_BIT = np.zeros(len(MeasurementKind), np.int64)
for _kind, _fault in (
    (YAW, SensorFault.FROZEN_HEADING), (YAW_RATE, SensorFault.FROZEN_TURN),
    (VELOCITY, SensorFault.FROZEN_VELOCITY), (BODY_VELOCITY, SensorFault.FROZEN_VELOCITY),
    (POSITION, SensorFault.FROZEN_POSITION),
):  # fmt: skip
    FROZEN_BIT[_kind] = int(_fault)

# columns of what is remembered of each kind of measurement …
Z0, Z1, TIME, CHANGED, SAME, TURNED_THEN = range(6)
# … and places of the rest: rate and integral of the gyro, that at the last heading, the heading's
# sum of jumps (forgotten, and since it jumped), when it jumped, a fix was seen, the last fault, …,
# mean turn rate and how far it has been from that, since when fix or EKF are reported to be ill, …
# when outputs were last told of, for how long others have talked since, the last event, how far
# apart outputs are told at most and on average, and how long a jump waits to be confirmed
(
    TURN, ANGLE, ANGLE_THEN, LEAK, OFFSET, JUMPED, HAD_FIX, UNFIT, BITS, SPEED, MEAN, SPREAD,
    STATUS, HEARD, DEAF, LAST, APART, MEAN_APART, WAIT,
) = range(19)  # fmt: skip


@compiled
def fine(kind: int, value: float) -> bool:
    """Has the source more digits than hundredths of a degree, cm/s, mrad/s?"""
    per_unit = 100.0
    if kind == YAW:
        per_unit = 18000.0 / np.pi
    elif kind == YAW_RATE:
        per_unit = 1000.0
    steps = value * per_unit
    return bool(np.abs(steps - np.rint(steps)) > 1e-4)


@compiled
def note_turn(kinds: Floats, rest: Floats, time: float, rate: float) -> None:
    """Add to the integral of the gyro."""
    step = time - kinds[YAW_RATE, TIME]
    if 0.0 < step <= MAX_YAW_GAP_S:
        rest[ANGLE] += 0.5 * step * (rate + rest[TURN])
        kept = np.exp(-step / JUMP_MEMORY_S)
        rest[MEAN] = kept * rest[MEAN] + (1.0 - kept) * rate
        rest[SPREAD] = max(kept * rest[SPREAD], np.abs(rate - rest[MEAN]))
    rest[TURN] = rate


@compiled
def note_heading(kinds: Floats, rest: Floats, time: float, yaw: float) -> None:
    """Compare the step of a heading that moved with the gyro's, as long as that moves too."""
    step = time - kinds[YAW, CHANGED]
    gyro = time - kinds[YAW_RATE, TIME]
    angle = rest[ANGLE] + (rest[TURN] * gyro if 0.0 < gyro <= MAX_YAW_GAP_S else 0.0)
    stuck = kinds[YAW_RATE, SAME] >= 3.0 and fine(YAW_RATE, rest[TURN])
    if stuck:
        rest[LEAK] = 0.0
    elif 0.0 < step <= MAX_YAW_GAP_S and gyro <= MAX_YAW_GAP_S:
        unseen = wrap(yaw - kinds[YAW, Z0]) - (angle - rest[ANGLE_THEN])
        least = MIN_JUMP_RAD + (rest[SPREAD] + np.abs(rest[MEAN])) * (0.5 * step + GYRO_SLACK_S)
        rest[LEAK] = rest[LEAK] * np.exp(-step / JUMP_MEMORY_S) + unseen
        if np.isfinite(rest[JUMPED]):
            rest[OFFSET] += unseen
            lasted = time - rest[JUMPED]
            # back where it was, or there for so long that it is believed
            if np.abs(rest[OFFSET]) < JUMP_BACK_RAD or lasted > JUMP_HELD_S:
                rest[JUMPED] = np.inf
                rest[LEAK] = 0.0
            elif lasted < rest[WAIT] and np.abs(rest[OFFSET]) < least:
                rest[JUMPED] = np.inf  # the gyro, a moment later, explains it after all
        elif np.abs(rest[LEAK]) > least:
            rest[JUMPED], rest[OFFSET] = time, rest[LEAK]
            # the rate of that very moment is told after the heading: the next one has it
            rest[WAIT] = max(CONFIRMED_S, MIN_HEADINGS_TO_CONFIRM * step)
    elif step > MAX_YAW_GAP_S:
        rest[LEAK] = 0.0
    rest[ANGLE_THEN] = angle


@compiled
def frozen(kinds: Floats, rest: Floats, kind: int) -> bool:
    """Does that kind of measurement stand still though it cannot?"""
    one = kinds[kind]
    seconds = one[TIME] - one[CHANGED]
    if one[SAME] < FROZEN_COUNT or seconds < FROZEN_S:
        return False
    if kind == POSITION:
        return bool(rest[SPEED] > MOVING_MPS)
    if fine(kind, one[Z0]) or ((kind in (VELOCITY, BODY_VELOCITY)) and fine(kind, one[Z1])):
        return True
    if seconds < FROZEN_COARSE_S:
        return False
    if kind == YAW:
        return bool(np.abs(rest[ANGLE] - one[TURNED_THEN]) > TURNED_RAD)
    return bool(kind != YAW_RATE and rest[SPEED] > MOVING_MPS)


@compiled
def longest_gap(before: float, gap: float) -> float:
    """The longest gap of a stream of late [s] after one more; what is long ago counts less."""
    return max(gap, GAP_KEPT * before)


@compiled
def patience(gap: float, least: float, most: float) -> float:
    """How long a stream with such gaps may be silent before it is missed [s]."""
    return min(max(least, GAPS * gap), most)


@compiled
def note_outputs(rest: Floats, time: float, heard: float) -> None:
    """Add to how long others have talked since the outputs were last told of.

    Where all are silent there is nothing to be judged, and who talks first after that is chance.
    Messages of a log overtake one another by a little; a clock that starts anew goes back by more.
    """
    if np.isnan(heard):
        rest[LAST] = time  # disarmed: nobody has to tell, and what was missed still is
        return
    if heard != rest[HEARD]:
        if np.isfinite(rest[HEARD]):
            gap = heard - rest[HEARD]
            rest[APART] = longest_gap(rest[APART], gap)
            counted = min(max(gap, 0.0), MOST_COUNTED_S)
            rest[MEAN_APART] += (1.0 - GAP_KEPT) * (counted - rest[MEAN_APART])
        rest[HEARD], rest[DEAF], rest[LAST] = heard, 0.0, time
    step = time - rest[LAST]
    if step > 0.0 or step < -MAX_SILENT_STEP_S:
        rest[DEAF] += min(max(step, 0.0), MAX_SILENT_STEP_S)
        rest[LAST] = time


@compiled
def check_events(
    kinds: Floats,
    rest: Floats,
    events: tuple[Floats, Ints, Floats],
    held: tuple[Floats, Floats, Floats, Floats],
    out: Ints,
) -> None:
    """K events with what held at each -> bits of `SensorFault` (K,); memory changes in place.

    events  time (K,), kind (K,), z (K, 2)
    held    GPS fix (K,) and faults of the estimator (K,), NaN where unknown; armed (K,), 1 or 0;
            when its outputs were last told of (K,) [s], −inf: never, NaN: nobody has to
    """
    time, kind, z = events
    fix, estimator, armed, heard = held
    for k in range(len(time)):
        what, now = kind[k], time[k]
        sane = np.abs(z[k, 0]) < MAX_ANGLE_RAD or what == POSITION
        if FROZEN_BIT[what] and sane and np.isfinite(now) and now > kinds[what, TIME]:
            if what == YAW_RATE:
                note_turn(kinds, rest, now, z[k, 0])
            elif what == YAW and z[k, 0] != kinds[YAW, Z0]:
                note_heading(kinds, rest, now, z[k, 0])
            elif what in (VELOCITY, BODY_VELOCITY):
                rest[SPEED] = np.hypot(z[k, 0], z[k, 1])
            one = kinds[what]
            one[TIME] = now
            if z[k, 0] == one[Z0] and (z[k, 1] == one[Z1] or what in (YAW, YAW_RATE)):
                one[SAME] += 1.0
            else:
                one[SAME], one[CHANGED], one[TURNED_THEN] = 0.0, now, rest[ANGLE]
            one[Z0], one[Z1] = z[k, 0], z[k, 1]
            bit = FROZEN_BIT[what]
            was = bool(int(rest[BITS]) & bit) and one[SAME] > 0.0
            stuck = armed[k] > 0.0 and (was or frozen(kinds, rest, what))
            rest[BITS] = (int(rest[BITS]) | bit) if stuck else (int(rest[BITS]) & ~bit)
        if fix[k] >= FIX_3D:
            rest[HAD_FIX] = 1.0
        bits, status = int(rest[BITS]), 0
        unknown = not np.isfinite(estimator[k])
        if fix[k] < FIX_3D and (rest[HAD_FIX] > 0.0 or unknown):
            status |= GPS
        if not unknown:
            status |= int(estimator[k]) << EKF_SHIFT
        rest[STATUS] = min(rest[STATUS], now) if status else np.inf
        if status and now - rest[STATUS] >= STATUS_CONFIRMED_S:
            bits |= status
        jumped = now - rest[JUMPED]
        if jumped >= rest[WAIT]:
            bits |= COMPASS
        if what != TICK:
            note_outputs(rest, now, heard[k])
        if rest[DEAF] > patience(rest[APART], UNHEARD_S, SLOW_UNHEARD_S):
            bits |= UNHEARD
        seldom = bool(int(rest[BITS]) & SELDOM)
        if rest[MEAN_APART] > (OFTEN_S if seldom else SELDOM_S):
            bits |= SELDOM
            rest[BITS] = int(rest[BITS]) | SELDOM
        elif seldom:
            bits &= ~SELDOM
            rest[BITS] = int(rest[BITS]) & ~SELDOM
        if bits or status or jumped >= 0.0:
            rest[UNFIT] = now
        if bits == 0 and 0.0 <= now - rest[UNFIT] < SETTLE_S:
            bits = SETTLING
        out[k] = bits


REPORTED = sum(int(fault) << EKF_SHIFT for fault in EstimatorFault) | GPS  # by the boat itself
UNDRIVEN = int(SensorFault.UNDRIVEN)
# until it was seen to fail
ALWAYS_WELL = sum(map(int, REASONS)) & ~REPORTED & ~UNDRIVEN & ~UNHEARD


def reported_well(fix: float, estimator: float, heard: float = np.nan) -> int:
    """GPS fix and faults of the estimator, NaN where unknown, and when outputs were told, −inf:
    never -> what the boat says is well: bits of `SensorFault`."""
    known = isfinite(estimator)
    well = REPORTED & ~GPS & ~(int(estimator) << EKF_SHIFT) if known else 0
    well |= UNHEARD if isfinite(heard) else 0
    return well | GPS if fix >= FIX_3D else well


def clock_text(time_ns: int) -> str:
    """Unix time [ns] -> the time of day in UTC."""
    return f"{datetime.fromtimestamp(time_ns // 1_000_000_000, UTC):%H:%M:%S} UTC"


class SensorMemory:
    """State of the checks between calls; never changed once it was handed out."""

    def __init__(self, kinds: Floats | None = None, rest: Floats | None = None) -> None:
        if kinds is None or rest is None:
            kinds = np.zeros((len(FROZEN_BIT), 6))
            kinds[:, Z0], kinds[:, TIME] = np.nan, -np.inf
            rest = np.zeros(19)
            rest[JUMPED], rest[UNFIT], rest[STATUS] = np.inf, -np.inf, np.inf
            rest[HEARD], rest[LAST], rest[APART] = np.nan, np.nan, SLOW_UNHEARD_S
        self._kinds, self._rest = kinds, rest

    def check(self, inputs: FilterInputs) -> tuple["SensorMemory", Ints]:
        """K inputs in order of receipt -> the memory after them, bits of `SensorFault` (K,)."""
        held = inputs.gps_fix, inputs.estimator, inputs.active, inputs.heard
        return self.after(inputs.events, held)

    def after(
        self, events: Events, held: tuple[Floats, Floats, Floats, Floats]
    ) -> tuple["SensorMemory", Ints]:
        """The memory after K measurements, given what `check_events` asks of each."""
        after = SensorMemory(self._kinds.copy(), self._rest.copy())
        out = np.zeros(len(events), np.int64)
        check_events(after._kinds, after._rest, (events.time_s, events.kind, events.z), held, out)
        return after, out


def unfit_text(bits: int, since_ns: Mapping[SensorFault, int]) -> str:
    """Sentence on what makes the data unfit, since when (receipt); empty while they are fit."""
    found = reasons_in(bits)
    if not found:
        return "all is well, settling" if bits else ""
    return "; ".join(f"{WORDS[fault][0]} since {clock_text(since_ns[fault])}" for fault in found)


def reasons_in(bits: int) -> list[SensorFault]:
    """The faults among those bits."""
    return [fault for fault in REASONS if bits & fault] if bits else []
