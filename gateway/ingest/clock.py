"""The clock of one boat: vehicle time for every message, and counts of what was odd.

    vehicle time = epoch + boot time        epoch fixed per boot session, at its first message

Boot time comes from counters that wrap, restart, come late, twice or not at all. Counters that are
stamped at sending drive the clock; the narrow one of SERVO_OUTPUT_RAW and the sample times of a
GNSS receiver only follow it. A jump of boot time by more than `JUMP` opens a new session once
messages have agreed on it for `CONFIRM`: one late or damaged packet does not. So does a jump ahead
by more than `SLEEP`, whatever the receipt says: a log without a receiver has no other clock than
the one that jumped. Within a session the offset receipt − vehicle time is the lower envelope over
one or two windows; it bounds the moment of messages without a counter, which otherwise share the
delay of their neighbours.

One compiled step serves the live link and the columns of a log: they cannot disagree.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from gateway.ingest.mapping import UNIX_FROM_US, Counter
from sim.kernel.compiled import compiled
from sim.state import Ints

SECOND = 1_000_000_000  # ns
JUMP = 10 * SECOND  # a boot counter that jumps further has restarted
SLEEP = 86_400 * SECOND  # no boat is silent for longer within one boot
CONFIRM = 1 * SECOND  # receipt time over which a jump must persist
AGREE = 2 * SECOND  # spread of receipt − boot within which packets show the same jump
STEP_BACK = 2 * SECOND  # receipt clock set back
STEP_AHEAD = 10 * SECOND  # receipt clock set ahead …
STEP_CONFIRM = 5 * SECOND  # … when it has stayed so for this long
WINDOW = 30 * SECOND  # of the lower envelope
NEIGHBOUR = 1 * SECOND  # how long the delay of a timed message holds for untimed ones
RECENT = 32  # stamps per stream that are kept to find duplicates
RING = 2  # where they start in `recent`

WRAP_MS = 2**32 * 1000  # µs
WRAP_US = 2**32  # µs
COUNTER_RECEIPT = int(Counter.RECEIPT)
COUNTER_BOOT_MS = int(Counter.BOOT_MS)
COUNTER_BOOT_US = int(Counter.BOOT_US)
COUNTER_BOOT_US32 = int(Counter.BOOT_US32)


class StampStatus(IntEnum):
    """Whether a stamped message can be used."""

    FRESH = 0
    LATE = 1  # older than an earlier one of its stream
    DUPLICATE = 2  # the same moment of the same stream again: not to be used
    UNPLACED = 3  # its counter jumped and nothing has confirmed the jump: not to be used


STATUSES = tuple(StampStatus)  # by number: to look one up there takes a fifth of making it


class S(IntEnum):
    """Entries of the clock's state, int64 [ns unless said]."""

    STARTED = 0  # 0 or 1
    SESSION = 1  # number of the boot session
    EPOCH = 2  # Unix time of boot
    BOOT = 3  # newest boot time
    RECEIVED = 4  # receipt of the newest boot time
    TURNS_MS = 5  # turns of the wide counter so far in this session
    TURNS_US = 6  # turns of the narrow one …
    SEEN_US = 7  # … once one was seen
    MIN_NOW = 8  # smallest receipt − vehicle time in this window
    MIN_BEFORE = 9  # … in the window before
    WINDOW_FROM = 10  # receipt at the start of this window
    FAR_SINCE = 11  # boot time since which the offset is far above its envelope, −1 = it is not
    PENDING = 12  # 0 or 1: a jump waits for confirmation
    PENDING_OFFSET = 13  # receipt − boot time of the jump
    PENDING_SINCE = 14  # receipt of its first message
    REBOOTS = 15  # counts from here on
    WRAPS = 16
    LATE = 17
    DUPLICATES = 18
    UNPLACED = 19
    STEPS = 20
    SPREAD = 21  # largest delay above the envelope [ns]


@compiled
def _offset(s: Ints) -> int:
    """Lower envelope of receipt − vehicle time [ns]."""
    return int(min(s[S.MIN_NOW], s[S.MIN_BEFORE]))


@compiled
def _restart_offset(s: Ints, delay: int, receive: int) -> None:
    s[S.MIN_NOW] = delay
    s[S.MIN_BEFORE] = delay
    s[S.WINDOW_FROM] = receive


@compiled
def _open_session(s: Ints, counter_us: int, receive: int) -> None:
    """The counter starts anew; vehicle time goes on from where it was, or from the receipt."""
    boot = counter_us * 1000
    epoch = receive - boot
    if s[S.STARTED]:
        s[S.SESSION] += 1
        s[S.REBOOTS] += 1
        epoch = max(epoch, s[S.EPOCH] + s[S.BOOT] + SECOND - boot)
    s[S.STARTED] = 1
    s[S.EPOCH] = epoch
    s[S.BOOT] = boot
    s[S.RECEIVED] = receive
    s[S.TURNS_MS] = 0
    s[S.TURNS_US] = 0
    s[S.FAR_SINCE] = -1
    s[S.PENDING] = 0
    _restart_offset(s, receive - epoch - boot, receive)


