"""A scorer that reads the errors which are written on made fits; one ruler for all of them."""

from dataclasses import dataclass
from types import SimpleNamespace
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

    def score_recordings(self, fit: Any) -> Any:
        """`left_out` of a fit stands for its nrmse on recordings left out; without it, unknown."""
        left_out = getattr(fit, "left_out", None)
        return None if left_out is None else SimpleNamespace(nrmse=left_out)
