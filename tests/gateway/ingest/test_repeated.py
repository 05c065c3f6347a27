"""A recording that holds the same voyage twice: it counts once, and that is told."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.ingest.open import open_log
from gateway.ingest.repeated import repeated_notice, repeated_spans
from gateway.ingest.survey import survey
from gateway.offline import usable_time
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions, load_trials, usable_trials
from gateway.samples import Quantity, Samples
from tests.gateway.pipelines.sailing import frames, voyage

SECOND = 1_000_000_000


def written(path: Path, *voyages: list[Any]) -> Path:
    """Voyages one behind the other."""
    path.write_bytes(b"".join(frame for said in voyages for frame in frames(said)))
    return path


def test_a_voyage_that_was_appended_twice_counts_once(tmp_path: Path) -> None:
    said = voyage(40.0)
    once = written(tmp_path / "once.tlog", said)
    twice = written(tmp_path / "twice.tlog", said, said)
    (alone,) = usable_trials([once], DEFAULT_TRIALS, lambda _: None)
    (counted,) = usable_trials([twice], DEFAULT_TRIALS, lambda _: None)
    assert counted.usable.sum() == pytest.approx(alone.usable.sum(), abs=2)
    assert any("are there twice, from 4" in text for text in counted.notices)
    assert not any("twice" in text for text in alone.notices)
    again = load_trials(twice)[1]
    assert {stretch.why for stretch in again.excluded} == {usable_time.REPEATED}
    kept = load_trials(twice, options=TrialOptions(keep=(usable_time.REPEATED,)))
    assert kept[1].usable.sum() > 0.9 * counted.usable.sum()
    (boat,) = survey(open_log(twice)).boats
    assert any("counted once" in text for text in boat.notices)


def test_of_a_log_that_goes_on_behind_what_it_repeats_the_rest_counts(tmp_path: Path) -> None:
    longer = voyage(60.0)
    file = written(tmp_path / "a.tlog", [one for one in longer if one[0] < 30.0], longer)
    first, second = usable_trials([file], DEFAULT_TRIALS, lambda _: None)
    assert 30.0 - 3.0 < second.usable.sum() * second.dt < 30.0 + 3.0
    assert first.usable.sum() * first.dt > 25.0


def test_the_same_track_sailed_again_is_another_voyage(tmp_path: Path) -> None:
    file = written(tmp_path / "a.tlog", voyage(40.0), voyage(40.0, noise=0.9))
    assert len(usable_trials([file], DEFAULT_TRIALS, lambda _: None)) == 2
    assert not any("twice" in text for text in survey(open_log(file)).boats[0].notices)


def sailed(noise_seed: int, step_rad: float, step_mps: float) -> tuple[np.ndarray, np.ndarray]:
    """Headings and velocities of one manoeuvre, rounded as a coarse log rounds them."""
    rng, time = np.random.default_rng(noise_seed), np.arange(0.0, 120.0, 0.1)
    yaw = 0.4 * np.sin(0.3 * time) + rng.normal(0.0, 0.01, len(time))
    speed = 1.5 + 0.3 * np.sin(0.2 * time) + rng.normal(0.0, 0.02, len(time))
    return np.round(yaw / step_rad) * step_rad, np.round(speed / step_mps) * step_mps


def choices_of(*voyages: tuple[np.ndarray, np.ndarray]) -> tuple[Any, Any]:
    """Sources of a log, and its sessions, an hour apart."""
    size = len(voyages[0][0])
    starts = [k * 3600 * SECOND for k in range(len(voyages))]
    time = np.concatenate([start + np.arange(size) * SECOND // 10 for start in starts])
    out = {}
    for i, (name, quantity) in enumerate([("yaw", Quantity.YAW), ("velocity", Quantity.VELOCITY)]):
        column = np.concatenate([voyage[i] for voyage in voyages])
        values = np.stack([column, column], axis=1)[:, : 1 + i]
        samples = Samples(quantity, name, np.arange(len(time)), time, time, values)
        out[name] = SimpleNamespace(samples=samples)
    return out, [(start, start + size * SECOND // 10) for start in starts]


@pytest.mark.parametrize("step", [0.0001, 0.01, 0.1])
def test_coarse_values_of_two_voyages_are_not_taken_for_one(step: float) -> None:
    assert repeated_spans(*choices_of(sailed(1, step, step), sailed(2, step, step))) == []


@pytest.mark.parametrize("step", [0.0001, 0.01])
def test_what_is_there_twice_is_found_behind_another_voyage(step: float) -> None:
    one, other = sailed(1, step, step), sailed(2, step, step)
    again, sessions = choices_of(one, other, one)
    spans = repeated_spans(again, sessions)
    assert sum(end - start for start, end in spans) > 100 * SECOND
    assert all(start >= sessions[2][0] for start, _ in spans)
    assert "from 7200 s on" in repeated_notice(spans, sessions)[0]


def test_a_log_of_one_session_or_without_a_heading_is_not_looked_at() -> None:
    choices, sessions = choices_of(sailed(1, 0.01, 0.01), sailed(1, 0.01, 0.01))
    assert repeated_spans(choices, sessions[:1]) == []
    assert repeated_spans({"velocity": choices["velocity"]}, sessions) == []
    assert repeated_notice([], sessions) == ()
