"""Programs: they move every shipped vessel about, stay in range, and repeat."""

from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.simulated_boat import SimulatedBoatSettings
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.simulated_boat.hull import PROGRAMS, program_of
from gateway.vessel_file import load_vessel
from tests.sim.vessels import RUDDER_BOAT, SHAPES, STEERED_BOAT, WAMV

SHIPPED = sorted((Path(__file__).resolve().parents[3] / "configs/vessels").glob("*.toml"))


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize(
    "vessel",
    [pytest.param(v, marks=pytest.mark.slow if v is STEERED_BOAT else ()) for v in SHAPES],
    ids=lambda v: v.name,
)
def test_commands_are_in_range_and_in_order(name, vessel):
    program = program_of(vessel, name)
    assert np.all(np.diff(program.starts) > 0.0)
    assert program.starts[-1] < program.period
    assert program.rows.shape == (len(program.starts), len(vessel.actuators))
    assert np.abs(program.rows).max() <= 1.0
    assert name == "still" or np.ptp(program.rows) > 0.3


def test_a_program_repeats():
    program = program_of(WAMV, "zigzag")
    middle = 0.4 * program.period
    assert program.row_at(middle) == program.row_at(middle + 3.0 * program.period) != 0


def test_throttle_moves_no_faster_than_the_autopilot_lets_it():
    program = program_of(RUDDER_BOAT, "steps")
    throttle = np.interp(np.arange(0.0, 70.0, 0.1), program.starts, program.rows[:, 0])
    assert np.abs(np.diff(throttle)).max() < 0.15
    assert np.ptp(throttle) > 1.0


def test_random_depends_on_the_seed_alone():
    one, same, other = (program_of(WAMV, "random", seed).rows for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.slow
@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_every_shipped_vessel_turns_both_ways_and_keeps_near(path):
    boat = SimulatedBoat(load_vessel(path), SimulatedBoatSettings(rates={"HEARTBEAT": 1.0}))
    state, turned = boat.start(), []
    for second in range(100):
        state, _ = boat.advance(state, float(second))
        turned.append(state.hull[5])
    assert min(turned) < -0.02
    assert max(turned) > 0.02
    assert 3.0 < np.hypot(*state.hull[:2]) < 500.0


def test_a_table_of_commands_is_played_as_it_stands(tmp_path):
    table = tmp_path / "commands.csv"
    table.write_text("time,left,right\n0,0.5,-0.5\n2,1,1\n5,0,0\n")
    program = program_of(WAMV, table)
    assert program.period == 5.0
    assert [program.rows[program.row_at(t)].tolist() for t in (0.0, 1.9, 2.0, 4.9, 5.0)] == [
        [0.5, -0.5], [0.5, -0.5], [1.0, 1.0], [1.0, 1.0], [0.5, -0.5],
    ]  # fmt: skip


def test_an_unknown_program_names_those_there_are():
    with pytest.raises(BadInput, match="zigzag"):
        program_of(WAMV, "zigzak")
