"""Tables that do not keep their word are found out, honest ones are left alone."""

from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.log import choose_boat
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.ingest.survey import survey
from gateway.ingest.table_repair import changed_rows, hold_period, repair_table, undo_hold
from gateway.offline.compare import compare_logs
from gateway.offline.trials import load_trials
from gateway.samples import Quantity
from tests.gateway.ingest.made_table import MAPPING, METRES, Traps, boat_toml, written


def notices(folder: Path, traps: Traps) -> tuple[str, ...]:
    """What `info` says is wrong with such a table."""
    return survey(open_log(written(folder, traps)[0])).boats[0].notices


def tidy(folder: Path, traps: Traps):
    """The sources that are left."""
    log = open_log(written(folder, traps)[0])
    decoded = log.decode(choose_boat(log, None))
    return repair_table(decoded, choose(decoded.samples))


def test_an_honest_table_is_taken_as_it_is(tmp_path: Path) -> None:
    found = tidy(tmp_path, Traps())
    assert set(found.choices) >= {"position", "velocity", "yaw", "yaw rate", "commands"}
    assert found.notices == (
        "accelerations are not used: motion follows from positions, headings and rates",
    )


@pytest.mark.parametrize("how", ["savgol", "mean"])
def test_rates_smoothed_to_both_sides_give_way(tmp_path: Path, how: str) -> None:
    found = tidy(tmp_path, Traps(rates=how))
    assert not {"velocity", "yaw rate"} & set(found.choices)
    assert any("smoothed over about" in says and "before its command" in says
               for says in found.notices)  # fmt: skip


@pytest.mark.parametrize("how", ["lag", "late", "noisy"])
def test_rates_that_are_late_or_noisy_are_not_called_smoothed(tmp_path: Path, how: str) -> None:
    found = tidy(tmp_path, Traps(rates=how))
    assert {"velocity", "yaw rate"} <= set(found.choices)


def test_a_smoothed_table_with_held_fixes_is_found_too(tmp_path: Path) -> None:
    found = tidy(tmp_path, Traps(rates="savgol", held=True))
    assert not {"velocity", "yaw rate"} & set(found.choices)
    assert any(says.startswith("position comes at 5.0 Hz") for says in found.notices)


def test_held_fixes_go_back_to_their_own_times(tmp_path: Path) -> None:
    path, made = written(tmp_path, Traps(held=True))
    log = open_log(path)
    (place,) = [s for s in log.samples() if s.quantity is Quantity.GLOBAL_POSITION]
    found = undo_hold(place)
    assert found is not None
    time = found.vehicle_time_ns * 1e-9
    steps = np.diff(time)
    assert np.median(steps) == pytest.approx(0.2, abs=1e-3)
    true = np.interp(time, made.time, made.pose[:, 0])
    north = (found.values[:, 0] - 63.4) * METRES
    shown = (place.values[:, 0] - 63.4) * METRES
    as_shown = np.std(shown - np.interp(place.vehicle_time_ns * 1e-9, made.time, made.pose[:, 0]))
    assert np.std(north - true) < 0.25 * as_shown


def test_a_boat_at_rest_has_fixes_and_a_silent_receiver_has_none(tmp_path: Path) -> None:
    path, _ = written(tmp_path, Traps(held=True))
    (place,) = [s for s in open_log(path).samples() if s.quantity is Quantity.GLOBAL_POSITION]
    silent = place.values.copy()
    silent[600:650] = silent[600]  # five seconds without a fix, then a jump
    still = place.values.copy()
    still[600:] += still[600] - still[650]
    still[600:650] = place.values[600]  # the boat lies still, then goes on from there
    after = {}
    for name, values in (("silent", silent), ("still", still)):
        found = undo_hold(type(place)(**{**vars(place), "values": values}))
        assert found is not None
        time = found.vehicle_time_ns * 1e-9
        after[name] = float(np.diff(time[(time > 58.0) & (time < 67.0)]).max())
    assert after["silent"] > 4.5
    assert after["still"] < 0.5


def test_what_changes_in_every_row_is_not_held(tmp_path: Path) -> None:
    path, _ = written(tmp_path, Traps())
    for samples in open_log(path).samples():
        if samples.quantity in (Quantity.YAW, Quantity.YAW_RATE):
            assert undo_hold(samples) is None
            time = samples.vehicle_time_ns * 1e-9
            assert hold_period(time, changed_rows(samples.values)) is None


def test_gravity_in_an_acceleration_is_told(tmp_path: Path) -> None:
    assert any("gravity" in says for says in notices(tmp_path, Traps(gravity=0.8)))
    assert not any("gravity" in says for says in notices(tmp_path, Traps()))


@pytest.mark.parametrize("turned", [False, True])
def test_info_tells_swapped_sides_whichever_way_a_motor_turns(tmp_path: Path, turned: bool) -> None:
    said = notices(tmp_path, Traps(swapped=True, left_turned=turned))
    assert any("port and starboard commands look swapped" in says for says in said)
    said = notices(tmp_path, Traps(left_turned=turned))
    assert not any("swapped" in says for says in said)


def test_a_straight_run_tells_nothing_of_sides(tmp_path: Path) -> None:
    said = notices(tmp_path, Traps(swapped=True, straight=True))
    assert not any("swapped" in says for says in said)


