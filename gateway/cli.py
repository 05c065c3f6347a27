"""The command line: parse, call, print. The work is done in `gateway.pipelines`.

Human output by default; `--json` prints JSON alone on standard output, progress goes to standard
error. Exit status 0 done, 1 the work failed, 2 bad input, which gets one line.
"""

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version as installed
from pathlib import Path
from typing import Annotated, Any, NoReturn

import orjson
import typer

from gateway.errors import BadInput, ShadowError
from sim.effects.effect import LawError

app = typer.Typer(
    name="shadow",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it would take [m] for markup
    help="The digital shadow of an unmanned boat: is the model of your boat right, and what is "
    "missing from it when it is not?\n\n"
    "Start with shadow demo. With a log of your own: shadow info LOG, "
    "shadow init LOG --out boat.toml, shadow replay LOG --vessel boat.toml, "
    "shadow compare LOG --vessel boat.toml.",
)

# The commands' modules are imported when they run: `shadow --help` answers at once.
LogFile = Annotated[
    Path,
    typer.Argument(
        metavar="LOG", help="A .tlog, DataFlash .BIN, MCAP recording of ours, or mapped .csv."
    ),
]
LogFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG", help="Recordings: .tlog, DataFlash .BIN, MCAP of ours, or mapped .csv."
    ),
]
VesselFile = Annotated[
    Path, typer.Option("--vessel", "-v", help="Model of the boat (TOML, see configs/vessels).")
]
EffectFiles = Annotated[
    list[Path] | None, typer.Option("--effects", help="Python files with effects of your own.")
]
System = Annotated[
    int | None, typer.Option("--system", help="MAVLink system id, where a log holds several boats.")
]
Mapping = Annotated[
    Path | None, typer.Option("--mapping", help="What the columns of a .csv mean (TOML).")
]
Config = Annotated[Path | None, typer.Option("--config", help="gateway.toml.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON alone on standard output.")]


@app.command()
def info(
    log: LogFile, system: System = None, mapping: Mapping = None, json: AsJson = False
) -> None:
    """What is in a recording: vehicles, messages, rates, gaps, sources, what it is good for."""
    from gateway.ingest.open import open_log
    from gateway.ingest.survey import survey
    from gateway.show.survey import show_survey

    found = survey(open_log(log, mapping), system)
    _print(json, found.as_dict, lambda: show_survey(found))


@app.command()
def init(
    log: LogFile,
    out: Annotated[Path, typer.Option("--out", help="The vessel file to write.")],
    name: Annotated[str | None, typer.Option(help="Name of the boat.")] = None,
    length: Annotated[float | None, typer.Option(help="Length [m].")] = None,
    beam: Annotated[float | None, typer.Option(help="Beam [m].")] = None,
    mass: Annotated[float | None, typer.Option(help="Mass [kg].")] = None,
    thrust: Annotated[float | None, typer.Option(help="Full thrust of one motor [N].")] = None,
    top_speed: Annotated[float | None, typer.Option(help="Top speed [m/s].")] = None,
    system: System = None,
    force: Annotated[bool, typer.Option(help="Replace the file if it is there.")] = False,
) -> None:
    """A first vessel file from the log's own parameters (SERVOn_FUNCTION, MIN, TRIM, MAX)."""
    from gateway.pipelines.first_vessel import init_vessel
    from gateway.show.vessel import show_first_vessel

    asked = {"length": length, "beam": beam, "mass": mass, "thrust": thrust, "top_speed": top_speed}
    given = {key: value for key, value in asked.items() if value is not None}
    show_first_vessel(init_vessel(log, out, name, given, system, force), out)


