"""How a comparison is made: what may be chosen, in seconds and in units of the nrmse scales."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CompareSettings:
    """Free runs of `horizon` [s] from a moment every `every` [s].

    A horizon ends early where the spread of its start state, carried along the measured track,
    passes `spread_limit` (root mean square over u, v, r in units of the nrmse scales) or
    `spread_growth` times its value at the start, whichever is larger: below the first the start
    state hardly shows in the error; the second lets a coarse estimate of a steady boat run on.
    No horizon is cut below `shortest` [s]; the spread is looked at every `node` [s].
    """

    horizon: float = 10.0
    every: float = 2.5
    shortest: float = 1.0
    node: float = 0.25
    spread_limit: float = 0.25
    spread_growth: float = 2.0
    block: float = 30.0  # s, of the blocks that intervals are made from
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("horizon", "every", "shortest", "node", "block"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be longer than 0 s, not {getattr(self, name)}")
        if self.horizon < self.shortest:
            raise ValueError(f"horizon {self.horizon} s is below the shortest, {self.shortest} s")
