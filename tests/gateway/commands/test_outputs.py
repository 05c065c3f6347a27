"""One rule for all commands: nothing is replaced but what the same command wrote."""

from collections.abc import Callable
from pathlib import Path
from typing import get_type_hints

import pytest

from gateway import cli
from gateway.demo import demo_files
from gateway.files import guarded_outputs
from gateway.fleet.table import FILES
from gateway.hil_demo.story import hil_demo_files
from gateway.offline.plan import plan_files
from tests.gateway.command_line import Run, one_line

Words = list[str | Path]
DIARY = b"Dear diary, today the sea was calm.\n"  # of the user's own

# Options of commands that name what is read, and commands that write nothing of the user's choice.
INPUTS = {
    "log", "logs", "vessel", "effects", "mapping", "config", "validate", "source", "signing_key",
    "follow", "folder", "commands", "files", "script", "with_hil", "autopilot", "vessels",
}  # fmt: skip
IN_PLACE = {"repair": "file"}  # what it is for
NAMED_BY_TIME = {"live", "studio", "hil"}  # never a name that is there
NAMED_BY_CONTENT = {("wear", "pictures")}  # known once the table is read: tests/gateway/fleet

# command and option -> words, given the folder, and the files that it may write
WRITERS: dict[tuple[str, str], tuple[Callable[[Path], Words], Callable[[Path], list[Path]]]] = {
    ("init", "out"): (
        lambda at: ["init", at / "voyage.tlog", "--out", at / "new.toml"],
        lambda at: [at / "new.toml"],
    ),
    ("replay", "out"): (
        lambda at: ["replay", at / "voyage.tlog", "-v", at / "boat.toml", "--no-publish",
                    "--out", at / "made"],
        lambda at: [at / "made" / "voyage-shadow.mcap"],
    ),
    ("simulate", "out"): (
        lambda at: ["simulate", at / "sticks.csv", "-v", at / "boat.toml", "--out", at / "made"],
        lambda at: [at / "made" / "sticks-simulated.mcap"],
    ),
    ("identify", "out"): (
        lambda at: ["identify", at / "voyage.tlog", "-v", at / "boat.toml", "--method",
                    "regression", "--out", at / "new.toml"],
        lambda at: [at / "new.toml"],
    ),
    ("identify", "pictures"): (
        lambda at: ["identify", at / "voyage.tlog", "-v", at / "boat.toml", "--method",
                    "regression", "--pictures", at / "made"],
        lambda at: [at / "made" / "voyage-track.png", at / "made" / "wam-v-parameters.png"],
    ),
    ("compare", "pictures"): (
        lambda at: ["compare", at / "voyage.tlog", "-v", at / "boat.toml", "--pictures",
                    at / "made"],
        lambda at: [at / "made" / "voyage-wam-v-strips.png"],
    ),
    ("diagnose", "out"): (
        lambda at: ["diagnose", at / "voyage.tlog", "-v", at / "boat.toml", "--out",
                    at / "new.toml"],
        lambda at: [at / "new.toml"],
    ),
    ("diagnose", "save"): (
        lambda at: ["diagnose", at / "voyage.tlog", "-v", at / "boat.toml", "--save",
                    at / "new.json"],
        lambda at: [at / "new.json"],
    ),
    ("diagnose", "pictures"): (
        lambda at: ["diagnose", at / "voyage.tlog", "-v", at / "boat.toml", "--pictures",
                    at / "made"],
        lambda at: [at / "made" / "ladder.png"],
    ),
    ("add", "out"): (
        lambda at: ["add", "hull_lift", "-v", at / "boat.toml", "--from", at / "answer.json",
                    "--out", at / "new.toml"],
        lambda at: [at / "new.toml"],
    ),
    ("report", "out"): (
        lambda at: ["report", at / "voyage.tlog", "-v", at / "boat.toml", "--out", at / "r.html"],
        lambda at: [at / "r.html"],
    ),
    ("export", "out"): (
        lambda at: ["export", at / "voyage.tlog", "--to", "csv", "--out", at / "table.csv"],
        lambda at: [at / "table.csv", at / "table.toml"],
    ),
    ("plan", "out"): (
        lambda at: ["plan", "-v", at / "boat.toml", "--seconds", "5", "--out", at / "made"],
        lambda at: plan_files(None, None, at / "made"),
    ),
    ("effects", "picture"): (
        lambda at: ["effects", "hull_lift", "--picture", at / "p.png"],
        lambda at: [at / "p.png"],
    ),
    ("effects", "write"): (
        lambda at: ["effects", "hull_lift", "--write", at / "keel.py"],
        lambda at: [at / "keel.py"],
    ),
    ("report", "pdf"): (
        lambda at: ["report", at / "voyage.tlog", "-v", at / "boat.toml", "--out",
                    at / "made" / "new.html", "--pdf", at / "new.pdf"],
        lambda at: [at / "new.pdf"],
    ),
    ("fleet", "out"): (
        lambda at: ["fleet", at / "voyage.tlog", "-v", at / "boat.toml", "--out", at / "made"],
        lambda at: [at / "made" / name for name in FILES],
    ),
    ("fleet", "report"): (
        lambda at: ["fleet", at / "voyage.tlog", "-v", at / "boat.toml", "--out", at / "made",
                    "--report", at / "new.html"],
        lambda at: [at / "new.html"],
    ),
    ("demo", "out"): (
        lambda at: ["demo", "--out", at / "made"],
        lambda at: demo_files(at / "made"),
    ),
    ("hil-demo", "out"): (
        lambda at: ["hil-demo", "--out", at / "made"],
        lambda at: hil_demo_files(at / "made"),
    ),
}  # fmt: skip
# what ends in seconds is also run to its end, one of each way to write among the fast tests
QUICK = [("init", "out"), ("export", "out"), ("plan", "out"), ("effects", "write")]
QUITE_QUICK = [("replay", "out"), ("simulate", "out"), ("compare", "pictures"),
               ("effects", "picture")]  # fmt: skip


