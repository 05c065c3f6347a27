"""Outputs that the firmware drives, held against those that the vessel has: what does not fit.

Firmware gives an output without a function no pulse, or one that never changes: ArduRover 4.6 rests
it at 1000 µs where its neighbours have a function, which is full astern for a motor with 1500 in
the middle.
"""

from collections.abc import Callable, Mapping, Sequence

from sim.vessel import Rudder, Thruster

CHECK_AFTER_S = 20.0  # of the boat's time: by then the firmware drives its outputs
DRIVEN_US = 20.0  # an output that has moved by so much is driven
PLAUSIBLE_US = (500.0, 2500.0)
NO_PULSE = (0.0, 65535.0)
SETTLED_S = 5.0  # of the boat's time: by then the firmware has set its outputs up (ArduRover: 1.9)
DISARMED_S = 5.0  # no firmware is armed so soon after that; chosen
AWAY_US = 100.0  # from neutral: more than a trim that the vessel file does not know; chosen
MOVED_S = 10.0  # others have moved for so long before it is said; chosen


class OutputCheck:
    """Compares the outputs that the firmware drives with those that the vessel has."""

    def __init__(
        self, actuators: Sequence[Thruster | Rudder], once: Callable[[str, str], None]
    ) -> None:
        self._actuators = {a.servo.channel: a.name for a in actuators}
        self._once = once
        self._resting = RestingOutputs(actuators, once)
        self._range: dict[int, tuple[float, float]] = {}
        self._last: Mapping[int, float] = {}
        self._checked = False

    def begin(self, under_way: bool) -> None:
        """The firmware has started, or it has been there for longer (`under_way`)."""
        self._checked = False
        self._resting.begin(under_way)

    def look(self, pulses: Mapping[int, float], time_s: float) -> None:
        """Note one frame; nothing to do while nothing changes."""
        if pulses != self._last:
            self._last = pulses
            for channel, pulse in pulses.items():
                self._note(channel, pulse)
        self._resting.look(pulses, time_s)
        if not self._checked and time_s > CHECK_AFTER_S:
            self._checked = True
            for channel, name in self._actuators.items():
                if pulses.get(channel, 0.0) in NO_PULSE:  # firmware begins with some everywhere
                    self._once(
                        f"idle {channel}",
                        f"output {channel} ({name}) gets no pulses: set SERVO{channel}_FUNCTION, "
                        "or the channel in the vessel file",
                    )

    def _note(self, channel: int, pulse: float) -> None:
        if pulse in NO_PULSE:
            return
        if channel in self._actuators and not PLAUSIBLE_US[0] <= pulse <= PLAUSIBLE_US[1]:
            self._once(
                f"pulse {channel}",
                f"a pulse of {pulse:g} µs on output {channel}: expected {PLAUSIBLE_US[0]:g} … "
                f"{PLAUSIBLE_US[1]:g}; it is taken as the nearest that the vessel knows",
            )
        low, high = self._range.get(channel, (pulse, pulse))
        low, high = min(low, pulse), max(high, pulse)
        self._range[channel] = low, high
        if high - low >= DRIVEN_US and channel not in self._actuators:
            there = ", ".join(f"{c} ({name})" for c, name in sorted(self._actuators.items()))
            self._once(
                f"unknown {channel}",
                f"the firmware drives output {channel}, where the vessel has nothing: it has "
                f"{there}; pulses there move nothing",
            )


class RestingOutputs:
    """Outputs that hold one pulse away from neutral from the start on, while others move.

    They are looked for while the firmware is still disarmed and another output lies at its neutral:
    a motor that a pilot holds at one speed later on has rested at neutral before.
    """

    def __init__(
        self, actuators: Sequence[Thruster | Rudder], once: Callable[[str, str], None]
    ) -> None:
        self._actuators = {a.servo.channel: a for a in actuators}
        self._once = once
        self._watching = False
        self._rest: dict[int, float] = {}  # the pulses of those that have not moved
        self._moved_s: float | None = None  # when one first moved after the firmware was disarmed

    def begin(self, under_way: bool) -> None:
        """Watch from the firmware's start on; one that is under way may hold what it likes."""
        self._watching, self._rest, self._moved_s = not under_way, {}, None

    def look(self, pulses: Mapping[int, float], time_s: float) -> None:
        """Note one frame; nothing to do once nothing is suspect."""
        if not self._watching or time_s < SETTLED_S:
            return
        if not self._rest:
            self._rest = {channel: pulses.get(channel, 0.0) for channel in self._actuators}
        moved = [c for c, pulse in self._rest.items() if pulses.get(c, 0.0) != pulse]
        for channel in moved:
            del self._rest[channel]
        if time_s < SETTLED_S + DISARMED_S:
            self._watching = bool(self._rest)
        elif self._moved_s is None:
            self._moved_s = self._first_move(moved, time_s)
        elif time_s > self._moved_s + MOVED_S:
            self._tell()

    def _first_move(self, moved: Sequence[int], time_s: float) -> float | None:
        away = [channel for channel in self._rest if self._away(channel)]
        calm = moved or len(away) < len(self._rest)
        self._watching = bool(away and calm)
        return time_s if moved else None

    def _away(self, channel: int) -> bool:
        pulse, neutral = self._rest[channel], self._actuators[channel].servo.pwm[1]
        return pulse not in NO_PULSE and abs(pulse - neutral) > AWAY_US

    def _tell(self) -> None:
        self._watching = False
        for channel in filter(self._away, self._rest):
            actuator = self._actuators[channel]
            self._once(
                f"resting {channel}",
                f"output {channel} ({actuator.name}) has held {self._rest[channel]:g} µs since the "
                f"firmware started, away from its neutral {actuator.servo.pwm[1]:g}, while others "
                f"moved: set SERVO{channel}_FUNCTION, since it seems to have no function, or the "
                "channel or pwm in the vessel file",
            )
