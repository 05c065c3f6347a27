"""The paper's experiments on short runs: the measurement path, the conversions, the tables."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden.boats import NINE
from benchmarks.paper import excitations
from benchmarks.paper.boats import Pair, iacquabot, truth, wam_v
from benchmarks.paper.campaign import Campaign, Lengths, run
from benchmarks.paper.instruments import RTK
from benchmarks.paper.mismatch import followed
from benchmarks.paper.part import Part
from benchmarks.paper.published import TABLE_6, TABLE_8, Score
from benchmarks.paper.scoring import scored
from benchmarks.paper.shadow import shadows
from benchmarks.paper.table4 import simulated, table_4
from benchmarks.paper.table5 import intervals, meets, table_5
from benchmarks.paper.table6 import JUDGED, compared, table_6
from benchmarks.paper.table7 import DT, driven, table_7
from benchmarks.paper.table8 import direction, disturbed, resultant
from benchmarks.paper.voyage import motion_of, sailed
from sim.following.follower import Axes, FollowerOptions, VesselFollower
from sim.model import Model

PAIRS = (iacquabot(), wam_v())
SHORT = Lengths(identification=60.0, validation=30.0, joystick=12.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("paper")


@pytest.fixture(scope="module")
def campaign(folder: Path) -> Campaign:
    return run(SHORT, folder, seen_through=[RTK])


def whole(part: Part) -> None:
    """Every row of a table has as many cells as its header, and there is something to see."""
    width = 0
    for line in part.lines:
        cells = line.count("|")
        assert not cells or not width or cells == width, line
        width = cells
    assert part.pictures


@pytest.mark.parametrize("pair", PAIRS, ids=lambda p: p.name)
def test_nature_and_vessel_file_describe_one_boat(pair: Pair) -> None:
    assert truth(pair).tolist() == [getattr(pair.boat.hull, name) for name in NINE]
    commands = excitations.validation(6.0, np.random.default_rng(1))
    moved = sailed(pair.boat, commands)
    side = [0 if t.position[1] < 0.0 else 1 for t in pair.vessel.thrusters]
    own = simulated(pair.vessel, commands[:, side])
    other = motion_of(moved)[moved.armed]
    assert np.ptp(other[:, 5]) > 0.02
    # pulses are whole microseconds, of which 400 are full thrust
    np.testing.assert_allclose(own[:-1, 3:6], other[:, 3:], atol=2e-3)


@pytest.mark.parametrize("family", [*excitations.IDENTIFICATION, excitations.validation,
                                    excitations.joystick])  # fmt: skip
def test_commands_are_commands_and_the_same_again(family: excitations.Family) -> None:
    first, again = (family(30.0, np.random.default_rng(4)) for _ in range(2))
    assert first.shape == (1500, 2)
    assert np.abs(first).max() <= 1.0
    assert np.ptp(first[:, 0] - first[:, 1]) > 0.1
    np.testing.assert_array_equal(first, again)


def test_disturbances_have_the_resultants_of_the_paper() -> None:
    says = ["2.03 N @ 3.8°", "12.22 N @ 91.0°", "4.79 N @ 61.2°", "10.08 N @ -91.9°"]
    assert [resultant(pushes) for pushes in TABLE_8] == says


@pytest.mark.usefixtures("plain_laws")
def test_a_push_counter_clockwise_from_ahead_goes_to_port() -> None:
    vessel = disturbed(wam_v().vessel, [(10.0, 90.0)])
    assert direction(90.0) == pytest.approx(-np.pi / 2)
    moved = simulated(vessel, np.zeros((100, 2)))[-1]
    assert moved[1] < -0.05
    assert abs(moved[0]) < 1e-9


def test_a_true_belief_is_the_gateways_own_follower() -> None:
    vessel = wam_v().vessel
    reference = simulated(vessel, np.tile([0.8, 0.3], (100, 1)))
    reference[:, 3] += 0.01
    compiled = VesselFollower.of(Model.of(vessel))
    times = DT * np.arange(len(reference), dtype=np.float64)
    expected = compiled.advance(compiled.start(), times, reference).shadows
    np.testing.assert_array_equal(followed(vessel, vessel, reference, DT), expected)
    wrong = followed(vessel, wam_v().guessed(1), reference, DT)
    assert np.abs(wrong - expected)[:, 3:6].max() > 1e-4


def test_as_good_as_needs_all_three() -> None:
    paper = Score(0.1, 0.08, 0.99)
    assert Score(0.1, 0.08, 0.99).as_good_as(paper)
    for worse in (Score(0.11, 0.01, 1.0), Score(0.01, 0.09, 1.0), Score(0.01, 0.01, 0.98)):
        assert not worse.as_good_as(paper)


@pytest.mark.slow
def test_the_smoothed_measurement_is_near_the_truth(campaign: Campaign) -> None:
    for study in campaign.studies.values():
        rows = study.validation.usable
        off = (study.validation.nu - study.true_validation[:, 3:])[rows]
        assert np.sqrt(np.mean(off**2, axis=0)) == pytest.approx([0.0, 0.0, 0.0], abs=8e-3)
        assert np.abs(off).max() > 1e-3  # it is a measurement


@pytest.mark.slow
def test_tables_4_and_5(campaign: Campaign) -> None:
    whole(table_4(campaign))
    part = table_5(campaign)
    whole(part)
    assert all(part.held.values())
    study = campaign.studies["WAM-V", "rtk"]
    printed, default = intervals(study)["LQS printed"], intervals(study)["default"]
    assert not meets(printed[8], 10.6007, 1.1849)  # no Munk moment in its yaw row
    assert meets(default[8], 10.6007, 1.1849)


@pytest.mark.slow
def test_table_6(campaign: Campaign) -> None:
    whole(table_6(campaign))
    for study in campaign.studies.values():
        columns, paper = compared(study), TABLE_6[study.pair.name]
        for channel in ("u", "v", "r"):
            assert columns[JUDGED][channel].rmse < paper[channel].rmse
        assert columns["LQS printed"]["r"].rmse > columns[JUDGED]["r"].rmse


@pytest.mark.slow
def test_table_7(campaign: Campaign) -> None:
    part = table_7(campaign)
    whole(part)
    assert len(part.held) == 2  # (a), and (b) through one set of instruments
    assert all(part.held.values())


@pytest.mark.slow
def test_only_three_axes_hold_against_a_side_force(campaign: Campaign) -> None:
    wam = wam_v().vessel
    reference = driven(campaign, iacquabot().vessel)
    for way, holds in ((FollowerOptions(), True), (FollowerOptions(axes=Axes.SURGE_YAW), False)):
        shadow = followed(disturbed(wam, TABLE_8[1]), wam, reference, DT, way)
        worst = max(s.rmse for s in scored(reference[:, :6], shadow[:, :6]).values())
        assert (worst < 0.1) is holds


@pytest.mark.slow
def test_the_shadow_of_a_measured_reference(campaign: Campaign, folder: Path) -> None:
    part = shadows(campaign, folder)
    whole(part)
    assert sum("shadow: WAM-V" in line for line in part.lines) == 1
