"""Commands on recordings: what is in them, a vessel file from one, their replay and repair.

Commands that show results together: report, studio, demo; and the configuration.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gateway.commands import (
    Adapt,
    Anyway,
    AsJson,
    Config,
    EffectFiles,
    Force,
    LogFile,
    LogFiles,
    Mapping,
    Plant,
    Publish,
    Record,
    Reference,
    System,
    Topics,
    VesselFile,
    ZenohName,
    effects_from,
    one_of,
    print_progress,
    print_result,
    settings_from,
    vessel_from,
)
from gateway.commands.completion import formats_begun
from gateway.errors import BadInput, numerical_errors, printable
from gateway.files import check_place, guarded_outputs, named_as, vessel_path

Length = Annotated[float | None, typer.Option(help="Length [m].")]
Beam = Annotated[float | None, typer.Option(help="Beam [m].")]
Mass = Annotated[float | None, typer.Option(help="Mass [kg].")]
Thrust = Annotated[float | None, typer.Option(help="Full thrust of one motor [N].")]
TopSpeed = Annotated[float | None, typer.Option(help="Top speed [m/s].")]


def info(
    log: LogFile,
    events: Annotated[
        bool, typer.Option("--events", help="Also what happened: arming, modes, texts, events.")
    ] = False,
    system: System = None,
    mapping: Mapping = None,
    json: AsJson = False,
) -> None:
    """What is in a recording: vehicles, messages, rates, gaps, sources, what it is good for."""
    from gateway.ingest.log_events import as_dicts, log_events
    from gateway.ingest.open import open_log
    from gateway.ingest.survey import survey
    from gateway.offline.trials import why_unusable
    from gateway.terminal import status_line
    from gateway.terminal.next_step import after_info, holds_vessel, main_boat
    from gateway.terminal.recordings import show_events, show_next, show_survey

    opened = open_log(log, mapping)
    found = survey(opened, system)
    told = {one.boat: log_events(opened, one.boat) for one in found.boats} if events else {}

    def show() -> None:
        show_survey(found)
        for boat, happened in told.items():
            show_events(str(boat), happened)
        if found.boats:
            with status_line("what can be done with it"):
                unusable = why_unusable(opened, main_boat(found).boat.system)
            show_next(after_info(found, unusable, mapping, system, holds_vessel(opened)))

    def as_json() -> dict[str, object]:
        by_boat = {str(boat): as_dicts(happened) for boat, happened in told.items()}
        return found.to_dict() | ({"events": by_boat} if events else {})

    print_result(json, as_json, show)


def init(
    log: LogFile,
    out: Annotated[Path, typer.Option("--out", help="The vessel file to write.")],
    name: Annotated[str | None, typer.Option(help="Name of the boat.")] = None,
    length: Length = None,
    beam: Beam = None,
    mass: Mass = None,
    thrust: Thrust = None,
    top_speed: TopSpeed = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """A first vessel file from the log's own parameters (SERVOn_FUNCTION, MIN, TRIM, MAX)."""
    from gateway.ingest.open import open_log
    from gateway.offline.trials import why_unusable
    from gateway.offline.vessel import init_vessel, initial_notices, initial_vessel_dict
    from gateway.terminal.next_step import after_init, log_words
    from gateway.terminal.recordings import show_initial_vessel

    given = _size(length, beam, mass, thrust, top_speed)
    with guarded_outputs("init", [log, mapping], [named_as(out, ".toml")], force):
        opened = open_log(log, mapping)
        made = init_vessel(opened, out, name, given, system, anyway)
    notices = initial_notices(opened, system)

    def show() -> None:
        words = log_words(log, system, anyway, mapping)
        unusable = why_unusable(opened, system)
        show_initial_vessel(made, out, after_init(out, words, unusable), notices)

    print_result(json, lambda: initial_vessel_dict(made, out, notices), show)


