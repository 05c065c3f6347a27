"""Which boat sailed which recording."""

import pytest

from gateway.errors import BadInput
from gateway.fleet import boat_of, read_fleet


def test_the_first_entry_that_matches_takes_a_recording(folder):
    boats = read_fleet(folder / "fleet.toml")
    logs = folder / "logs"
    paths = ("heron/monday.tlog", "heron/june/otter_1", "june/otter_1.BIN", "stray.tlog")
    found = [boat_of(str(logs / path), boats) for path in paths]
    assert [boat and boat.name for boat in found] == ["heron", "heron", "otter-1", None]
    assert boats[0].vessel_file == str(folder / "boat.toml")
    assert boats[1].vessel_file.endswith("configs/vessels/otter.toml")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "missing key vessels"),
        ('[[vessels]]\nname = "a"\n', "missing key vessels[0].file"),
        ('[[vessels]]\nname = "a"\nfile = "x"\nlogs = "y"\n', "unknown key vessels[0].logs"),
        ('[[vessels]]\nname = "a"\nfile = "x"\n' * 2, "the name 'a' is given to 2 vessels"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, text, expected):
    file = tmp_path / "fleet.toml"
    file.write_text(text)
    with pytest.raises(BadInput) as error:
        read_fleet(file)
    assert expected in str(error.value)
    assert str(file) in str(error.value)
