"""The studio takes a mapping file for tables, as the commands do."""

from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.ingest.log_events import Happenings
from gateway.studio.serve import StudioOptions, session_of
from gateway.studio.tasks import fit_task, measured_view, trials_in
from gateway.studio.worker import card_task
from tests.gateway.ingest.made_table import Traps, boat_toml, written
from tests.gateway.terminal.test_next_step import COMMANDED, table


def test_a_table_is_read_with_the_mapping_that_was_given(tmp_path: Path) -> None:
    path, mapping = table(tmp_path, COMMANDED).path, str(tmp_path / "columns of mine.toml")
    sent: list[object] = []
    assert card_task(sent.append, path, mapping).survey.kind == "csv"
    (trial,) = trials_in(path, mapping)
    assert trial.channels == (1,)
    with pytest.raises(BadInput, match="needs a mapping file"):
        trials_in(path)


def test_a_table_names_no_mode_and_is_drawn_all_the_same(tmp_path: Path) -> None:
    path, mapping = table(tmp_path, COMMANDED).path, str(tmp_path / "columns of mine.toml")
    (trial,) = trials_in(path, mapping)
    view = measured_view(trial, path, Happenings())
    lanes = view.commands.panels[-1].lanes
    assert lanes is not None
    assert set(lanes.texts) == {"armed"}


def test_the_session_holds_it_and_a_missing_one_is_one_line(tmp_path: Path) -> None:
    log = Path(table(tmp_path, COMMANDED).path)
    mapping = tmp_path / "columns of mine.toml"
    session = session_of(StudioOptions((log,), mapping=mapping, out=tmp_path))
    try:
        assert session.mapping == str(mapping)
    finally:
        session.close()
    with pytest.raises(BadInput, match=r"absent\.toml: no such file"):
        session_of(StudioOptions((log,), mapping=tmp_path / "absent.toml", out=tmp_path))


def test_a_fit_that_is_refused_names_no_file_of_the_studios_own(tmp_path: Path) -> None:
    path, _ = written(tmp_path, Traps(swapped=True))
    with pytest.raises(BadInput) as refused:
        fit_task(lambda _: None, [str(path)], boat_toml(1, 3), ())
    assert str(refused.value).startswith("vessel.toml: port and starboard commands look swapped")
