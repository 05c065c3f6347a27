"""Weak motors of the generator's own physics are told by side, and where all are weak as that."""

from pathlib import Path

import pytest

from benchmarks.motors import KINDS, Voyage, voyages, write
from gateway.offline.diagnose import diagnose_logs
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.effects.catalogue import named

RIVALS = (
    "thruster_imbalance", "thrust_scale", "towed_load", "thruster_misalignment", "hull_lift",
    "steering_scale", "steering_offset", "thruster_fault", "drag_growth", "payload_change",
    "lever_arm",
)  # fmt: skip
FEW = DiagnoseSettings(effects=tuple(map(named, RIVALS)))


def voyage(kind: str, number: int) -> Voyage:
    return list(voyages(kind))[number]


def test_a_voyage_is_the_same_whatever_else_is_run_and_other_dice_are_other_voyages() -> None:
    for kind in KINDS:
        assert list(voyages(kind)) == list(voyages(kind))
        low, high = (0.5, 2.0) if kind in ("arm", "one_arm") else (0.6, 0.88)
        assert all(low <= v.share <= high for v in voyages(kind, seed=1))
    assert [v.second for v in voyages("second")][:2] == ["steady_current", "heading_offset"]
    assert not any(v.hidden for kind in ("steering", "arm", "one_arm") for v in voyages(kind))
    assert {(v.share > 1.0, v.seed % 2) for v in voyages("arm")} == {
        (further, off) for further in (True, False) for off in (0, 1)
    }
    assert {len(v.hidden) for v in voyages("all")} == {2, 4}  # the IAcquaBot has four motors
    assert list(voyages("port", 1)) != list(voyages("port"))
    moments = [{h.values["time"] for h in v.hidden} for v in voyages("later")]
    assert all(len(m) == 1 and 90.0 <= min(m) <= 210.0 for m in moments)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "starboard"), [("starboard", 1.0), ("port", 0.0)])
def test_the_side_that_is_weak_is_named(tmp_path: Path, kind: str, starboard: float) -> None:
    """And no tow is told because the hull would have to be bent."""
    v = voyage(kind, 2)
    log, file = write(v, tmp_path)
    found = diagnose_logs([log], file, settings=FEW).diagnosis
    assert found.effects == ("thruster_imbalance",)
    (added,) = found.ladder[-1].vessel.effects
    assert added.values["starboard"] == starboard
    share = 2.0 - added.values["port_gain"] if starboard else added.values["port_gain"]
    assert share == pytest.approx(v.share, abs=0.04)


@pytest.mark.slow
def test_a_steering_that_turns_less_far_than_the_file_says_is_named(tmp_path: Path) -> None:
    """And no lift of the hull is told, that turns her less too."""
    v = voyage("steering", 1)
    log, file = write(v, tmp_path)
    found = diagnose_logs([log], file, settings=FEW).diagnosis
    assert found.effects == ("steering_scale",)
    (added,) = found.ladder[-1].vessel.effects
    assert added.values["gain"] == pytest.approx(v.share, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 4])
def test_motors_nearer_or_further_out_than_in_the_file_are_named(
    tmp_path: Path, number: int
) -> None:
    """And neither are all said to push less, nor is a lift of the hull that turns her."""
    v = voyage("arm", number)
    log, file = write(v, tmp_path)
    found = diagnose_logs([log], file, settings=FEW).diagnosis
    assert found.effects == ("lever_arm",)
    (added,) = found.ladder[-1].vessel.effects
    assert added.values["gain"] == pytest.approx(v.share, rel=0.12)


@pytest.mark.slow
def test_all_motors_that_push_less_are_no_curve_and_no_tow(tmp_path: Path) -> None:
    v = voyage("all", 2)
    weaker = [h._replace(values={**h.values, "gain": 0.55}) for h in v.hidden]
    log, file = write(v._replace(hidden=tuple(weaker)), tmp_path)
    found = diagnose_logs([log], file, settings=FEW).diagnosis
    assert found.effects == ("thrust_scale",)
    (added,) = found.ladder[-1].vessel.effects
    assert added.values["gain"] == pytest.approx(0.55, abs=0.06)


@pytest.mark.slow
def test_motors_that_all_weaken_at_one_moment_are_no_growing_drag_and_no_payload(
    tmp_path: Path,
) -> None:
    v = voyage("later", 2)
    log, file = write(v, tmp_path)
    found = diagnose_logs([log], file, settings=FEW).diagnosis
    assert (found.verdict.value, found.effects) == ("explained", ("thruster_fault",))
    (added,) = found.ladder[-1].vessel.effects
    assert added.values["thruster"] == 0.0
    assert added.values["gain"] == pytest.approx(v.share, abs=0.04)
    armed = 5.8  # s of the log before the voyage begins
    assert added.values["time"] == pytest.approx(v.hidden[0].values["time"] + armed, abs=5.0)
