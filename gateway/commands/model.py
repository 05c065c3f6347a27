"""Commands for a vessel file: its numbers, how well they do, what it lacks, how to learn more."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gateway.commands import (
    Anyway,
    AsJson,
    BoatsOfOneType,
    ByRecording,
    EffectFiles,
    Force,
    LogFiles,
    Mapping,
    System,
    VesselFile,
    VesselFiles,
    effects_from,
    print_result,
    short_help,
    vessel_from,
)
from gateway.commands.completion import effects_begun, manoeuvres_begun, vessels_begun
from gateway.errors import BadInput
from gateway.files import guarded_outputs, named_as, pictures_there, recording_names, vessel_path


def identify(
    logs: LogFiles,
    vessel: VesselFile,
    out: Annotated[Path | None, typer.Option("--out", help="The vessel file to write.")] = None,
    start: Annotated[
        float | None, typer.Option("--from", help="Start [s after a recording's first sample].")
    ] = None,
    end: Annotated[float | None, typer.Option("--to", help="End [s].")] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option(help="FROM:TO [s] to leave out, or RECORDING:FROM:TO; as often as needed."),
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="Also fit this: m11 … N_ur, left.ahead, left.curve, EFFECT.NAME or EFFECT.*"
        ),
    ] = None,
    fix: Annotated[list[str] | None, typer.Option(help="Leave this as it is.")] = None,
    prior: Annotated[
        list[str] | None, typer.Option(help="NAME=SHARE: known beforehand to within that share.")
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="shooting; simulation: best where the model runs freely for long; instrumental "
            "(variables); regression: the paper's least squares."
        ),
    ] = "shooting",
    validate: Annotated[
        list[Path] | None, typer.Option(help="Recordings to judge by; default: blocks held out.")
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for pictures (PNG): before and after, intervals.")
    ] = None,
    by_recording: ByRecording = False,
    boat: BoatsOfOneType = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Annotated[
        bool,
        typer.Option(
            "--anyway",
            help="Fit though motors seem wired otherwise, or though it is no boat's log.",
        ),
    ] = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """The vessel's numbers from recordings, with 95 % intervals, and what they gain."""
    from gateway.offline.identify import identify_logs, identify_settings
    from gateway.offline.trials import TrialOptions
    from gateway.offline.usable_time import TimeSpan, parse_exclusions
    from gateway.terminal import status_line
    from gateway.terminal.identification import show_by_recording, show_identification

    settings = identify_settings(free or (), fix or (), prior or (), method)
    named_as(out, ".toml")
    if by_recording:
        from gateway.offline.identify import boats_of, files_of, identify_logs_by_recording

        if any(given is not None for given in (start, end, exclude, validate, pictures)):
            raise BadInput(
                "--by-recording takes no --from, --to, --exclude, --validate, --pictures"
            )
        boats = boats_of(boat or ())
        written = [] if out is None else list(files_of(out, boats).values())
        options = TrialOptions(system=system, mapping=mapping, anyway=anyway)
        read = (*logs, vessel_path(vessel), mapping, *(effects or ()))
        with (
            guarded_outputs("identify", read, written, force),
            status_line("identifying") as progress,
        ):
            pooled = identify_logs_by_recording(
                logs, vessel, out, settings, boats=boats, options=options,
                effects=effects_from(effects), progress=progress,
            )  # fmt: skip
        print_result(json, pooled.to_dict, lambda: show_by_recording(pooled, written))
        return
    if boat:
        raise BadInput("--boat goes with --by-recording")
    read = (*logs, *(validate or ()))
    drawn = pictures_there(pictures, recording_names(read), end="-parameters.png")
    inputs = (*read, vessel_path(vessel), mapping, *(effects or ()))
    with (
        guarded_outputs("identify", inputs, [out, *drawn], force, pictures),
        status_line("identifying") as progress,
    ):
        found = identify_logs(
            logs, vessel, out, settings, span=TimeSpan(start, end), validate=validate or (),
            exclude=parse_exclusions(exclude or ()), pictures=pictures, progress=progress,
            options=TrialOptions(system=system, mapping=mapping, anyway=anyway),
            effects=effects_from(effects),
        )  # fmt: skip
    print_result(json, found.to_dict, lambda: show_identification(found, out, pictures))


