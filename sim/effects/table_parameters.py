"""Numbers that several tables have alike: what they act on, a force's scale and arm, knots."""

from collections.abc import Iterable

from sim.effects.effect import Kind, Parameter
from sim.effects.tables import EVENLY

WATER_OR_PUSH = Parameter(
    "acts", "1", lower=1.0, upper=2.0, start=1.0, kind=Kind.CHOICE,
    description="1 water, 2 a push",
)  # fmt: skip
FULL = Parameter(
    "full", "N", lower=0.0, upper=1e6, start=100.0, kind=Kind.FIXED,
    description="force of a value of one",
)  # fmt: skip
PLACE = tuple(
    Parameter(key, "m", lower=-1e6, upper=1e6, start=0.0, scale=3.0, description="the place")
    for key in ("north", "east")
)
REACH = Parameter(
    "reach", "m", lower=0.5, upper=1e5, start=30.0, kind=Kind.FIXED,
    description="distance of the last knot from it",
)  # fmt: skip
ARM = Parameter("x", "m", lower=-50.0, upper=50.0, start=0.0, scale=0.5)

INNER_KNOTS = tuple(
    Parameter(
        key,
        "1",
        lower=0.0,
        upper=1.0,
        start=share,
        scale=0.02,
        kind=Kind.FIXED,
        default=share,
        description=f"knot {k}, as a share of the way to the last",
    )
    for k, (key, share) in enumerate(EVENLY.items(), 1)
)


def knots(keys: Iterable[str]) -> tuple[Parameter, ...]:
    """Values over the map or the time; kept at nothing where the boat hardly was."""
    return tuple(
        Parameter(
            key, "m/s or 1", lower=-3.0, upper=3.0, start=0.0, scale=0.1, neutral=0.0, prior=0.5
        )
        for key in keys
    )