def replay(
    logs: LogFiles,
    vessel: VesselFile,
    plant: Plant = None,
    reference: Reference = None,
    adapt: Adapt = None,
    speed: Annotated[str, typer.Option(help="1: as recorded; max: as fast as it goes.")] = "max",
    out: Annotated[Path, typer.Option(help="Folder for the recording.")] = Path("shadow-out"),
    record: Record = True,
    topics: Topics = None,
    publish: Publish = None,
    name: ZenohName = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    config: Config = None,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """Run recordings through the shadow: estimate, follow, record to MCAP, publish on zenoh."""
    from gateway.config import recorded_settings
    from gateway.offline import replay as work
    from gateway.plants import load_plant
    from gateway.terminal import progress_bar
    from gateway.terminal.recordings import show_replay

    recorded = recorded_settings(logs[0]) if config is None and logs[0].is_file() else None
    settings = settings_from(config, reference, publish, recorded, adapt, topics)
    if speed not in ("1", "max"):
        raise BadInput(f"--speed {speed}: expected 1 or max")
    options = work.ReplayOptions(
        out=out if record else None, realtime=speed == "1", system=system, name=name,
        mapping=mapping, anyway=anyway, settings=settings,
    )  # fmt: skip
    by_log = work.options_by_log(logs, options)
    inputs = (*logs, vessel_path(vessel), mapping, config, *(effects or ()))
    with guarded_outputs("replay", inputs, map(work.recording_file, logs, by_log), force):
        boat, played_by = vessel_from(vessel, effects), load_plant(plant, effects_from(effects))
        done = []
        for log, chosen in zip(logs, by_log, strict=True):
            with numerical_errors(log, vessel), progress_bar(f"replaying {log.name}") as share_done:
                done.append(work.replay(log, boat, played_by, chosen, share_done))
            if not json:
                show_replay(done[-1])
    print_result(json, lambda: {"replays": [one.to_dict() for one in done]}, lambda: None)


def export(
    log: LogFile,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="csv|parquet|tlog|mcap",
            help="What LOG becomes.",
            autocompletion=formats_begun,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="The file to write. Default: shadow-out/LOG-export.csv, …"),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="NAME",
            help="Only this message (ATTITUDE) or topic of a recording (shadow); may be repeated. "
            "Without it a table is the aligned trial, anything else is whole.",
        ),
    ] = None,
    channel: Annotated[
        list[int] | None,
        typer.Option(
            "--channel",
            metavar="N",
            help="Only this servo output; may be repeated.",
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            help="Rows a second of a table (default 10); of frames and topics, at most so many of "
            "each kind a second."
        ),
    ] = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """A log as a table (csv, parquet), as its own MAVLink frames (tlog), or for players (mcap).

    A table is the aligned trial: smoothed motion, its errors, pulses, voltage and wind on one time
    grid. What is exported opens in info, compare, identify and diagnose; a .csv brings the mapping
    file that this takes.
    """
    from gateway.offline import export as work
    from gateway.terminal.recordings import show_export

    one_of("--to", to, tuple(work.ExportFormat))
    options = work.ExportOptions(
        work.ExportFormat(to), tuple(topic or ()), tuple(channel or ()), rate, system, mapping,
        anyway,
    )  # fmt: skip
    files = work.export_files(log, named_as(out, f".{to}"), options)
    stale, inputs = work.stale_mapping(files, options), [log, mapping]
    with guarded_outputs("export", inputs, [*files, *stale], force), numerical_errors(log):
        done = work.without(stale, work.export(log, files, options))
    print_result(json, done.to_dict, lambda: show_export(done))


def repair(file: Annotated[Path, typer.Argument(help="An MCAP recording.")]) -> None:
    """Make a recording whole that was cut off (power, kill) or is damaged.

    It is written anew from all that can be read. Where anything of the old file is not in the new
    one, the old one is kept as FILE.damaged.
    """
    from gateway.recording.repair import repair as work

    print(printable(work(file).text()))