@app.command()
def replay(
    logs: LogFiles,
    vessel: VesselFile,
    plant: Annotated[
        Path | None, typer.Option(help="What the shadow is played by. Default: the vessel.")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(help="What the shadow follows: measured, model (prediction) or auto."),
    ] = None,
    speed: Annotated[str, typer.Option(help="1: as recorded; max: as fast as it goes.")] = "max",
    out: Annotated[Path, typer.Option(help="Folder for the recording.")] = Path("shadow-out"),
    record: Annotated[bool, typer.Option(help="Record to MCAP.")] = True,
    publish: Annotated[bool | None, typer.Option(help="Publish on zenoh.")] = None,
    name: Annotated[str | None, typer.Option(help="Name on zenoh: shadow/NAME/…")] = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    config: Config = None,
    json: AsJson = False,
) -> None:
    """Run recordings through the shadow: estimate, follow, record to MCAP, publish on zenoh."""
    from gateway.pipelines import replay as work
    from gateway.show.replay import replays_dict, show_replay

    recorded = work.recorded_settings(logs[0]) if config is None and logs[0].is_file() else None
    settings = _settings(config, reference, publish, recorded)
    if speed not in ("1", "max"):
        raise BadInput(f"--speed {speed}: expected 1 or max")
    boat, own = _vessel(vessel, effects), _vessel(plant, effects) if plant else None
    options = work.ReplayOptions(
        out=out if record else None, realtime=speed == "1", system=system, name=name,
        mapping=mapping, settings=settings,
    )  # fmt: skip
    done = []
    for log, chosen in zip(logs, work.told_apart(logs, options), strict=True):
        with _progress(f"replaying {log.name}") as tell:
            done.append(work.replay(log, boat, own, chosen, tell))
        if not json:
            show_replay(done[-1])
    _print(json, lambda: replays_dict(done), lambda: None)


