"""Words for the numbers of an effect: sizes, sides and directions, with 95 % intervals.

Each effect says what was found in a sentence of its own (`Effect.in_words`), made of these.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees, floor, log10, pi

COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
SMALLEST_DECIMALS, MOST_DECIMALS = 0, 3
DEG = 180.0 / pi
YEAR_2000_NS = 946_684_800 * 10**9  # a clock that says less was never set
SECONDS_OF_DAY = 86_400
NO_END = 10.0  # times a number: data that allow so much set no limit
THAN = " than modelled"


@dataclass(frozen=True)
class FittedValues:
    """Values of an effect's parameters by name, and their 95 % intervals where there are any.

    start_time_ns  UTC of the first sample; 0: not known, or not the same for all recordings
    """

    values: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start_time_ns: int = 0

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def size(
        self, name: str, unit: str, factor: float = 1.0, neutral: float = 0.0, after: str = ""
    ) -> str:
        """How far a number is from neutral, whichever way: "7.5° AFTER (6.9–8.2°)".

        Ends that two digits do not tell apart are told with more: "55.6 % (55.5–55.7 %)". One that
        is ten times as far as the number is no end: "849 N (anything from 0 N on)".
        """
        value = factor * (self.values[name] - neutral)
        decimals = _decimals(value)
        low, high = sorted(factor * (end - neutral) for end in self.ci95.get(name, (value, value)))
        if value < 0.0:
            low, high = -high, -low
        while low != high and decimals < MOST_DECIMALS and _alike(low, high, decimals):
            decimals += 1
        text = _with_unit(f"{abs(value):.{decimals}f}", unit) + after
        if name not in self.ci95 or _alike(low, high, decimals):
            return text
        told = round(abs(value), decimals)
        if told and high > NO_END * told and low >= 0.0:
            return f"{text} (anything from {_with_unit(f'{low:.{decimals}f}', unit)} on)"
        ends = (f"{end:.{decimals}f}".replace("-", "−") for end in (low, high))
        return f"{text} ({_with_unit((' to ' if low < 0.0 else '–').join(ends), unit)})"

    def side(self, name: str, positive: str, negative: str, neutral: float = 0.0) -> str:
        """One of two words, by the sign."""
        return positive if self.values[name] >= neutral else negative

    def scaled(self, name: str, more: str, less: str) -> str:
        """How far a factor is from one: "25 % LESS than modelled (20–30 %)"."""
        return self.size(name, "%", 100.0, 1.0, f" {self.side(name, more, less, 1.0)}{THAN}")

    def moment(self, name: str) -> str:
        """A time after the first sample, by the clock too: "338 s (332–345 s), 14:20:10 UTC"."""
        text = self.size(name, "s")
        if self.start_time_ns < YEAR_2000_NS:
            return text
        seconds = round(self.start_time_ns * 1e-9 + self.values[name]) % SECONDS_OF_DAY
        clock = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
        return f"{text}, {clock} UTC,"

    def towards(self, name: str) -> str:
        """A direction [rad from north] in degrees and as a point of the compass."""
        return towards(self.values[name])


def towards(direction: float) -> str:
    """A direction [rad from north] in degrees and as a point of the compass."""
    angle = degrees(direction) % 360.0
    return f"{angle:.0f}° ({COMPASS[round(angle / 45.0) % 8]})"


def _alike(low: float, high: float, decimals: int) -> bool:
    """Whether two ends read the same."""
    return f"{low:.{decimals}f}" == f"{high:.{decimals}f}"


def _decimals(value: float) -> int:
    """Of a number that is told with two digits."""
    size = abs(value)
    return min(max(1 - floor(log10(size)), SMALLEST_DECIMALS), MOST_DECIMALS) if size > 0 else 1


def _with_unit(text: str, unit: str) -> str:
    return f"{text}{unit}" if unit == "°" else f"{text} {unit}"


def until_and_after(p: FittedValues, what: str, does: str, way: str) -> str:
    """A current or a wind that became another one: "until 338 s a current of … sets towards …"."""
    return (f"until {p.moment('time')} a {what} of {p.size('speed', 'm/s')} {does} "
            f"{p.towards('direction')}, from then on one of {p.size('later_speed', 'm/s')} "
            f"{way} {p.towards('later_direction')}")  # fmt: skip
