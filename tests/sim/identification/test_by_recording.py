"""What many recordings say together: weights, intervals, the odd one out, boats of one type."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.identification import IdentifySettings, by_recording
from sim.identification.by_recording import ByRecording, RecordingFit, pooled
from sim.identification.identify import fitted_model
from sim.identification.parameters import unknowns_of
from sim.model import Model
from sim.prediction.segments import NoUsableTimeError
from sim.state import CountedStep
from sim.vessel import KNOT_PREFIX, Vessel, with_free_curves
from tests.sim.voyages import WAM_V

NAMES = ("m11", "X_u", "N_r")
TRUE = np.array([120.0, -25.0, -100.0])
THRUST = ("left.ahead", "right.ahead")


def said(
    random: np.random.Generator, k: int, share: float = 0.02, voyage: float = 0.02, **more: float
) -> RecordingFit:
    """A recording: its own noise of `share`, correlated; the scatter of its voyage."""
    root = share * np.abs(TRUE)[:, None] * np.array([[1, 0, 0], [0.7, 0.7, 0], [0.2, 0.3, 0.9]])
    value = TRUE * (1.0 + voyage * random.normal(size=3)) + root @ random.normal(size=3)
    for name, factor in more.items():
        value[NAMES.index(name)] *= factor
    return RecordingFit(f"r{k}", "", NAMES, value, root @ root.T, {})


def sigmas(found: ByRecording) -> np.ndarray:
    return np.array([
        (one.value - true) / ((one.ci95[1] - one.ci95[0]) / 3.92)
        for one, true in zip(found.numbers, TRUE, strict=True)
    ])  # fmt: skip


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say_and_few_are_named() -> None:
    random, held, named = np.random.default_rng(5), [], 0
    for _ in range(16):
        found = pooled([said(random, k, 0.03, 0.03) for k in range(6)], WAM_V)
        held += (np.abs(sigmas(found)) < 1.96).tolist()
        named += bool(found.disagreements)
    assert np.mean(held) > 0.88
    assert named <= 2


def test_a_noisy_recording_weighs_little() -> None:
    random = np.random.default_rng(6)
    fits = [said(random, k, 0.2 if k == 2 else 0.02, 0.0) for k in range(5)]
    found = pooled(fits, WAM_V)
    assert sum(found.weight) == pytest.approx(1.0, abs=1e-6)
    assert found.weight[2] < 0.1 * found.weight[0]
    assert np.abs(sigmas(found)).max() < 3.0


def test_one_that_disagrees_is_named_and_not_averaged() -> None:
    random = np.random.default_rng(7)
    fits = [said(random, k, N_r=1.4 if k == 3 else 1.0) for k in range(6)]
    found = pooled(fits, WAM_V)
    (odd,) = found.disagreements
    assert (odd.recording, odd.name) == ("r3", "N_r")
    assert odd.text.startswith("r3 disagrees with the others and is left out: N_r is -1")
    assert found.weight[3] == 0.0
    assert found.numbers[2].value == pytest.approx(-100.0, rel=0.03)
    assert {one.recordings for one in found.numbers} == {5}


def test_a_number_that_no_vessel_can_have_stands_at_the_limit() -> None:
    """Recordings that tell nothing of a number may put it anywhere."""
    random = np.random.default_rng(11)
    found = pooled([said(random, k, 0.01, X_u=-0.3) for k in range(3)], WAM_V)
    drag = found.numbers[1]
    assert drag.value == 0.0
    assert drag.ci95[0] > 0.0
    assert found.vessels[""].dynamics.X_u == 0.0


def test_of_two_nobody_is_named() -> None:
    random = np.random.default_rng(8)
    found = pooled([said(random, 0), said(random, 1, N_r=2.0)], WAM_V)
    assert not found.disagreements


def test_boats_of_one_type_share_the_hull_and_have_their_own_thrusters() -> None:
    """Alone the second boat tells all but one scale; beside the first its thrust is known."""
    random, fits = np.random.default_rng(9), []
    true = np.concatenate([TRUE, [80.0, 72.0]])
    for k in range(8):
        one = said(random, k)
        if k < 4:
            fits.append(one._replace(boat="a"))
            continue
        root = np.column_stack([np.diag(0.02 * true), 3.0 * true])  # the scale is not known
        value = true + root[:, :5] @ random.normal(size=5)
        value *= 1.0 + random.normal() * 0.5
        fits.append(RecordingFit(f"r{k}", "b", (*NAMES, *THRUST), value, root @ root.T, {}))
    found = pooled(fits, WAM_V, THRUST)
    thrust = [one for one in found.numbers if one.boat]
    assert [(one.name, one.boat) for one in thrust] == [(name, "b") for name in THRUST]
    assert [one.value for one in thrust] == pytest.approx([80.0, 72.0], rel=0.06)
    assert found.vessels["a"].thrusters == WAM_V.thrusters
    ahead = [t.thrust[1] for t in found.vessels["b"].thrusters]
    assert ahead == [one.value for one in thrust]
    assert found.vessels["a"].dynamics == found.vessels["b"].dynamics


def test_the_vessel_holds_the_numbers_that_are_told() -> None:
    random = np.random.default_rng(10)
    found = pooled([said(random, k) for k in range(4)], WAM_V)
    unknowns = unknowns_of(Model.of(WAM_V), 1, IdentifySettings(free=NAMES, offsets=False))
    values = {one.name: one.value for one in found.numbers}
    z = np.array([values[u.name] for u in unknowns.each])
    assert found.vessels[""] == fitted_model(unknowns, z).vessel
    assert found.to_dict()["parameters"][0]["value"] == found.numbers[0].value


@pytest.mark.usefixtures("plain_laws")
def test_knots_of_a_curve_are_put_together_as_shares_of_full_thrust() -> None:
    vessel = with_free_curves(WAM_V, ["left.curve"])
    names = tuple(n for n in Model.of(vessel).names if n.startswith(f"left.{KNOT_PREFIX}"))
    knots = np.array([vessel_value(vessel, name) for name in names])
    fits = [RecordingFit(f"r{k}", "", names, 0.9 * knots, 1e-6 * np.eye(len(names)), {})
            for k in range(3)]  # fmt: skip
    found = pooled(fits, vessel)
    assert [one.value for one in found.numbers] == pytest.approx((0.9 * knots).tolist())
    fitted = [vessel_value(found.vessels[""], name) for name in names]
    assert fitted == pytest.approx((0.9 * knots).tolist())


def vessel_value(vessel: Vessel, name: str) -> float:
    model = Model.of(vessel)
    return float(model.theta[model.names.index(name)])


def test_a_recording_too_short_is_left_out_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(12)
    fits = {f"r{k}": said(random, k) for k in range(4)}
    monkeypatch.setattr(by_recording, "fit_recording", lambda trial, *_: fits[trial.name])
    trials = [SimpleNamespace(name=f"r{k}", usable=np.ones(100 if k == 1 else 300), dt=0.1)
              for k in range(4)]  # fmt: skip
    lines: list[CountedStep] = []
    found = by_recording.identify_by_recording(trials, WAM_V, progress=lines.append)
    assert [(line, line.done, line.total) for line in lines][1:] == [
        ("r2 (2 of 3)", 1, 3), ("r3 (3 of 3)", 2, 3),
    ]  # fmt: skip
    assert [fit.recording for fit in found.fits] == ["r0", "r2", "r3"]
    assert found.notices == ("r1 is left out: 10 s of usable time, 20 s are needed",)
    with pytest.raises(NoUsableTimeError, match="no recording has 20 s"):
        by_recording.identify_by_recording(trials[1:2], WAM_V)


def test_numbers_that_no_recording_tells_alone_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(13)
    monkeypatch.setattr(by_recording, "fit_recording", lambda trial, *_: fits[trial.name])
    trials = [SimpleNamespace(name=f"r{k}", usable=np.ones(300), dt=0.1) for k in range(4)]
    fits = {f"r{k}": said(random, k) for k in range(4)}
    assert by_recording.identify_by_recording(trials, WAM_V).notices == ()
    wide = np.diag([1.0, 1.0, 9e4])
    fits = {name: fit._replace(covariance=wide) for name, fit in fits.items()}
    (told,) = by_recording.identify_by_recording(trials, WAM_V).notices
    assert told.startswith("these recordings, each alone, tell little of N_r: intervals are wider")
