"""RMSE, MAE and R² of one motion against another, and tables of them as Markdown."""

from collections.abc import Sequence

import numpy as np

from benchmarks.paper.published import CHANNELS, UNITS, Score, Scores
from sim.prediction.free_runs import scores
from sim.state import Eta, Floats


def scored(reference: Floats, other: Floats) -> Scores:
    """Reference (T, 6) and another motion (T, 6) of (eta, nu) -> scores by channel."""
    s = scores(reference, off(reference, other))
    return {c: Score(s.rmse[c], s.mae[c], s.r2.get(c, float("nan"))) for c in CHANNELS}


def off(reference: Floats, other: Floats) -> Floats:
    """Reference − other (T, 6), yaw the shorter way round."""
    error = reference - other
    error[:, Eta.YAW] = np.remainder(error[:, Eta.YAW] + np.pi, 2.0 * np.pi) - np.pi
    return error


def beside(
    paper: Scores, ours: Sequence[tuple[str, Scores]], judged: Sequence[str] = ()
) -> list[str]:
    """Rows of RMSE / MAE / R² per channel; columns in `judged` say whether they reach the paper."""
    lines = header(["", "paper", *(name for name, _ in ours)])
    for c in paper:
        cells = [f"{c} [{UNITS[c]}]", told(paper[c])]
        for name, s in ours:
            verdict = "" if name not in judged else mark(s[c].as_good_as(paper[c]))
            cells.append(told(s[c]) + verdict)
        lines.append(row(cells))
    return lines


def reached(paper: Scores, ours: Scores) -> str:
    """How many rows are at least as good, and by how much the others miss."""
    short = [c for c in paper if not ours[c].as_good_as(paper[c])]
    said = f"{len(paper) - len(short)} of {len(paper)} rows at least as good as the paper"
    times = ", ".join(f"{c} RMSE × {ours[c].rmse / paper[c].rmse:.2f}" for c in short)
    return said + (f"; not: {times}" if short else "")


def told(s: Score) -> str:
    """RMSE / MAE / R²."""
    return f"{s.rmse:.4f} / {s.mae:.4f} / {s.r2:.5f}"


def mark(good: bool) -> str:
    """Reached or not."""
    return " ✓" if good else " ✗"


def header(cells: Sequence[str]) -> list[str]:
    """The first two lines of a table."""
    return [row(cells), row(["---"] * len(cells))]


def row(cells: Sequence[str]) -> str:
    """One line of a table."""
    return "| " + " | ".join(cells) + " |"


def spread(motion: Floats) -> str:
    """Standard deviations of u, v, r of a motion (T, 6) in words."""
    u, v, r = np.std(motion[:, 3:6], axis=0)
    return f"{u:.2f} m/s, {v:.3f} m/s, {r:.3f} rad/s"
