"""Help of the program and of every command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from gateway import cli
from gateway.commands import tell_unused_mapping
from tests.conftest import ROOT
from tests.gateway.command_line import Run

COMMANDS = [
    c.name or (c.callback.__name__ if c.callback else "") for c in cli.app.registered_commands
]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_what_it_does_and_every_option_what_it_is_for(
    run: Run, name: str
) -> None:
    done = run(name, "--help")
    assert (done.status, done.err) == (0, "")
    group = typer.main.get_group(cli.app)
    found = group.commands[name]
    assert found.help
    assert " ".join(found.help.split())[:30] in " ".join(done.out.split())
    assert all(getattr(parameter, "help", None) for parameter in found.params), [
        p.name for p in found.params if not getattr(p, "help", None)
    ]


def test_without_any_word_the_help_is_shown(run: Run) -> None:
    done = run()
    assert (done.status, done.err) == (0, "")
    assert all(name in done.out for name in COMMANDS)


def test_the_version_is_told(run: Run) -> None:
    assert run("--version").out.startswith("shadow-gateway ")


@pytest.mark.parametrize("words", [[], ["vessel"], *([name] for name in COMMANDS)])
def test_no_line_of_help_is_cut_off_at_80_columns(
    run: Run, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = run(*words, "--help").out.splitlines()[1:]  # the first is the usage: [ARGS]...
    assert len(lines) > 3
    assert [line for line in lines if line.endswith("...")] == []


def test_descriptions_are_listed_whole(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    listed = " ".join(run("--help").out.partition("Commands:")[2].split())
    assert "..." not in listed
    assert "recordings, with 95 % intervals, and what they gain." in listed


def test_a_script_for_the_shell_completes_commands(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Named, for the shell that runs the tests may be one without completion (that of make)."""
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    monkeypatch.setattr(sys.modules["__main__"], "__package__", None)  # `python -m pytest` has one
    assert "_SHADOW_COMPLETE=complete_bash" in run("--show-completion", "bash").out


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("export a.tlog --to p", ["parquet"]),
        ("plan --excitation zig", ["zigzag"]),
        ("effects steady_w", ["steady_wind"]),
        ("add steady_c", ["steady_current"]),
        ("compare a.tlog --vessel o", ["otter", "own.toml"]),
        ("plan -v ott", ["otter"]),
        ("vessel show ow", ["own.toml"]),
    ],
)
def test_a_shell_completes_values(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: str, offered: list[str]
) -> None:
    (tmp_path / "own.toml").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys.modules["__main__"], "__package__", None)
    monkeypatch.setenv("_SHADOW_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", f"shadow {words}")
    monkeypatch.setenv("COMP_CWORD", str(len(words.split())))
    assert run().out.split() == offered


def test_a_mapping_beside_logs_that_are_no_tables_is_said_to_be_of_no_use(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    log, mapping = ROOT / "recordings" / "otter_piece.tlog", tmp_path / "map.toml"
    says = f"--mapping is of no use for {log}: only tables take one\n"
    done = run("info", log, "--mapping", mapping)
    assert (done.status, done.err) == (0, says)
    assert run("info", log).err == ""
    table, recording, gone = (tmp_path / name for name in ("a.csv", "b.mcap", "c.tlog"))
    table.write_text("t,yaw\n0,0\n")
    recording.write_bytes(b"\x89MCAP0\r\n")  # may enclose a table
    for other in (table, recording, gone):
        tell_unused_mapping({"log": str(other), "mapping": str(mapping)})
        tell_unused_mapping({"logs": [str(log), str(other)], "mapping": str(mapping)})
    tell_unused_mapping({"logs": None, "mapping": str(mapping)})  # the studio, of folders
    assert capfd.readouterr().err == ""


def test_every_command_with_a_mapping_tells_where_it_is_of_no_use() -> None:
    found = typer.main.get_group(cli.app).commands.values()
    told = [{p.name for p in one.params} for one in found if isinstance(one, cli.Command)]
    assert len(told) == len(cli.COMMANDS)
    takers = [names for names in told if "mapping" in names]
    assert len(takers) >= 7
    assert all(names & {"log", "logs"} for names in takers)


def test_a_mistyped_word_is_answered_with_the_right_one(run: Run) -> None:
    assert "Did you mean 'compare'?" in run("comapre").err
    assert "--vessel" in run("compare", "x.tlog", "--vesel", "y").err


def test_the_studio_takes_a_vessel_that_ships_by_its_name(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr("gateway.studio.serve.run_studio", lambda options, _: asked.append(options))
    for words in ((), ("--vessel", "otter"), ("--vessel", "own.toml")):
        assert run("studio", *words).status == 0
    found = [options.vessel and options.vessel.name for options in asked]
    assert found == [None, "otter.toml", "own.toml"]
    assert asked[1].vessel.is_file()


START = """
import sys
from gateway import cli
from gateway.commands import tell_unused_mapping
sys.argv, sys.stdout = ["shadow", "info", sys.argv[1]], sys.stderr
heavy = {"matplotlib", "scipy.stats", "scipy.optimize", "bokeh", "zenoh"}
print(*sorted({"numba", *heavy} & set(sys.modules)), "|", file=sys.__stdout__)
try:
    cli.main()
finally:
    print(*sorted(heavy & set(sys.modules)), file=sys.__stdout__)
"""


def test_help_and_info_start_without_what_compiles_draws_and_fits() -> None:
    """Each takes as long to be imported as all the rest of them."""
    log = ROOT / "recordings" / "voyage_1.tlog"
    done = subprocess.run(
        [sys.executable, "-c", START, log], capture_output=True, text=True, check=True
    )
    assert "voyage_1.tlog" in done.stderr
    assert done.stdout.split() == ["|"]


WATCH = """
import os, sys
class Watch:
    def find_spec(self, name, path, target=None):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"))
sys.meta_path.insert(0, Watch())
import gateway.cli
"""


@pytest.mark.parametrize(("given", "expected"), [(None, "1"), ("2", "2")])
def test_blas_has_one_thread_unless_the_user_says_otherwise(
    given: str | None, expected: str
) -> None:
    """It reads its number of threads when numpy is imported."""
    env = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    env |= {} if given is None else {"OPENBLAS_NUM_THREADS": given}
    done = subprocess.run(
        [sys.executable, "-c", WATCH], env=env, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [expected]