def report(
    logs: LogFiles,
    vessel: Annotated[
        list[Path] | None,
        typer.Option(
            "--vessel",
            "-v",
            help="Model of the boat; several are held side by side. Default: one is learnt from "
            "the first part of the first LOG, and judged on the rest.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The HTML file to write.")] = Path(
        "shadow-out/report.html"
    ),
    pdf: Annotated[
        Path | None,
        typer.Option(help="Also print it into this file; takes Chromium, Chrome, Edge or Brave."),
    ] = None,
    diagnose: Annotated[
        bool,
        typer.Option(help="Also look for what the first vessel lacks; always without --vessel."),
    ] = False,
    length: Length = None,
    beam: Beam = None,
    mass: Mass = None,
    thrust: Thrust = None,
    top_speed: TopSpeed = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """One self-contained HTML file to mail, from a log alone: verdict, pictures, vessel file."""
    from gateway.offline.report import find_browser, make_report, print_pdf, report_from_log
    from gateway.offline.trials import TrialOptions
    from gateway.terminal import status_line
    from gateway.terminal.recordings import show_report

    given = _size(length, beam, mass, thrust, top_speed)
    if vessel and given:
        raise BadInput(f"--{next(iter(given)).replace('_', '-')}: the vessel file says it already")
    options = TrialOptions(system=system, mapping=mapping, anyway=anyway)
    inputs = (*logs, *map(vessel_path, vessel or ()), mapping, *(effects or ()))
    own = effects_from(effects)
    outputs = [named_as(out, ".html"), named_as(pdf, ".pdf")]
    with guarded_outputs("report", inputs, outputs, force), status_line("report") as progress:
        if pdf is not None:
            find_browser()  # before the work, not after it
        if vessel:
            done = make_report(logs, vessel, out, diagnose=diagnose, options=options, effects=own,
                               progress=progress)  # fmt: skip
        else:
            done = report_from_log(logs, out, given, options=options, effects=own,
                                   progress=progress)  # fmt: skip
        if pdf is not None:
            progress("printing")
            print_pdf(out, pdf)
            done = replace(done, pdf=pdf)
    print_result(json, done.to_dict, lambda: show_report(done))


def _size(
    length: float | None, beam: float | None, mass: float | None, thrust: float | None,
    top_speed: float | None,
) -> dict[str, float]:  # fmt: skip
    """What was given of a boat's size."""
    size = {"length": length, "beam": beam, "mass": mass, "thrust": thrust, "top_speed": top_speed}
    return {key: value for key, value in size.items() if value is not None}


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
    fleet: Annotated[
        Path | None,
        typer.Option(help="Folder of a table of shadow fleet. Default: the one in --out."),
    ] = None,
    config: Config = None,
    effects: EffectFiles = None,
    mapping: Mapping = None,
) -> None:
    """The five steps in a browser: live, compare, diagnose, vessel, recordings; a fleet."""
    from gateway.studio.serve import StudioOptions, run_studio

    check_place(out)
    run_studio(
        StudioOptions(
            tuple(logs or ()), vessel and vessel_path(vessel), tuple(folder or ()), out,
            tuple(effects or ()), port, browser, expose, tuple(origin or ()), connect,
            settings_from(config, None, None).studio, fleet, mapping,
        ),
        print_progress,
    )  # fmt: skip


def demo(
    out: Annotated[Path, typer.Option(help="Folder for what it writes.")] = Path("shadow-out/demo"),
    force: Force = False,
) -> None:
    """The whole story on recordings that ship: replay, compare, diagnose, add, compare. Offline."""
    from gateway.demo import demo_files, run_demo

    with guarded_outputs("demo", [], demo_files(out), force):
        run_demo(out)


def show_config(config: Config = None, json: AsJson = False) -> None:
    """The resolved configuration: gateway.toml over the defaults."""
    from gateway.config import as_tables, as_toml

    settings = settings_from(config, None, None)
    print_result(
        json, lambda: as_tables(settings), lambda: print(printable(as_toml(settings)), end="")
    )
