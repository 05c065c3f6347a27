"""Where on Earth the metres of a live boat count from, as that becomes known. Pure.

An autopilot may state the origin of its local frame; else a local and a global position of the
same moment tell it. One such pair may be wrong, so two in a row have to agree; the same two move
an origin that was wrong. After a reboot the frame lies elsewhere. A boat that gives degrees alone
has its first position as origin, for good.
"""

from dataclasses import dataclass, replace

import numpy as np

from gateway.ingest.earth import Origin, to_degrees, to_local
from gateway.samples import Measurement, Quantity

TOGETHER_NS = 200_000_000  # local and global position further apart are not of one moment
AGREE_M = 10.0  # a GNSS receiver's own position lags and errs by metres
FAR_M = 1e6  # no local frame reaches further


def on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    """Is there such a place?"""
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0


def distance_m(one: Origin, other: Origin) -> float:
    """Between two places."""
    return float(np.hypot(*to_local(np.array(one), other)))


@dataclass(frozen=True)
class Whereabouts:
    """What is known so far."""

    origin: Origin | None = None
    fixed: bool = False  # metres were made with it: it cannot change any more
    guess: Origin | None = None  # what the last pair told
    local: Measurement | None = None
    place: Measurement | None = None

    def heard(self, m: Measurement) -> "Whereabouts":
        """A fact of any kind; only positions and origins mean something here."""
        match m.quantity:
            case Quantity.ORIGIN if not self.fixed and on_earth(*m.values):
                return replace(self, origin=Origin(*m.values))
            case Quantity.GLOBAL_POSITION if on_earth(*m.values):
                return replace(self, place=m)._paired()
            case Quantity.POSITION if max(map(abs, m.values)) < FAR_M:
                return replace(self, local=m)._paired()
        return self

    def rebooted(self) -> "Whereabouts":
        """The autopilot counts its metres from somewhere else now."""
        return self if self.fixed else Whereabouts()

    def in_metres(self, m: Measurement) -> tuple["Whereabouts", Measurement | None]:
        """A position in degrees as metres from the origin, which is its first one if need be."""
        if not on_earth(*m.values):
            return self, None
        after = replace(self, origin=self.origin or Origin(*m.values), fixed=True)
        assert after.origin is not None
        north, east = to_local(np.array(m.values), after.origin).tolist()
        local = Measurement(
            Quantity.POSITION, m.source, m.vehicle_time_ns, m.receive_time_ns, (north, east)
        )
        return after, local

    def _paired(self) -> "Whereabouts":
        """A position came: does it tell the origin together with the latest of the other kind?"""
        place, local = self.place, self.local
        if self.fixed or place is None or local is None:
            return self
        if abs(place.vehicle_time_ns - local.vehicle_time_ns) >= TOGETHER_NS:
            return self
        behind = to_degrees(-np.array(local.values), Origin(*place.values))
        if not on_earth(*behind):
            return self
        guess, before = Origin(*behind.tolist()), self.guess
        after = replace(self, guess=guess, place=None)  # a pair tells once
        if self.origin is not None and distance_m(self.origin, guess) < AGREE_M:
            return after
        if before is None or distance_m(before, guess) >= AGREE_M:
            return after
        return replace(after, origin=guess)
