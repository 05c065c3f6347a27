"""A scorer that reads the errors which are written on made fits; one ruler for all of them."""

from dataclasses import dataclass
from typing import Any


@dataclass
class MadeScorer:
    """Stands in for `HeldOutScorer`."""

    noise_floor: float
    given: float = 1.0

    def score_fit(self, fit: Any) -> Any:
        return fit

    def shared_with(self, fit: Any) -> "MadeScorer":
        return self