@app.command()
def live(
    endpoints: Annotated[
        list[str],
        typer.Argument(help="udpin:HOST:PORT, udpout:…, tcp:…, tcpin:…, /dev/NAME[,BAUD]."),
    ],
    vessel: Annotated[
        list[str],
        typer.Option("--vessel", "-v", help="Model of the boat; SYSID=FILE where there are more."),
    ],
    plant: Annotated[
        Path | None, typer.Option(help="What the shadow is played by. Default: the vessel.")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(help="What the shadow follows: measured, model (prediction) or auto."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("shadow-out"),
    record: Annotated[bool, typer.Option(help="Record to MCAP.")] = True,
    publish: Annotated[bool | None, typer.Option(help="Publish on zenoh.")] = None,
    name: Annotated[str | None, typer.Option(help="Name on zenoh: shadow/NAME/…")] = None,
    silent: Annotated[bool, typer.Option("--silent", help="Send nothing at all.")] = False,
    signing_key: Annotated[
        Path | None, typer.Option(help="Key file: only frames signed with it are taken.")
    ] = None,
    effects: EffectFiles = None,
    config: Config = None,
) -> None:
    """The digital shadow beside a running boat: estimate, follow, publish, record. Ctrl-C ends."""
    from gateway.pipelines.live import LiveOptions
    from gateway.pipelines.run_live import plans_of, run_until_stopped

    settings = _settings(config, reference, publish)
    plans = plans_of(vessel, plant, name, _effects(effects))
    options = LiveOptions(tuple(endpoints), out if record else None, silent, signing_key, settings)
    run_until_stopped(plans, options, _tell)


@app.command()
def simulate(
    vessel: VesselFile,
    commands: Annotated[
        str | None,
        typer.Argument(
            help="CSV: time [s] and one column per actuator by name, −1 … 1. With --live also "
            "steps, zigzag, turns, chirp, random, mixed or still."
        ),
    ] = None,
    follow: Annotated[
        Path | None, typer.Option("--follow", help="A second vessel that follows the first.")
    ] = None,
    live: Annotated[
        str | None,
        typer.Option(
            "--live", metavar="ENDPOINT", help="Play it as a MAVLink boat, to udpout:HOST:PORT."
        ),
    ] = None,
    system: Annotated[int, typer.Option("--system", help="System id of the played boat.")] = 1,
    seconds: Annotated[float, typer.Option(help="How long to play [s].")] = float("inf"),
    fast: Annotated[
        bool, typer.Option("--fast", help="High message rates at once, without being asked.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the played boat's noise.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for the recording.")] = Path("shadow-out"),
    effects: EffectFiles = None,
    config: Config = None,
) -> None:
    """Commands in, motion out, as a recording; with --live as a boat to try live mode on."""
    boat = _vessel(vessel, effects)
    if live is not None:
        from gateway.pipelines.play import play_until_stopped

        play_until_stopped(
            boat, live, _tell, program=commands or "mixed", system=system, fast=fast, seed=seed,
            seconds=seconds,
        )  # fmt: skip
        return
    from gateway.pipelines.simulate import simulate as work
    from gateway.show.replay import show_simulated

    if commands is None:
        raise BadInput("no commands: give a CSV, or --live ENDPOINT to play the boat")
    follower = _vessel(follow, effects) if follow else None
    options = _settings(config, None, None).following.follower
    show_simulated(work(Path(commands), boat, follower, out, options=options))


@app.command()
def identify(
    logs: LogFiles,
    vessel: VesselFile,
    out: Annotated[Path | None, typer.Option("--out", help="The vessel file to write.")] = None,
    start: Annotated[
        float | None, typer.Option("--from", help="Start [s after a recording's first sample].")
    ] = None,
    end: Annotated[float | None, typer.Option("--to", help="End [s].")] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(help="Also fit this: m11 … N_ur, left.ahead, EFFECT.NAME or EFFECT.*"),
    ] = None,
    fix: Annotated[list[str] | None, typer.Option(help="Leave this as it is.")] = None,
    prior: Annotated[
        list[str] | None, typer.Option(help="NAME=SHARE: known beforehand to within that share.")
    ] = None,
    method: Annotated[
        str, typer.Option(help="shooting, or regression: the paper's least squares.")
    ] = "shooting",
    validate: Annotated[
        list[Path] | None, typer.Option(help="Recordings to judge by; default: blocks held out.")
    ] = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    json: AsJson = False,
) -> None:
    """The vessel's numbers from recordings, with 95 % intervals, and what they gain."""
    from gateway.pipelines.identify import Span, identify_logs, settings_of
    from gateway.show.identify import show_identified
    from gateway.show.progress import status

    settings = settings_of(free or (), fix or (), prior or (), method)
    with status("identifying") as tell:
        found = identify_logs(
            logs, vessel, out, settings, span=Span(start, end), validate=validate or (),
            system=system, mapping=mapping, effects=_effects(effects), tell=tell,
        )  # fmt: skip
    _print(json, found.as_dict, lambda: show_identified(found, out))


@app.command()
def compare(
    logs: LogFiles,
    vessel: Annotated[
        list[Path],
        typer.Option("--vessel", "-v", help="Model of the boat; several are held side by side."),
    ],
    horizon: Annotated[float, typer.Option(help="How long the model runs freely [s].")] = 10.0,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for pictures (PNG) of errors and tracks.")
    ] = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    json: AsJson = False,
) -> None:
    """How far is the model from the measurement, beside the noise floor, and where is it worst."""
    from gateway.pipelines.compare import as_json, compare_logs
    from gateway.show.compare import show_comparisons
    from gateway.show.progress import status
    from sim.diagnosis.settings import CompareSettings

    try:
        settings = CompareSettings(horizon=horizon)
    except ValueError as error:
        raise BadInput(f"--horizon: {error}") from None
    with status("comparing") as tell:
        found = compare_logs(
            logs, vessel, settings, system=system, mapping=mapping, effects=_effects(effects),
            pictures=pictures, progress=tell,
        )  # fmt: skip
    _print(json, lambda: as_json(found), lambda: show_comparisons(found, pictures))


@app.command(name="effects")
def show_effects(
    name: Annotated[str | None, typer.Argument(help="One effect, explained.")] = None,
    effects: EffectFiles = None,
) -> None:
    """The catalogue of physical effects: equation, parameters, what it looks like in the data."""
    from gateway.effect_files import known_effects
    from gateway.show.effects import show_catalogue, show_effect

    known = [*known_effects(), *_effects(effects)]
    if name is None:
        show_catalogue(known)
        return
    chosen = [effect for effect in known if effect.name == name]
    if not chosen:
        raise BadInput(f"no effect named {name!r}: there are {', '.join(e.name for e in known)}")
    show_effect(chosen[0])


