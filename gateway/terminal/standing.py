"""Whether the model of a watched boat is right just now, in sentences that stand.

What the gateway said last of it comes first: an event that was heard, or its answer to `status`.
Where neither is there, as of a replay that began before we came, the topic `surroundings` tells
what it can.
"""

from enum import StrEnum
from typing import NamedTuple

from gateway.monitor import Judged, Message, VesselStatus
from gateway.topics import MODEL_RIGHT
from sim.monitoring.consistency import RIGHT_BELOW, WRONG_ABOVE

UNJUDGED_S = 5.0  # since the last second that could be judged, from which that is said; chosen
UNEXPLAINED = "none"
CAUSES = {
    "current": "a current", "wind": "a wind", "current or wind": "a current or a wind",
    "thrust": "a thruster that gives more or less", "compass": "a compass that reads aside",
    "drag": "more or less drag", "several": "several causes alike",
    "none of these": "none of current, wind, thrusters, compass and drag",
}  # fmt: skip


class Verdict(StrEnum):
    """Of the model."""

    RIGHT = "right"
    WRONG = "wrong"
    OPEN = "?"


class Standing(NamedTuple):
    """What is known of a model now; `unfit`: why it cannot be judged at this moment, or empty."""

    verdict: Verdict
    says: str
    unfit: str = ""


def standing_of(status: VesselStatus) -> Standing:
    """What the panel says of the model of that boat."""
    verdict, says = _verdict(status.judged, status.message("surroundings"))
    return Standing(verdict, says, _unfit(status))


def _unfit(status: VesselStatus) -> str:
    """Why the model is not judged just now."""
    health, seen = status.message("health"), status.latest.get("surroundings")
    if health is not None and health["unfit"]:
        return f"cannot judge: {health['unfit']}"
    if seen is not None and seen.age_s is not None and seen.age_s > UNJUDGED_S:
        why = ": nothing is heard of the boat" if status.link_silent_s is not None else ""
        return f"not judged for {seen.age_s:.0f} s{why}"
    return ""


def _verdict(judged: Judged | None, seen: Message | None) -> tuple[Verdict, str]:
    """By what the gateway said, else by the last message of `surroundings`."""
    if judged is not None and (event := judged.event) is not None:
        right = event["kind"] == MODEL_RIGHT
        return Verdict.RIGHT if right else Verdict.WRONG, event["says"]
    if seen is None:
        return Verdict.OPEN, "the model is not judged yet: that takes half a minute of its data"
    misfit, cause = seen["misfit"], CAUSES.get(seen["explains"], "")
    if judged is not None:
        is_right = "right" if misfit < RIGHT_BELOW else "not found wrong"
        return Verdict.RIGHT, f"the model is {is_right} so far (misfit {misfit:.1f})"
    limits = f"misfit {misfit:.1f}; above {WRONG_ABOVE:g} is wrong, below {RIGHT_BELOW:g} right"
    looks = f": as of {cause}" if cause else ""
    if misfit > WRONG_ABOVE:
        return Verdict.WRONG, f"the model looks wrong ({limits}){looks}"
    if misfit < RIGHT_BELOW and seen["explains"] == UNEXPLAINED:
        return Verdict.RIGHT, f"the model looks right ({limits})"
    return Verdict.OPEN, f"right or wrong was not heard yet ({limits}){looks}"