def compare(
    logs: LogFiles,
    vessel: VesselFiles,
    horizon: Annotated[float, typer.Option(help="How long the model runs freely [s].")] = 10.0,
    refit: Annotated[
        str | None,
        typer.Option(
            metavar="voyage",
            help="voyage: estimate current, wind and what else is of one day anew, on blocks of "
            "time that it is not judged by.",
        ),
    ] = None,
    with_hil: Annotated[
        Path | None,
        typer.Option(
            "--with-hil",
            metavar="RECORDING",
            help="The same mission in the loop (what shadow hil recorded, or the autopilot's log "
            "of it): where do the two part?",
        ),
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for pictures (PNG) of errors and tracks.")
    ] = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """How far is the model from the measurement, beside the noise floor, and where is it worst."""
    from gateway.offline.beside_loop import beside_loop, draw_missions
    from gateway.offline.compare import as_json, compare_logs
    from gateway.offline.trials import TrialOptions
    from gateway.terminal import status_line
    from gateway.terminal.comparison import missions_as_dict, show_comparisons, show_missions
    from sim.prediction.segments import CompareSettings

    if refit not in (None, "voyage"):
        raise BadInput(f"--refit {refit}: expected voyage")
    try:
        settings = CompareSettings(horizon=horizon)
    except ValueError as error:
        raise BadInput(f"--horizon: {error}") from None
    if with_hil is not None and len(logs) > 1:
        raise BadInput("--with-hil: one LOG is held beside one RECORDING")
    inputs = (*logs, *map(vessel_path, vessel), mapping, with_hil, *(effects or ()))
    drawn = pictures_there(pictures, recording_names(logs))
    options = TrialOptions(system=system, mapping=mapping, anyway=anyway)
    beside = None
    with (
        guarded_outputs("compare", inputs, drawn, force, pictures),
        status_line("comparing") as progress,
    ):
        if with_hil is not None:
            progress(f"reading {with_hil.name}")
            beside = beside_loop(logs[0], with_hil, vessel_from(vessel[0], effects), options)
            draw_missions(beside, pictures)
        found = compare_logs(
            logs, vessel, settings, options=options, effects=effects_from(effects),
            pictures=pictures, progress=progress, refit=refit is not None,
        )  # fmt: skip

    def show() -> None:
        show_comparisons(found, pictures)
        if beside is not None:
            show_missions(beside)

    more = {} if beside is None else {"with_hil": missions_as_dict(beside)}
    print_result(json, lambda: as_json(found) | more, show)


def diagnose(
    logs: LogFiles,
    vessel: VesselFile,
    improve: Annotated[
        bool, typer.Option(help="Look on beside what was found, until nothing more is justified.")
    ] = True,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for pictures (PNG): ladder, ranking, evidence.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option("--save", help="The answer as JSON, for shadow add --from.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="The better vessel file to write.")
    ] = None,
    prior: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="How far off the base numbers may be; left out: 0.15 (15 %), and 1 where the file "
            "says that they were guessed or does better so.",
        ),
    ] = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """Which physical effect is missing from the model, how sure that is, and what to do next."""
    from gateway.offline.diagnose import (
        DIAGNOSIS_TRIALS,
        diagnose_logs,
        save_diagnosis,
    )
    from gateway.terminal import status_line
    from gateway.terminal.diagnosis import show_diagnosis
    from sim.diagnosis.screening import FIRST_IMPRESSION

    if prior is not None and not 0.0 < prior <= 10.0:
        raise BadInput(f"--prior {prior:g}: expected a share of the numbers, as 0.15")
    own, options = (
        effects_from(effects),
        replace(DIAGNOSIS_TRIALS, system=system, mapping=mapping, anyway=anyway),
    )
    inputs = (*logs, vessel_path(vessel), mapping, *(effects or ()))
    outputs = [named_as(save, ".json"), named_as(out, ".toml")]
    drawn = pictures_there(pictures, ("ladder", "ranking", "timeline", "evidence"))
    with (
        guarded_outputs("diagnose", inputs, [*outputs, *drawn], force, pictures),
        status_line("diagnosing", keep=FIRST_IMPRESSION) as progress,
    ):
        found = diagnose_logs(
            logs, vessel, improve=improve, prior=prior, options=options, effects=own,
            progress=progress,
        )  # fmt: skip
        found = replace(found, effect_files=tuple(map(str, effects or ())))
        save_diagnosis(found, save=save, out=out, pictures=pictures, effects=own, progress=progress)
    print_result(json, found.to_dict, lambda: show_diagnosis(found, save, out, pictures))