@app.command(name="config")
def show_config(config: Config = None, json: AsJson = False) -> None:
    """The resolved configuration: gateway.toml over the defaults."""
    import tomli_w

    from gateway.config import as_tables

    tables = as_tables(_settings(config, None, None))
    _print(json, lambda: tables, lambda: print(tomli_w.dumps(tables), end=""))


@app.command()
def repair(file: Annotated[Path, typer.Argument(help="An MCAP recording.")]) -> None:
    """Make a recording whole that was cut off (power, kill): rewritten in one piece."""
    from gateway.recording import repair as work

    done = work(file)
    state = "was whole already" if done.was_finished else f"made whole: {done.messages} messages"
    print(f"{done.path}: {state}")


@app.command()
def monitor(
    vessel: Annotated[
        str, typer.Argument(metavar="NAME", help="One vessel, as in shadow/NAME/…; else all.")
    ] = "*",
    connect: Annotated[
        str, typer.Option(help="Where a gateway or zenoh router listens.")
    ] = "tcp/127.0.0.1:7447",
    config: Annotated[
        Path | None, typer.Option("--config", help="zenoh configuration (.json5), e.g. with TLS.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="One picture, then end.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Lines of JSON, one per vessel.")] = False,
) -> None:
    """Watch shadows in the terminal, from this machine or another: states, residuals, health."""
    from gateway.monitor.run import MonitorOptions
    from gateway.monitor.run import monitor as work

    work(MonitorOptions(connect, config, vessel), once, json)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for what it writes.")] = Path("shadow-out/demo"),
) -> None:
    """The whole story on recordings that ship: replay, record, publish, compare. Offline."""
    from gateway.pipelines.demo import run_demo

    run_demo(out)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"shadow-gateway {installed('shadow-gateway')}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the program itself."""


def _vessel(path: Path, effects: list[Path] | None) -> Any:
    from gateway.vessel_file import load_vessel

    return load_vessel(path, _effects(effects))


def _effects(files: list[Path] | None) -> list[Any]:
    from gateway.effect_files import load_effects

    return [effect for file in files or [] for effect in load_effects(file)]


def _settings(
    config: Path | None, reference: str | None, publish: bool | None, recorded: Any = None
) -> Any:
    """What the flags say, over the configuration file, over what a recording was made with."""
    from gateway.config import load_settings
    from sim.following.reference import Mode

    settings = recorded or load_settings(config)
    if reference is not None:
        if reference not in set(Mode):
            raise BadInput(f"--reference {reference}: expected {', '.join(Mode)}")
        following = replace(settings.following, reference=Mode(reference))
        settings = replace(settings, following=following)
    if publish is not None:
        settings = replace(settings, zenoh=replace(settings.zenoh, publish=publish))
    return settings


def _tell(says: str) -> None:
    """A line about work that goes on, on standard error."""
    print(says, file=sys.stderr, flush=True)


def _progress(what: str) -> Any:
    from gateway.show.progress import progress

    return progress(what)


def _print(json: bool, as_dict: Callable[[], Any], show: Callable[[], None]) -> None:
    """One of the two forms of a result, on standard output."""
    if json:
        options = orjson.OPT_INDENT_2 | orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE
        sys.stdout.buffer.write(orjson.dumps(as_dict(), option=options))
    else:
        show()


# What typer raises for a command line that it cannot use; it has no public name.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]


def main() -> None:
    """Entry point of `shadow`: one line and an exit status for everything that goes wrong."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave nothing half-written
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
        sys.stdout.flush()
    except ShadowError as error:
        _fail(str(error), error.exit_status)
    except LawError as error:
        _fail(str(error), 2)
    except _UsageError as error:
        _fail(_usage(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted", 130)
    except BrokenPipeError:  # whoever read our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    sys.exit(status if isinstance(status, int) else 0)


def _usage(error: Any) -> str:
    """What is wrong on the command line, and where to read more."""
    command = error.ctx.command_path if error.ctx is not None else "shadow"
    return f"{error.format_message().rstrip('.')}: see `{command} --help`"


def _fail(says: str, status: int) -> NoReturn:
    """One line, whatever names with line breaks it quotes."""
    print(f"error: {' '.join(says.split())}", file=sys.stderr)
    sys.exit(status)
