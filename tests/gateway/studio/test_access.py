"""The page sees the files of the folders it was given, and writes into one."""

import pytest

from gateway.errors import BadInput
from gateway.studio.access import Folders

VESSEL = "[hull]\n[dynamics]\n"


@pytest.fixture
def folders(tmp_path):
    given = tmp_path / "logs"
    given.mkdir()
    (given / "one.tlog").write_bytes(b"")
    (given / "boat.toml").write_text(VESSEL)
    (given / "pyproject.toml").write_text("[project]\n")
    (tmp_path / "secret.tlog").write_bytes(b"")
    (given / "link.tlog").symlink_to(tmp_path / "secret.tlog")
    return Folders.of([given / "one.tlog"], [], tmp_path / "out")


def test_recordings_and_vessels_of_the_folder_are_offered_and_links_out_of_it_are_not(folders):
    assert [f.name for f in folders.recordings()] == ["one.tlog"]
    assert [f.name for f in folders.vessels()] == ["boat.toml"]


@pytest.mark.parametrize("path", ["../secret.tlog", "link.tlog", "/etc/passwd", "."])
def test_whatever_lies_elsewhere_is_refused(folders, path):
    with pytest.raises(BadInput, match="not in a folder"):
        folders.checked(folders.read[0] / path)


@pytest.mark.parametrize(
    "name",
    ["../boat.toml", "a/b.toml", "boat", ".toml", "boat.py", "", "x" * 90 + ".toml", "a\n.toml"],
)
def test_only_a_plain_name_is_saved_under(folders, name):
    with pytest.raises(BadInput, match="plain name"):
        folders.to_save(name)


def test_nothing_is_written_over_and_what_was_saved_is_offered(folders):
    file = folders.to_save("better boat.toml")
    file.parent.mkdir()
    file.write_text(VESSEL)
    with pytest.raises(BadInput, match="there already"):
        folders.to_save("better boat.toml")
    assert file in folders.vessels()
    assert folders.checked(file) == file


def test_a_folder_that_is_not_there_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="no such folder"):
        Folders.of([], [tmp_path / "nowhere"], tmp_path)


def test_a_file_that_looks_like_a_vessels_and_is_none_is_named_with_the_reason(folders):
    """No reason holds the folder: it is shown beside the list."""
    reasons = folders.refused_vessels()
    assert {file.name for file in reasons} == {"boat.toml"}
    assert "/" not in next(iter(reasons.values())).split(":")[0]