def add(
    names: Annotated[
        list[str],
        typer.Argument(metavar="EFFECT", help="Effects, by name.", autocompletion=effects_begun),
    ],
    vessel: VesselFile,
    source: Annotated[
        Path, typer.Option("--from", help="What shadow diagnose --save wrote.", metavar="JSON")
    ],
    out: Annotated[Path, typer.Option("--out", help="The vessel file to write.")],
    effects: EffectFiles = None,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """The better model: effects and re-fitted base from a diagnosis, into a new vessel file."""
    from gateway.offline.add import add_effects
    from gateway.terminal.diagnosis import show_addition

    inputs = (vessel_path(vessel), source, *(effects or ()))
    with guarded_outputs("add", inputs, [named_as(out, ".toml")], force):
        done = add_effects(names, vessel, source, out, effects_from(effects))
    print_result(
        json,
        lambda: {"written": str(out)} | done.to_dict(),
        lambda: show_addition(done, names, vessel, out, effects or ()),
    )


def plan(
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="Choose by what this leaves open.")
    ] = None,
    vessel: Annotated[
        Path | None,
        typer.Option(
            "--vessel", "-v", help="Model of the boat (TOML).", autocompletion=vessels_begun
        ),
    ] = None,
    excitation: Annotated[
        str | None,
        typer.Option(
            help="Which manoeuvre, see --list. Default: the LOG's choice, or mixed.",
            autocompletion=manoeuvres_begun,
        ),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Cut it short or begin it again [s].")
    ] = None,
    throttle_limit: Annotated[float, typer.Option(help="Largest throttle, 0 to 1.")] = 0.7,
    radius: Annotated[float, typer.Option(help="How far from its start it may go [m].")] = 100.0,
    speed_limit: Annotated[
        float | None, typer.Option(help="Stop above this [m/s]. Default: 1.3 × the predicted.")
    ] = None,
    lowest_voltage: Annotated[
        float | None, typer.Option(help="Stop below this [V]. Default: the boat's BATT_LOW_VOLT.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of random and joystick.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for what it writes.")] = Path("shadow-out/plan"),
    list_: Annotated[bool, typer.Option("--list", help="All manoeuvres, and end.")] = False,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    anyway: Anyway = False,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """A manoeuvre to learn a boat by: predicted, then written as CSV and ArduPilot Lua."""
    from gateway.offline.diagnose import DIAGNOSIS_TRIALS
    from gateway.offline.plan import PlanOptions, make_plan, plan_files
    from gateway.terminal.identification import show_manoeuvres, show_plan
    from sim.excitation.catalogue import MANOEUVRES

    if list_:
        told = [{"name": m.name, "seconds": m.seconds, "reveals": m.reveals} for m in MANOEUVRES]
        print_result(json, lambda: {"manoeuvres": told}, lambda: show_manoeuvres(MANOEUVRES))
        return
    if vessel is None:
        raise BadInput("no vessel: give --vessel FILE (TOML), or --list for all manoeuvres")
    options = PlanOptions(
        excitation, seconds, throttle_limit, radius, speed_limit, lowest_voltage, seed
    )
    if log is not None and not log.is_file():
        raise BadInput(f"{log}: no such file")
    trials = replace(DIAGNOSIS_TRIALS, system=system, mapping=mapping, anyway=anyway)
    inputs = (log, vessel_path(vessel), mapping, *(effects or ()))
    with guarded_outputs("plan", inputs, plan_files(excitation, log, out), force):
        done = make_plan(vessel_from(vessel, effects), options, out, log, trials)
    print_result(json, done.to_dict, lambda: show_plan(done))


app = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Where the numbers of a vessel file come from, how two files differ, what changed when.",
)
File = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="A vessel file, one that ships, or a recording.",
        autocompletion=vessels_begun,
    ),
]


def show(file: File, effects: EffectFiles = None, json: AsJson = False) -> None:
    """Every number with its interval and its origin: recording, fit, date."""
    from gateway.offline.vessel import passport
    from gateway.terminal.identification import show_passport

    read = passport(file, effects_from(effects))
    print_result(json, read.to_dict, lambda: show_passport(read))


def diff(
    first: File,
    second: Annotated[Path, typer.Argument(metavar="FILE2", help="The other one.")],
    effects: EffectFiles = None,
    json: AsJson = False,
) -> None:
    """What differs between two vessel files, and whether it is beyond their intervals."""
    from gateway.offline.vessel import diff_as_dict, passport
    from gateway.terminal.identification import show_difference

    own = effects_from(effects)
    a, b = passport(first, own), passport(second, own)
    print_result(json, lambda: diff_as_dict(a, b), lambda: show_difference(a, b))


def history(file: File, effects: EffectFiles = None, json: AsJson = False) -> None:
    """Which commands changed which numbers, when, on which recordings."""
    from gateway.offline.vessel import passport
    from gateway.terminal.identification import show_history

    read = passport(file, effects_from(effects))
    print_result(json, read.history_as_dict, lambda: show_history(read))


for command in (show, diff, history):
    app.command(short_help=short_help(command))(command)
