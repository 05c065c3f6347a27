"""What a page shows, kept in its address: a reload, a step back and a link show the same again."""

from urllib.parse import parse_qsl, urlencode

import panel as pn

from gateway.studio.views import TimeRanges

MOST_RANGES = 60  # that an address holds: one that is longer than 1 kB is cut by mail programs


class Address:
    """The query of one open page: names and texts. Others than those written are kept.

    But for the token of an exposed studio: it is a cookie by now, and goes out with no link.
    """

    def __init__(self) -> None:
        self._location = pn.state.location
        search = self._location.search if self._location is not None else ""
        self._values = dict(parse_qsl((search or "").lstrip("?")))
        self._values.pop("token", None)

    def read(self, name: str) -> str | None:
        """What the address says, None where it says nothing."""
        return self._values.get(name)

    def write(self, **values: str | None) -> None:
        """Say something else; None or nothing takes a name away."""
        kept = {k: v for k, v in {**self._values, **values}.items() if v}
        if kept == self._values:
            return
        self._values = kept
        if self._location is not None:
            self._location.search = f"?{urlencode(kept)}" if kept else ""


def ranges_text(ranges: TimeRanges) -> str:
    """Stretches of time [s] as they stand in an address: 12.0:15.5,20.0:31.0."""
    if len(ranges) > MOST_RANGES:
        return ""
    return ",".join(f"{start:.1f}:{end:.1f}" for start, end in ranges)


def ranges_in(text: str | None) -> TimeRanges:
    """Stretches of time [s] from an address; none where it holds anything else."""
    try:
        pairs = [tuple(map(float, one.split(":"))) for one in (text or "").split(",") if one]
        return tuple((start, end) for start, end in pairs if start < end)
    except ValueError:
        return ()