@pytest.fixture
def place(tmp_path: Path, boat: Path, log: Path) -> Path:
    (tmp_path / "sticks.csv").write_text("time,left,right\n0,0,0\n1,1,1\n2,0,0\n")
    return tmp_path


def test_every_option_of_every_command_that_names_a_file_is_known() -> None:
    options = {
        (name, option): str(kind)
        for name, command in cli.COMMANDS.items()
        for option, kind in get_type_hints(command).items()
    }
    paths = {
        (name, option)
        for (name, option), kind in options.items()
        if "Path" in kind and option not in INPUTS and IN_PLACE.get(name) != option
        and name not in NAMED_BY_TIME
    }  # fmt: skip
    assert paths == set(WRITERS) | NAMED_BY_CONTENT
    forceful = {name for name, option in options if option == "force"}
    assert forceful == {name for name, _ in paths}


@pytest.mark.parametrize("which", WRITERS, ids="-".join)
def test_a_file_of_the_users_is_refused_before_any_work(
    run: Run, place: Path, which: tuple[str, str]
) -> None:
    words, outputs = WRITERS[which]
    (place / "voyage.tlog").write_bytes(b"text that no command can read, had it begun to work")
    (place / "boat.toml").write_text("this is no vessel")
    for file in outputs(place):
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(DIARY)
        before = sorted(place.rglob("*"))
        one_line(run(*words(place)), 2, f"{file}: is there already", "--force")
        assert file.read_bytes() == DIARY
        assert sorted(place.rglob("*")) == before
        file.unlink()


@pytest.mark.parametrize("which", WRITERS, ids="-".join)
def test_an_input_is_no_output(run: Run, place: Path, which: tuple[str, str]) -> None:
    words, outputs = WRITERS[which]
    given = [w for w in words(place)[1:] if isinstance(w, Path) and w.is_file()]
    for source in given:
        for file in outputs(place):
            file.parent.mkdir(exist_ok=True)
            file.hardlink_to(source)
            content = source.read_bytes()
            one_line(run(*words(place)), 2, f"{file}: this is an input of the command")
            assert source.read_bytes() == content
            file.unlink()


@pytest.mark.parametrize("which", WRITERS, ids="-".join)
def test_a_place_where_nothing_can_be_written_is_refused_before_any_work(
    run: Run, place: Path, which: tuple[str, str]
) -> None:
    """A file stands where a folder would have to be made."""
    words, _ = WRITERS[which]
    (place / "voyage.tlog").write_bytes(b"text that no command can read, had it begun to work")
    (place / "file").touch()
    given = [
        place / "file" / word.relative_to(place)
        if isinstance(word, Path) and word.is_relative_to(place) and not word.exists()
        else word
        for word in words(place)
    ]
    assert given != words(place)
    one_line(run(*given), 2, f"nothing can be written there ({place / 'file'}: Not a directory)")


@pytest.mark.parametrize(
    "words",
    [
        ["live", "udpin:127.0.0.1:14999", "-v", "otter", "--out"],
        ["hil", "json:127.0.0.1:9999", "-v", "otter", "--no-publish", "--out"],
        ["studio", "--no-browser", "--out"],
    ],
    ids=lambda words: words[0],
)
def test_a_folder_that_cannot_be_made_is_refused(run: Run, tmp_path: Path, words: Words) -> None:
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "folder"
    one_line(run(*words, out), 2, f"{out}: nothing can be written there")
    one_line(run(*words, "/proc/x"), 2, "/proc/x: nothing can be written there (/proc: ")