def test_compare_tells_swapped_sides_until_the_vessel_file_is_right(tmp_path: Path) -> None:
    path, _ = written(tmp_path, Traps(swapped=True))
    told = []
    for channels in ((1, 3), (3, 1)):
        vessel = tmp_path / "boat.toml"
        vessel.write_text(boat_toml(*channels), encoding="utf-8")
        (found,) = compare_logs([path], [vessel])
        told.append(any("swapped" in says for says in found.notices))
    assert told == [True, False]


def test_a_trial_from_a_table_with_all_traps_holds_the_motion(tmp_path: Path) -> None:
    path, made = written(tmp_path, Traps(swapped=True, held=True, rates="savgol", gravity=0.5))
    (trial,) = load_trials(path)
    at = trial.start_time_ns * 1e-9 + trial.time
    error = trial.nu - np.stack([np.interp(at, made.time, x) for x in made.nu.T], axis=1)
    _, told = written(tmp_path, Traps(rates="savgol"))
    smoothed = np.genfromtxt(path, delimiter=",", skip_header=1)[:, [5, 6, 4]] - told.nu
    assert len(trial.notices) == 3
    assert np.sqrt(np.mean(error[20:-20, 0] ** 2)) < 0.5 * np.sqrt(np.mean(smoothed[:, 0] ** 2))
    assert np.sqrt(np.mean(error[20:-20, 2] ** 2)) < 0.5 * np.sqrt(np.mean(smoothed[:, 2] ** 2))


@pytest.mark.parametrize("run", ["224", "232", "234"])
def test_the_traps_of_real_tables_are_found(shared_data: Path, run: str) -> None:
    table = shared_data / "blueboat-lake" / "runs" / f"fixed_00000{run}.csv"
    mapping = Path(__file__).parents[3] / "configs" / "csv" / "blueboat-lake.toml"
    said = survey(open_log(table, mapping)).boats[0].notices
    for trap in ("commands look swapped", "repeated on rows", "holds gravity", "smoothed over"):
        assert any(trap in says for says in said)


EXCHANGED = {'"lat"': '"here"', '"lon"': '"lat"', '"here"': '"lon"'}
MISTAKES: dict[str, tuple[dict[str, str], str]] = {  # of a mapping -> what is said
    "a rate in degrees": ({'"r", unit = "rad/s"': '"r", unit = "deg/s"'},
                          "yaw rate (CSV) is 0.01"),
    "knots": ({'"u", unit = "m/s"': '"u", unit = "kn"', '"v", unit = "m/s"': '"v", unit = "kn"'},
              "m/s taken for knots?"),
    "exchanged": (EXCHANGED, "latitude and longitude (CSV) look exchanged"),
}  # fmt: skip
TELLS = ("taken for", "exchanged", "times the", "beyond 90")  # words of such sentences


def said_of(table: Path, mapping: str, changes: dict[str, str]) -> list[str]:
    """What `info` says of a table whose mapping has these mistakes, of units and columns."""
    for right, wrong in changes.items():
        assert right in mapping
        mapping = mapping.replace(right, wrong)
    file = table.with_suffix(".toml")
    file.write_text(mapping)
    return [t for t in survey(open_log(table)).boats[0].notices if any(w in t for w in TELLS)]


@pytest.mark.parametrize("rates", ["", "savgol", "mean", "lag"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_units_and_columns_that_are_mistaken_are_told(
    tmp_path: Path, rates: str, mistake: str
) -> None:
    changes, says = MISTAKES[mistake]
    table, _ = written(tmp_path, Traps(rates=rates), seconds=60.0)
    assert said_of(table, MAPPING, {}) == []
    (found,) = said_of(table, MAPPING, changes)
    assert says in found


def test_one_of_two_smoothed_rates_is_told_also_where_both_are_left_out(tmp_path: Path) -> None:
    table, _ = written(tmp_path, Traps(rates="savgol"))
    changes, says = MISTAKES["a rate in degrees"]
    assert says in said_of(table, MAPPING, changes)[0]
    notices = survey(open_log(table)).boats[0].notices
    assert any(t.startswith("velocity is smoothed over about") for t in notices)


def test_a_latitude_beyond_the_pole_is_told(tmp_path: Path) -> None:
    table, _ = written(tmp_path, Traps())
    lines = [line.split(",") for line in table.read_text().splitlines()]
    where = lines[0].index("lon")
    for line in lines[1:]:
        line[where] = f"{float(line[where]) + 120.0:.7f}"
    table.write_text("\n".join(map(",".join, lines)) + "\n")
    assert said_of(table, MAPPING, {}) == []
    with pytest.raises(BadInput, match=r"latitude cannot be 'deg': .*longitude exchanged\?"):
        said_of(table, MAPPING, EXCHANGED)


def test_real_tables_raise_no_alarm_and_mistakes_in_them_do(
    shared_data: Path, tmp_path: Path
) -> None:
    mapping = (Path(__file__).parents[3] / "configs" / "csv" / "blueboat-lake.toml").read_text()
    runs = sorted((shared_data / "blueboat-lake" / "runs").glob("*.csv"))
    assert runs
    for run in runs:
        table = tmp_path / run.name
        table.write_bytes(run.read_bytes())
        assert said_of(table, mapping, {}) == []
        if run.stem[-3:] in ("220", "232", "234"):  # that turn and go on
            for changes, says in MISTAKES.values():
                renamed = {k.replace('"r"', '"yaw_rate"').replace('"u"', '"surge"')
                           .replace('"v"', '"sway"'): v.replace('"r"', '"yaw_rate"')
                           .replace('"u"', '"surge"').replace('"v"', '"sway"')
                           for k, v in changes.items()}  # fmt: skip
                assert any(says in text for text in said_of(table, mapping, renamed))
