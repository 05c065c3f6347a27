"""The figures that the paper prints, as they stand there.

Source: Saldarriaga-Mesa et al., Robotics 2025, 14(9), 124, Tables 4 to 8.
"""

from collections.abc import Mapping
from typing import NamedTuple

CHANNELS = ("u", "v", "r", "x", "y", "psi")
UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad"}


class Score(NamedTuple):
    """Root mean square and mean absolute error [the channel's unit], coefficient R² [-]."""

    rmse: float
    mae: float
    r2: float

    def as_good_as(self, other: "Score") -> bool:
        """No worse in any of the three."""
        return self.rmse <= other.rmse and self.mae <= other.mae and self.r2 >= other.r2


Scores = Mapping[str, Score]


def _scores(*rows: tuple[float, float, float]) -> Scores:
    return {name: Score(*row) for name, row in zip(CHANNELS, rows, strict=False)}


TABLE_4 = _scores(
    (0.25840, 0.20668, 0.86794), (0.15799, 0.10405, 0.51773), (0.21584, 0.13807, 0.79921)
)
TABLE_5_STD: Mapping[str, tuple[float, ...]] = {  # of δ1 … δ9; the values are in configs/vessels
    "IAcquaBot": (0.3299, 0.6765, 0.3132, 0.4575, 0.3655, 1.4451, 2.4172, 1.1138, 1.6111),
    "WAM-V": (0.2490, 0.6193, 0.2594, 0.5287, 0.3399, 1.5777, 2.4369, 1.0419, 1.1849),
}
TABLE_6: Mapping[str, Scores] = {
    "IAcquaBot": _scores(
        (0.03714, 0.03111, 0.99548), (0.01254, 0.00984, 0.99541), (0.00956, 0.00644, 0.99887),
        (0.32232, 0.26361, 0.99847), (0.13300, 0.11067, 0.99774), (0.01699, 0.01276, 0.99976),
    ),
    "WAM-V": _scores(
        (0.04508, 0.03519, 0.99598), (0.01314, 0.00880, 0.99666), (0.01714, 0.01025, 0.99873),
        (0.11266, 0.09312, 0.99988), (0.33700, 0.28346, 0.97451), (0.02663, 0.01918, 0.99974),
    ),
}  # fmt: skip
TABLE_7_ALONE = _scores(
    (0.3596, 0.2830, 0.6120), (0.2850, 0.1995, -12.435), (0.3152, 0.2278, -3.3631),
    (14.020, 10.648, -14.295), (7.391, 4.692, -3.3243), (3.3198, 2.6537, -6.5001),
)  # fmt: skip
TABLE_7_FOLLOWING = _scores(
    (0.0048, 0.0038, 0.99993), (0.0017, 0.0012, 0.99953), (0.0015, 0.0009, 0.99990),
    (0.0162, 0.0119, 0.99998), (0.0377, 0.0275, 0.99989), (0.0031, 0.0020, 0.99999),
)  # fmt: skip
# Implied by RMSE and R² of Table 7: standard deviations of the reference in u, v, r.
TABLE_7_STD = (0.58, 0.08, 0.15)
# Current and wind: force [N], direction [deg, counter-clockwise from +X].
TABLE_8: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = (
    ((1.20, 10.0), (0.85, -5.0)),
    ((6.80, 110.0), (6.20, 70.0)),
    ((2.70, 80.0), (2.40, 40.0)),
    ((6.20, -70.0), (4.90, -120.0)),
)
TABLE_8_LIMIT = 0.1  # m/s, rad/s, m, rad: "below 0.1"