def test_to_ask_whether_a_place_can_be_written_leaves_nothing(tmp_path: Path) -> None:
    with guarded_outputs("init", [], [tmp_path / "new" / "folder" / "boat.toml"], False):
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "which",
    [*QUICK, *(pytest.param(which, marks=pytest.mark.slow) for which in QUITE_QUICK)],
    ids="-".join,
)
def test_what_the_command_wrote_may_be_replaced_until_somebody_edits_it(
    run: Run, place: Path, which: tuple[str, str]
) -> None:
    words, outputs = WRITERS[which]
    assert run(*words(place)).status == 0
    assert run(*words(place)).status == 0
    file = outputs(place)[0]
    assert file.is_file()
    with file.open("ab") as more:
        more.write(DIARY)
    edited = file.read_bytes()
    one_line(run(*words(place)), 2, str(file), "is there already, and not as")
    assert file.read_bytes() == edited
    done = run(*words(place), "--force")
    assert done.status == 0
    assert not file.read_bytes().endswith(DIARY)


def test_force_replaces_an_input(run: Run, place: Path) -> None:
    words = ["identify", place / "voyage.tlog", "-v", place / "boat.toml", "--method",
             "regression", "--out", place / "boat.toml"]  # fmt: skip
    one_line(run(*words), 2, "this is an input of the command")
    assert run(*words, "--force").status == 0
    assert "provenance" in (place / "boat.toml").read_text()


def test_what_another_command_wrote_is_refused(run: Run, place: Path) -> None:
    made = place / "new.toml"
    assert run("init", place / "voyage.tlog", "--out", made).status == 0
    words = ["identify", place / "voyage.tlog", "-v", place / "boat.toml", "--out", made]
    one_line(run(*words), 2, f"{made}: is there already, and not as `shadow identify` wrote it")


def test_a_picture_whose_name_came_up_late_is_not_written_over(tmp_path: Path) -> None:
    from gateway.errors import BadInput
    from gateway.files import write_whole

    late = tmp_path / "late.png"
    with guarded_outputs("compare", [], [], False):
        late.write_bytes(DIARY)
        with pytest.raises(BadInput, match="is there already"):
            write_whole(late, b"new", "the picture")
    assert late.read_bytes() == DIARY
    write_whole(late, b"new", "the picture")  # a notebook decides for itself
    assert late.read_bytes() == b"new"


NAMED = [which for which in WRITERS if which[1] != "pictures"]  # those of one file


@pytest.mark.parametrize("suffix", [".tlog", ".mcap", ".PDF"])
@pytest.mark.parametrize("which", NAMED, ids="-".join)
def test_a_name_of_another_kind_of_file_is_refused_before_any_work(
    run: Run, place: Path, which: tuple[str, str], suffix: str
) -> None:
    words, _ = WRITERS[which]
    option, given = f"--{which[1]}", words(place)
    at = given.index(option) + 1
    if not Path(given[at]).suffix or Path(given[at]).suffix == suffix.lower():
        pytest.skip("a folder, or rightly so")
    (place / "voyage.tlog").write_bytes(b"text that no command can read, had it begun to work")
    given[at] = Path(given[at]).with_suffix(suffix)
    before = sorted(place.rglob("*"))
    one_line(run(*given), 2, f"{given[at]}: what is written there is no {suffix}")
    assert sorted(place.rglob("*")) == before
    given[at] = Path(given[at]).with_suffix(".unheard")
    assert "what is written there" not in run(*given).err


def test_a_played_boat_is_written_into_a_tlog(run: Run, place: Path) -> None:
    words = ["simulate", "-v", place / "boat.toml", "--log", place / "played.csv"]
    one_line(run(*words), 2, "played.csv: what is written there is no .csv", ".tlog")
    words = ["export", place / "voyage.tlog", "--to", "csv", "--out", place / "e.parquet"]
    one_line(run(*words), 2, "e.parquet: what is written there is no .parquet", ".csv")


def test_one_name_for_two_outputs_is_refused(run: Run, place: Path) -> None:
    out = place / "new"
    words = ["diagnose", place / "voyage.tlog", "-v", place / "boat.toml", "--out", out]
    one_line(run(*words, "--save", out), 2, "is named twice")


def test_without_a_memory_nothing_is_replaced(
    run: Run, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place / "state").touch()  # no folder: nothing can be remembered
    monkeypatch.setenv("XDG_STATE_HOME", str(place / "state"))
    words = ["init", place / "voyage.tlog", "--out", place / "new.toml"]
    assert run(*words).status == 0
    one_line(run(*words), 2, "is there already")
