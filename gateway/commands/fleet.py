"""Commands for many recordings of many boats."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from gateway.commands import (
    Anyway,
    AsJson,
    EffectFiles,
    Force,
    effects_from,
    print_progress,
    print_result,
)
from gateway.errors import BadInput, ShadowError
from gateway.files import check_place, guarded_outputs, named_as

EXTRA = ("distributed", "pyarrow")  # what the extra `fleet` of the package installs


def require_extra() -> None:
    """BadInput where the packages that a fleet needs are missing."""
    missing = [name for name in EXTRA if find_spec(name) is None]
    if missing:
        raise BadInput(
            f"{', '.join(missing)}: not installed: pip install 'shadow-gateway[fleet]' "
            "(in a checkout: .venv/bin/pip install -c constraints.txt -e '.[fleet]')"
        )


Folder = Annotated[Path, typer.Option("--out", help="Folder of the table, and of what is known.")]


def fleet(
    recordings: Annotated[
        list[str],
        typer.Argument(
            metavar="FOLDER|GLOB", help="Recordings: folders, globs, files, or URLs (s3://…)."
        ),
    ],
    vessels: Annotated[
        Path | None,
        typer.Option("--vessels", help="Which boat sailed which recording (fleet.toml)."),
    ] = None,
    vessel: Annotated[
        Path | None, typer.Option("--vessel", "-v", help="All are of this one boat (TOML).")
    ] = None,
    out: Folder = Path("shadow-out/fleet"),
    steps: Annotated[
        str, typer.Option(help="Of compare, identify and diagnose, separated by commas.")
    ] = "compare,identify",
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="Fit this too, as shadow identify. Without --free and --fix: every thruster's "
            "thrust ahead, and the inertia is held."
        ),
    ] = None,
    fix: Annotated[list[str] | None, typer.Option(help="Leave this as it is.")] = None,
    prior: Annotated[
        list[str] | None, typer.Option(help="NAME=SHARE: known beforehand to within that share.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine. Default: one a core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT", help="An existing Dask scheduler, instead of this machine."
        ),
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Run again what failed before.")] = False,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="FILE.html",
            help="One HTML file with table, map of the voyages and courses of the numbers.",
        ),
    ] = None,
    effects: EffectFiles = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """Many recordings of many boats: compare, identify, diagnose on all cores; one table.

    The table is that of the recordings named. What came of others before is kept beside it, and is
    there again, without work, when they are named again.
    """
    require_extra()
    from gateway.fleet import fleet_of_one, read_fleet
    from gateway.fleet.analysis import AnalysisSettings
    from gateway.fleet.report import write_fleet_report
    from gateway.fleet.run import run_fleet
    from gateway.fleet.table import FILES
    from gateway.fleet.wear import wear_of
    from gateway.terminal.fleet import fleet_as_dict, fleet_progress, show_fleet
    from gateway.vessel_file import load_vessel

    if (vessels is None) == (vessel is None):
        raise BadInput("give --vessels fleet.toml (many boats), or --vessel boat.toml (one)")
    own = effects_from(effects)
    logs = [Path(one) for one in recordings if Path(one).is_file()]
    inputs = [vessels, vessel, *logs, *(effects or ())]
    written = [*(out / name for name in FILES), named_as(report, ".html")]
    with guarded_outputs("fleet", inputs, written, force), fleet_progress() as progress:
        boats = read_fleet(vessels) if vessels else fleet_of_one(vessel or "", own)
        for boat in boats:
            load_vessel(boat.vessel_file, own)  # mistakes in it, before the work
        settings = AnalysisSettings(
            tuple(dict.fromkeys(s.strip() for s in steps.split(","))), tuple(free or ()),
            tuple(fix or ()), tuple(prior or ()),
            tuple(str(file.resolve()) for file in effects or ()), anyway,
        )  # fmt: skip
        result = run_fleet(
            recordings, boats, out, settings, scheduler=scheduler, workers=workers, retry=retry,
            progress=progress, interrupted=_interrupted,
        )  # fmt: skip
    found = wear_of(out)
    if report is not None:
        write_fleet_report(out, report)
    print_result(
        json, lambda: fleet_as_dict(result) | {"changes": [one.text for one in found.changes]},
        lambda: show_fleet(result, found),
    )  # fmt: skip
    if result.nothing_done:
        raise ShadowError(f"every recording failed ({len(result.rows)}): the table says why")


def _interrupted(done: int, total: int) -> None:
    """What an interrupt leaves."""
    print_progress(
        f"interrupted: {done} of {total} recordings are in the table; the same command goes on"
    )


def wear(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="What shadow fleet --out wrote.")
    ] = Path("shadow-out/fleet"),
    boat: Annotated[
        list[str] | None, typer.Option(help="This boat alone; as often as needed.")
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for pictures (PNG) of the courses.")
    ] = None,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """What has worn or changed on which boat of a fleet, since when, and by how much."""
    require_extra()
    from gateway.figures.matplotlib_draw import save_figures
    from gateway.files import picture_name
    from gateway.fleet.wear import wear_of
    from gateway.terminal.fleet import show_wear

    if pictures is not None:
        check_place(pictures)
    found = wear_of(folder, boat or ())
    if pictures is not None:
        figures = {one.figure.title: one.figure for one in found.numbers}
        drawn = [pictures / picture_name(title) for title in figures]
        with guarded_outputs("wear", [], drawn, force):
            save_figures(figures, pictures)
    print_result(json, found.to_dict, lambda: show_wear(found))