@compiled
def _turns(s: Ints, counter_us: int, modulus_us: int) -> int:
    """How often the counter has wrapped if it means the moment nearest to the newest one."""
    return int(max((s[S.BOOT] // 1000 - counter_us + modulus_us // 2) // modulus_us, 0))


@compiled
def _is_jump(s: Ints, boot: int, receive: int) -> bool:
    """Whether boot time moved in a way that neither lateness nor an outage explains."""
    ahead = boot - int(s[S.BOOT])
    return ahead < -JUMP or ahead > min(JUMP + int(max(receive - s[S.RECEIVED], 0)), SLEEP)


@compiled
def _confirmed(s: Ints, offset: int, receive: int) -> bool:
    """Whether messages have shown the same jump for long enough."""
    if not s[S.PENDING] or abs(offset - s[S.PENDING_OFFSET]) > AGREE:
        s[S.PENDING] = 1
        s[S.PENDING_OFFSET] = offset
        s[S.PENDING_SINCE] = receive
    return receive - int(s[S.PENDING_SINCE]) >= CONFIRM


@compiled
def _update_offset(s: Ints, boot: int, receive: int) -> None:
    """Lower envelope over windows; steps of the receipt clock start it anew."""
    delay = receive - s[S.EPOCH] - boot
    above = delay - _offset(s)
    if above < STEP_AHEAD:
        s[S.FAR_SINCE] = -1
    elif s[S.FAR_SINCE] < 0:
        s[S.FAR_SINCE] = boot
    if above < -STEP_BACK or (s[S.FAR_SINCE] >= 0 and boot - s[S.FAR_SINCE] > STEP_CONFIRM):
        s[S.STEPS] += 1
        s[S.FAR_SINCE] = -1
        _restart_offset(s, delay, receive)
        return
    if receive - s[S.WINDOW_FROM] > WINDOW:
        s[S.MIN_BEFORE] = s[S.MIN_NOW]
        s[S.MIN_NOW] = delay
        s[S.WINDOW_FROM] = receive
    s[S.MIN_NOW] = min(s[S.MIN_NOW], delay)
    if s[S.FAR_SINCE] < 0:
        s[S.SPREAD] = max(s[S.SPREAD], delay - _offset(s))


@compiled
def _drive(s: Ints, counter: int, counter_us: int, receive: int) -> int:
    """A counter stamped at sending moves the clock -> boot time [ns], −1 where unplaced."""
    if not s[S.STARTED]:
        _open_session(s, counter_us, receive)
        return int(s[S.BOOT])
    turns = _turns(s, counter_us, WRAP_MS) if counter == COUNTER_BOOT_MS else 0
    boot = (counter_us + turns * WRAP_MS) * 1000
    if _is_jump(s, boot, receive):
        if not _confirmed(s, receive - counter_us * 1000, receive):
            return -1
        _open_session(s, counter_us, receive)
        return int(s[S.BOOT])
    s[S.PENDING] = 0
    _update_offset(s, boot, receive)
    if boot > s[S.BOOT]:
        s[S.WRAPS] += max(turns - s[S.TURNS_MS], 0)
        s[S.TURNS_MS] = max(turns, s[S.TURNS_MS])
        s[S.BOOT] = boot
        s[S.RECEIVED] = receive
    return boot


@compiled
def _from_receipt(s: Ints, receive: int) -> int:
    """Vehicle time [ns] of a message without a counter."""
    if not s[S.STARTED]:
        return receive
    since = receive - int(s[S.RECEIVED])
    if 0 <= since < NEIGHBOUR:
        return int(s[S.EPOCH] + s[S.BOOT]) + since
    return receive - int(_offset(s))


@compiled
def _follow(s: Ints, counter: int, counter_us: int, receive: int) -> int:
    """A counter that only follows the clock -> vehicle time [ns], −1 where unplaced."""
    if not s[S.STARTED]:
        return receive
    turns = _turns(s, counter_us, WRAP_US) if counter == COUNTER_BOOT_US32 else 0
    boot = (counter_us + turns * WRAP_US) * 1000
    if _is_jump(s, boot, receive):
        return -1
    if turns > s[S.TURNS_US]:
        s[S.WRAPS] += turns - s[S.TURNS_US] if s[S.SEEN_US] else 0
        s[S.TURNS_US] = turns
    s[S.SEEN_US] = 1
    return int(s[S.EPOCH]) + boot


@compiled
def _vehicle_time(s: Ints, counter: int, counter_us: int, receive: int) -> int:
    """Vehicle time [ns], −1 where unplaced."""
    if counter == COUNTER_RECEIPT or counter_us <= 0 or counter_us >= UNIX_FROM_US:
        return int(_from_receipt(s, receive))
    if counter != COUNTER_BOOT_MS and counter != COUNTER_BOOT_US:
        return int(_follow(s, counter, counter_us, receive))
    boot = int(_drive(s, counter, counter_us, receive))
    return -1 if boot < 0 else int(s[S.EPOCH]) + boot


@compiled
def _status(recent: Ints, vehicle: int) -> int:
    """Fresh (0), late (1) or duplicate (2) within its stream.

    recent (34,): newest stamp, position in the ring, the ring of stamps [ns]
    """
    for k in range(RING, RING + RECENT):
        if recent[k] == vehicle:
            return 2
    newest = int(recent[0])
    recent[RING + recent[1]] = vehicle
    recent[1] = (recent[1] + 1) % RECENT
    recent[0] = max(newest, vehicle)
    return 1 if vehicle < newest else 0


@compiled
def stamp(s: Ints, recent: Ints, counter: int, counter_us: int, receive: int) -> tuple[int, int]:
    """One message -> vehicle time [ns], status. Moves the state `s` and its stream's `recent`."""
    vehicle = _vehicle_time(s, counter, counter_us, receive)
    if vehicle < 0:
        s[S.UNPLACED] += 1
        return receive, 3
    if counter == COUNTER_RECEIPT:
        return vehicle, 0
    status = _status(recent, vehicle)
    s[S.LATE] += status == 1
    s[S.DUPLICATES] += status == 2
    return vehicle, status


@compiled
def stamp_all(
    s: Ints, recent: Ints, stream: Ints, counter: Ints, counter_us: Ints, receive: Ints
) -> tuple[Ints, Ints, Ints]:
    """Messages in order of receipt, (K,) each -> vehicle time [ns], status, session, (K,) each."""
    vehicle = np.empty(len(stream), np.int64)
    status = np.empty(len(stream), np.int64)
    session = np.empty(len(stream), np.int64)
    for k in range(len(stream)):
        vehicle[k], status[k] = stamp(s, recent[stream[k]], counter[k], counter_us[k], receive[k])
        session[k] = s[S.SESSION]
    return vehicle, status, session


@dataclass(frozen=True)
class ClockReport:
    """Counts of what was odd about the clocks of one boat: shown by `shadow info`."""

    sessions: int
    reboots: int
    wraps: int
    late: int
    duplicates: int
    unplaced: int
    receive_steps: int
    spread_s: float  # largest delay of a message above the envelope
    offset_s: float  # receipt − vehicle time at the end: the lower envelope


class BoatClock:
    """The clock of one boat: state that every message of the boat moves."""

    def __init__(self, streams: int) -> None:
        self.state = np.zeros(len(S), np.int64)
        self._recent = np.full((streams, RING + RECENT), -1, np.int64)
        self._recent[:, 1] = 0

    def stamp(
        self, stream: int, counter: Counter, counter_us: int, receive_time_ns: int
    ) -> tuple[int, StampStatus]:
        """One message of a stream -> vehicle time [ns], whether it can be used."""
        vehicle, status = stamp(
            self.state, self._recent[stream], int(counter), counter_us, receive_time_ns
        )
        return vehicle, STATUSES[status]

    def stamp_all(
        self, stream: Ints, counter: Ints, counter_us: Ints, receive_time_ns: Ints
    ) -> tuple[Ints, Ints, Ints]:
        """(K,) messages in order of receipt -> vehicle time [ns], status, session, (K,) each."""
        arrays: tuple[Ints, Ints, Ints] = stamp_all(
            self.state, self._recent, stream, counter, counter_us, receive_time_ns
        )
        return arrays

    @property
    def reboots(self) -> int:
        """How often the autopilot booted again."""
        return int(self.state[S.REBOOTS])

    @property
    def offset_ns(self) -> int:
        """Lower envelope of receipt − vehicle time."""
        return int(min(self.state[S.MIN_NOW], self.state[S.MIN_BEFORE]))

    def report(self) -> ClockReport:
        """The counts so far."""
        s = self.state
        return ClockReport(
            sessions=int(s[S.SESSION]) + int(s[S.STARTED]),
            reboots=self.reboots,
            wraps=int(s[S.WRAPS]),
            late=int(s[S.LATE]),
            duplicates=int(s[S.DUPLICATES]),
            unplaced=int(s[S.UNPLACED]),
            receive_steps=int(s[S.STEPS]),
            spread_s=float(s[S.SPREAD]) * 1e-9,
            offset_s=self.offset_ns * 1e-9,
        )
