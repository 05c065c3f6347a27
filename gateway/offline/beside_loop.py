"""`shadow compare LOG --with-hil RECORDING`: a real mission beside the same one in the loop.

RECORDING is what `shadow hil` wrote, whose truth is then the track in the loop, or a log of the
autopilot that sailed there. Nothing is inferred from that truth: it is held beside the log.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from gateway.figures.comparison import mission_figures
from gateway.figures.matplotlib_draw import save_figures
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions, load_trials
from gateway.recording.reader import Recording
from sim.comparison.missions import (
    MissionComparison,
    Passage,
    TrackTooShortError,
    compare_missions,
)
from sim.vessel import Vessel

TRUTH, OUTPUTS = "truth/", "outputs/"
JUMP_M = 5.0  # from one row to the next: the boat was put back to its start
RATE_HZ = 10.0  # rows that are compared
TRUTH_HZ = 50.0  # rows that `shadow hil` records: `gateway.topics.LOOP_TOPICS`
SHORTEST_S = 1.0  # of a track between two jumps


@dataclass(frozen=True)
class BesideLoop:
    """The comparison, and what was chosen for it, a sentence each."""

    missions: MissionComparison
    notices: tuple[str, ...]


def beside_loop(
    log: Path, recording: Path, vessel: Vessel, options: TrialOptions = DEFAULT_TRIALS
) -> BesideLoop:
    """Two files -> where their tracks part; a boat length of `vessel` apart is parted."""
    boat, chosen = _longest(
        [Passage.of_trial(trial) for trial in load_trials(log, None, options)], log
    )
    pieces = loop_passages(recording, options)
    loop, also = _longest(pieces, recording)
    try:
        found = compare_missions(boat, loop, vessel.hull.length)
    except TrackTooShortError as error:
        raise BadInput(str(error)) from None
    return BesideLoop(found, (*chosen, *also))


def draw_missions(beside: BesideLoop, folder: Path | None) -> None:
    """Tracks, gap and lag as pictures, where a folder is given."""
    if folder is not None:
        save_figures(mission_figures(beside.missions), folder)


def loop_passages(file: Path, options: TrialOptions) -> list[Passage]:
    """The truth of a recording of the loop, start by start; else the trials of a log."""
    if file.suffix.lower() == ".mcap":
        recording = Recording.open(file)
        names = [topic.removeprefix(TRUTH) for topic in recording.counts() if TRUTH in topic]
        if names:
            return [piece for name in names for piece in _truth_of(recording, name)]
    return [Passage.of_trial(trial) for trial in load_trials(file, None, options)]


def _truth_of(recording: Recording, name: str) -> list[Passage]:
    truth, outputs = (recording.columns(topic + name) for topic in (TRUTH, OUTPUTS))
    every = round(TRUTH_HZ / RATE_HZ)
    time = (truth["vehicle_time_ns"] - truth["vehicle_time_ns"][0])[::every] * 1e-9
    keys = ("north_m", "east_m", "yaw_rate_radps")
    north, east, yaw_rate = (truth[key][::every] for key in keys)
    pulses = {
        channel: np.where(outputs[key] > 0.0, outputs[key], np.nan)[::every]
        for channel in range(1, 33)
        if (outputs[key := f"output_{channel}_us"] > 0.0).any()
    }
    jumps = np.hypot(np.diff(north), np.diff(east)) > JUMP_M
    cuts = [0, *(np.flatnonzero(jumps) + 1), len(time)]
    return [
        Passage(
            recording.path.stem,
            time[a:b],
            north[a:b],
            east[a:b],
            yaw_rate[a:b],
            {channel: values[a:b] for channel, values in pulses.items()},
        )
        for a, b in pairwise(cuts)
        if b - a > SHORTEST_S * RATE_HZ
    ]


def _longest(passages: list[Passage], file: Path) -> tuple[Passage, tuple[str, ...]]:
    """The passage with the longest track, and a word where there were others."""
    if not passages:
        raise BadInput(f"{file}: no track in it")
    best = max(passages, key=lambda passage: float(passage.along[-1]))
    if len(passages) == 1:
        return best, ()
    return best, (
        f"{file.name}: holds {len(passages)} tracks; the longest is taken, {best.along[-1]:.0f} m",
    )
