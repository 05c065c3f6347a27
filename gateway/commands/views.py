"""Commands that show results together: report, studio, demo; and the configuration."""

from pathlib import Path
from typing import Annotated

import typer

from gateway.commands.options import (
    AsJson,
    Config,
    EffectFiles,
    LogFiles,
    Mapping,
    System,
    VesselFiles,
    effects_from,
    print_progress,
    print_result,
    settings_from,
)


def report(
    logs: LogFiles,
    vessel: VesselFiles,
    out: Annotated[Path, typer.Option("--out", help="The HTML file to write.")] = Path(
        "shadow-out/report.html"
    ),
    diagnose: Annotated[
        bool, typer.Option(help="Also look for what the first vessel lacks (a minute or so).")
    ] = False,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    json: AsJson = False,
) -> None:
    """One self-contained HTML file to mail: pictures, numbers, the vessel file, what is missing."""
    from gateway.offline.report import make_report
    from gateway.offline.trials import TrialOptions
    from gateway.terminal.console import status_line
    from gateway.terminal.runs import show_report

    with status_line("report") as progress:
        done = make_report(
            logs, vessel, out, diagnose=diagnose, effects=effects_from(effects), progress=progress,
            options=TrialOptions(system=system, mapping=mapping),
        )  # fmt: skip
    print_result(json, done.to_dict, lambda: show_report(done))


def studio(
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="[LOG]", help="Recordings. Default: the demo's.")
    ] = None,
    vessel: Annotated[
        Path | None, typer.Option("--vessel", "-v", help="Model of the boat (TOML).")
    ] = None,
    folder: Annotated[
        list[Path] | None, typer.Option("--folder", help="A folder to offer the files of.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for what is saved.")] = Path("shadow-out"),
    port: Annotated[int, typer.Option(help="Port of the page.")] = 5006,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
    connect: Annotated[
        str, typer.Option(help="Where a gateway or zenoh router listens, for the live page.")
    ] = "tcp/127.0.0.1:7447",
    expose: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Also from other machines, at this address; with a token."
        ),
    ] = None,
    origin: Annotated[
        list[str] | None, typer.Option(help="HOST:PORT under which others reach an exposed page.")
    ] = None,
    config: Config = None,
    effects: EffectFiles = None,
) -> None:
    """The five steps in a browser: live, compare, diagnose, vessel, recordings. Ctrl-C ends."""
    from gateway.studio.serve import StudioOptions, run_studio

    run_studio(
        StudioOptions(
            tuple(logs or ()), vessel, tuple(folder or ()), out, tuple(effects or ()), port,
            browser, expose, tuple(origin or ()), connect, settings_from(config, None, None).studio,
        ),
        print_progress,
    )  # fmt: skip


def demo(
    out: Annotated[Path, typer.Option(help="Folder for what it writes.")] = Path("shadow-out/demo"),
) -> None:
    """The whole story on recordings that ship: replay, compare, diagnose, add, compare. Offline."""
    from gateway.demo import run_demo

    run_demo(out)


def show_config(config: Config = None, json: AsJson = False) -> None:
    """The resolved configuration: gateway.toml over the defaults."""
    from gateway.config import as_tables, as_toml

    settings = settings_from(config, None, None)
    print_result(json, lambda: as_tables(settings), lambda: print(as_toml(settings), end=""))
