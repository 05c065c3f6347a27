"""Nothing in a table is cut off, however narrow the terminal."""

import re
from io import StringIO

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from rich.markup import escape
from rich.table import Table

from gateway.terminal import ResultConsole, result_table
from tests.conftest import ROOT

WORDS = st.text("abcµ≤89.-_/[]", min_size=1, max_size=45)
TITLE = "voyage [one].tlog"


def printed(table: Table, width: int) -> str:
    out = StringIO()
    ResultConsole(file=out, width=width).print(table)
    return out.getvalue()


def bare(text: str) -> str:
    """Without frames, blanks and ends of lines."""
    return re.sub(r"[\s\u2500-\u257f]", "", text)


def numbers() -> Table:
    table = result_table("fitted", "parameter", "before", "value", "95 % interval", unit=True)
    table.add_row("N_rr (voyage_1)", "-1.2345e+04", "-1.23456e+04", "-2.5e+04 … -1.1e+04", "N m s²")
    return table


@settings(max_examples=100, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    st.lists(st.tuples(WORDS, st.booleans()), min_size=1, max_size=7),
    st.integers(24, 120),
    st.data(),
)
def test_every_cell_of_every_table_is_whole(
    columns: list[tuple[str, bool]], width: int, data: st.DataObject
) -> None:
    """Whatever is in it, all letters of its cells are there (in a paragraph the first cell stands
    for itself, without its header)."""
    table = Table(title=escape(TITLE))
    for header, no_wrap in columns:
        table.add_column(escape(header), no_wrap=no_wrap)
    cells = data.draw(st.tuples(*(WORDS for _ in columns)))
    table.add_row(*map(escape, cells))
    text = printed(table, width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    letters = sorted("".join((*(header for header, _ in columns[1:]), *cells)))
    for letter in set(letters):
        assert bare(text).count(letter) >= letters.count(letter)


def test_numbers_that_do_not_fit_side_by_side_stand_below_one_another() -> None:
    lines = printed(numbers(), 60).splitlines()
    assert lines == [
        "fitted",
        "N_rr (voyage_1)",
        "  before: -1.2345e+04",
        "  value: -1.23456e+04",
        "  95 % interval: -2.5e+04 … -1.1e+04",
        "  unit: N m s²",
    ]


def test_numbers_that_fit_stay_a_table() -> None:
    text = printed(numbers(), 100)
    assert "│ N_rr (voyage_1) │ -1.2345e+04 │ -1.23456e+04 │ -2.5e+04 … -1.1e+04 │ N m s² │" in text


def test_prose_beside_numbers_is_folded_not_cut() -> None:
    table = Table("recording", "why")
    table.add_row("a/very/long/folder/of/recordings/voyage_1.tlog", "the fastest of what it holds")
    text = printed(table, 40)
    assert "┃" in text
    assert "voyage_1.tlog" in bare(text).replace("│", "")


@pytest.mark.parametrize("folder", ["terminal", "commands", "offline", "fleet"])
def test_results_go_through_the_console_that_cuts_nothing(folder: str) -> None:
    for file in (ROOT / "gateway" / folder).glob("*.py"):
        if file != ROOT / "gateway/terminal/__init__.py":
            assert not re.search(r"(?<![a-zA-Z])Console\(", file.read_text()), file.name
