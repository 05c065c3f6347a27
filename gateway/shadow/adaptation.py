"""The vessel's numbers followed while sailing: seconds in, the topic `parameters` and events out.

Switched on by `--adapt`; `--adapt apply` also gives them to the shadow: to what predicts while the
link is down, and to the plant where the vessel itself is the plant. The vessel file is never
changed, and what the residuals and the model's events are about stays the vessel as it was given.
"""

from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from gateway.json_rows import TopicRows, encode_rows
from gateway.shadow.path import ShadowPath, ShadowRows
from gateway.shadow.topic_rows import EventRow
from sim.model import Model
from sim.monitoring.live_second import SecondMeans
from sim.monitoring.recursive import (
    SIGMAS_95,
    NumberEstimates,
    NumberFollower,
    with_shares,
)
from sim.state import Floats

APPLY_EVERY_NS = 10_000_000_000  # at whole multiples of this receipt the shadow takes over …
APPLY_STEP = 0.05  # … and no number moves by more than this at a time
MIN_APPLIED = 0.01  # change of a share that is worth it


class Adapt(StrEnum):
    """What becomes of the vessel's numbers while sailing."""

    OFF = "off"
    WATCH = "watch"
    APPLY = "apply"


@dataclass(frozen=True)
class Adaptation:
    """The numbers so far, and the shares that the shadow uses (n,)."""

    follower: NumberFollower
    estimates: NumberEstimates
    applied: Floats = field(default_factory=lambda: np.zeros(0))
    applied_at: int = 0  # the last multiple of `APPLY_EVERY_NS` at which that was looked at

    @classmethod
    def of(cls, model: Model) -> "Adaptation":
        """Before the first second."""
        follower = NumberFollower.of(model)
        return cls(follower, follower.start(), np.zeros(len(follower.numbers)))

    def observe(
        self, out: ShadowRows, k: int, second: SecondMeans
    ) -> tuple["Adaptation", TopicRows, list[EventRow]]:
        """A second that ended before row k -> the numbers after it, messages and events."""
        after = replace(self, estimates=self.follower.observe(self.estimates, second))
        turned = np.flatnonzero(after.estimates.left != self.estimates.left)
        return after, after._topic_rows(out, k), [after._event(out, k, int(i)) for i in turned]

    def taken_over(self, path: ShadowPath, receive_time_ns: int) -> tuple["Adaptation", ShadowPath]:
        """The path for what is received from then on: now and then the shadow's numbers move
        towards those that are valid, a little at a time.

        `path` is the one in use; what it does otherwise, and its residuals, stay as they are.
        """
        at = receive_time_ns // APPLY_EVERY_NS
        if at == self.applied_at:
            return self, path
        now = self.estimates
        wanted = np.where(now.valid, now.shares, self.applied)
        step = np.clip(wanted - self.applied, -APPLY_STEP, APPLY_STEP)
        step = np.where(np.abs(step) >= MIN_APPLIED, step, 0.0)
        after = replace(self, applied=self.applied + step, applied_at=at)
        if not step.any():
            return after, path
        names = (number.name for number in self.follower.numbers)
        shares = dict(zip(names, after.applied.tolist(), strict=True))
        return after, path.with_numbers_of(with_shares(path.model.vessel, shares))

    def _topic_rows(self, out: ShadowRows, k: int) -> TopicRows:
        """One message for each number."""
        now, n = self.estimates, len(self.follower.numbers)
        vehicle, receive = (np.repeat(t[k], n) for t in (out.vehicle_time_ns, out.receive_time_ns))
        value, reach = 1.0 + now.shares, SIGMAS_95 * now.std
        columns = (value, now.std, value - reach, value + reach, 1.0 + self.applied, now.excited_s)
        text = {
            "name": [number.name for number in self.follower.numbers],
            "excited": np.where(now.excited, "yes", "no").tolist(),
            "valid": np.where(now.valid, "yes", "no").tolist(),
        }
        return encode_rows("parameters", vehicle, receive, np.column_stack(columns), text)

    def _event(self, out: ShadowRows, k: int, i: int) -> EventRow:
        """A number has left what the vessel file says, or is back."""
        now, name = self.estimates, self.follower.numbers[i].name
        share, reach = 100.0 * float(now.shares[i]), 100.0 * SIGMAS_95 * float(now.std[i])
        what = f"the thrust of {name[7:]}" if name.startswith("thrust ") else f"the {name}"
        if not now.left[i]:
            return EventRow.at(
                out, k, "parameter_usual", "info", f"{what} is again as in the vessel file"
            )
        size = f"{abs(share):.0f} % {'less' if share < 0.0 else 'more'} than in the vessel file"
        ends = sorted((abs(share - reach), abs(share + reach)))
        text = f"{what} is {size} (95 %: {ends[0]:.0f} to {ends[1]:.0f} %)"
        return EventRow.at(out, k, "parameter_changed", "warning", text)
