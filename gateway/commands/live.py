"""Commands for a boat that is there now, or simulated."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gateway.commands import (
    Adapt,
    AsJson,
    Config,
    EffectFiles,
    Force,
    Plant,
    PlayedBy,
    Publish,
    Record,
    Reference,
    Topics,
    VesselFile,
    ZenohName,
    effects_from,
    print_progress,
    print_result,
    settings_from,
    vessel_from,
)
from gateway.errors import BadInput
from gateway.files import DAYS, check_place, guarded_outputs, named_as, vessel_path
from gateway.long_running import LogFormat, print_line


def live(
    endpoints: Annotated[
        list[str] | None,
        typer.Argument(
            help="udpin:HOST:PORT (or udp:…), udpout:…, tcp:…, tcpin:…, /dev/NAME[,BAUD], "
            "zenoh:KEY. Default: those of the configuration."
        ),
    ] = None,
    vessel: Annotated[
        list[str] | None,
        typer.Option(
            "--vessel",
            "-v",
            help="Model of the boat; SYSID=FILE where there are more. Default: the boats of the "
            "configuration.",
        ),
    ] = None,
    plant: Plant = None,
    reference: Reference = None,
    adapt: Adapt = None,
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("shadow-out"),
    record: Record = True,
    topics: Topics = None,
    publish: Publish = None,
    name: ZenohName = None,
    foxglove: Annotated[
        str | None,
        typer.Option(
            metavar="[HOST:]PORT", help="A WebSocket for Foxglove and Lichtblick, usually 8765."
        ),
    ] = None,
    metrics: Annotated[
        str | None,
        typer.Option(metavar="[HOST:]PORT", help="Prometheus metrics, usually 9464."),
    ] = None,
    log: Annotated[
        LogFormat, typer.Option("--log", help="Lines for people, or a JSON object each.")
    ] = LogFormat.TEXT,
    silent: Annotated[bool, typer.Option("--silent", help="Send nothing at all.")] = False,
    signing_key: Annotated[
        Path | None, typer.Option(help="Key file: only frames signed with it are taken.")
    ] = None,
    effects: EffectFiles = None,
    config: Config = None,
) -> None:
    """The digital shadow beside a running boat: estimate, follow, publish, record. Ctrl-C ends."""
    from gateway.live.gateway import LiveOptions, run_until_stopped
    from gateway.live.plans import plans_in, plans_of

    settings = settings_from(config, reference, publish, adapt=adapt, topics=topics)
    if foxglove is not None:
        settings = replace(settings, foxglove=replace(settings.foxglove, address=foxglove))
    if metrics is not None:
        settings = replace(settings, metrics=replace(settings.metrics, address=metrics))
    links = tuple(endpoints or settings.links.endpoints)
    if not links:
        raise BadInput("nowhere to listen: give an endpoint, such as udpin:0.0.0.0:14550")
    own = effects_from(effects)
    plans = plans_of(vessel, plant, name, own) if vessel else plans_in(settings.boats, own)
    if not vessel and (plant or name):
        raise BadInput("--plant and --name go with --vessel; [[boats]] say theirs themselves")
    if not plans:
        raise BadInput("no model of the boat: give --vessel FILE, or [[boats]] in --config FILE")
    if record:
        check_place(out)
    options = LiveOptions(links, out if record else None, silent, signing_key, settings)
    run_until_stopped(plans, options, lambda text: print_line(text, log))


def show_plants(json: AsJson = False) -> None:
    """The kinds of plant that can play a boat or its shadow (--plant)."""
    from gateway.plants import known_plants
    from gateway.terminal.recordings import show_plants as show

    known = [
        {"name": kind.name, "description": kind.description} for kind in known_plants().values()
    ]
    print_result(json, lambda: {"plants": known}, lambda: show(known))


def simulate(
    vessel: VesselFile,
    commands: Annotated[
        str | None,
        typer.Argument(
            help="CSV: time [s] and one column per actuator by name, −1 … 1. With --live or --log "
            "also mixed, steps, zigzag, … (shadow plan --list)."
        ),
    ] = None,
    plant: PlayedBy = None,
    follow: Annotated[
        Path | None, typer.Option("--follow", help="A second vessel that follows the first.")
    ] = None,
    live: Annotated[
        str | None,
        typer.Option(
            "--live", metavar="ENDPOINT", help="Play it as a MAVLink boat, to udpout:HOST:PORT."
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            "--log", metavar="FILE.tlog", help="Write what its radio would send, for identify, …"
        ),
    ] = None,
    system: Annotated[int, typer.Option("--system", help="System id of the played boat.")] = 1,
    seconds: Annotated[
        float, typer.Option(help="How long to play [s]; with --log once by default.")
    ] = float("inf"),
    fast: Annotated[
        bool, typer.Option("--fast", help="High message rates at once, without being asked.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the played boat's noise.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for the recording.")] = Path("shadow-out"),
    effects: EffectFiles = None,
    config: Config = None,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """Commands in, motion out, as a recording; --live plays a boat, --log writes its telemetry."""
    if plant is not None and (live is not None or log is not None):
        raise BadInput(
            "--plant goes with a table of commands; shadow hil plays one to an autopilot"
        )
    if live is not None and log is not None:
        raise BadInput("--live and --log: a boat is played to one of them, give one")
    if log is not None:
        from gateway.simulated_boat.play import write_log

        sources = (vessel_path(vessel), config, *(effects or ()))
        with guarded_outputs("simulate", sources, [named_as(log, ".tlog")], force):
            duration = write_log(
                vessel_from(vessel, effects), log, program=commands or "mixed", system=system,
                fast=fast, seed=seed, seconds=seconds,
            )  # fmt: skip
        written = {"log": str(log), "seconds": duration}
        print_result(
            json, lambda: written, lambda: print_progress(f"{duration:.0f} s played into {log}")
        )
        return
    if live is not None and json:
        raise BadInput("--live: a boat that is played has no result; leave out --json")
    if live is not None:
        from gateway.simulated_boat.play import play_until_stopped

        boat = vessel_from(vessel, effects)
        play_until_stopped(
            boat, live, print_progress, program=commands or "mixed", system=system, fast=fast,
            seed=seed, seconds=seconds,
        )  # fmt: skip
        return
    from gateway.offline.simulate import recording_file
    from gateway.offline.simulate import simulate as work
    from gateway.plants import load_plant
    from gateway.simulated_boat.hull import PROGRAMS
    from gateway.terminal.recordings import show_simulation

    if commands is None:
        raise BadInput("no commands: give a CSV, or play the boat: --live ENDPOINT or --log FILE")
    if commands in PROGRAMS and not Path(commands).exists():
        raise BadInput(
            f"{commands} is what a played boat does: say where, --live ENDPOINT or --log FILE"
        )
    options = settings_from(config, None, None).following.follower
    inputs = (Path(commands), vessel_path(vessel), follow, config, *(effects or ()))
    with guarded_outputs("simulate", inputs, [recording_file(Path(commands), out)], force):
        follower = vessel_from(follow, effects) if follow else None
        boat = vessel_from(vessel, effects)
        played_by = load_plant(plant, effects_from(effects))
        done = work(Path(commands), boat, follower, out, options=options, plant=played_by)
    print_result(json, done.to_dict, lambda: show_simulation(done))


def hil(
    endpoints: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ENDPOINT]...",
            help="Where the autopilot looks for its simulator: json:HOST:PORT (ArduPilot), "
            "px4:HOST:PORT (PX4, usually px4:127.0.0.1:4560), px4:/dev/NAME[:BAUD] (its board in "
            "HITL mode), ahrs:/dev/NAME[:BAUD] (an ArduPilot board). Default: json:127.0.0.1:9002.",
        ),
    ] = None,
    vessel: Annotated[
        list[str] | None,
        typer.Option(
            "--vessel", "-v", help="Model of the boat; [NAME=]FILE for each endpoint, in order."
        ),
    ] = None,
    script: Annotated[
        Path | None,
        typer.Option(metavar="day.toml", help="Current, wind, waves and faults, with moments."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of waves and of sensor noise.")] = 0,
    speed: Annotated[
        float, typer.Option(min=0.01, help="Times real time, for PX4; ArduPilot: SIM_SPEEDUP.")
    ] = 1.0,
    plant: PlayedBy = None,
    outputs: Annotated[
        str | None,
        typer.Option(
            metavar="LINK", help="For ahrs: where the board's MAVLink is, as /dev/ttyACM0,115200."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("shadow-out"),
    record: Record = True,
    effects: EffectFiles = None,
    connect: Annotated[
        str | None,
        typer.Option(
            metavar="tcp/HOST:PORT", help="Bus of `shadow live`, for the truth. Default: its own."
        ),
    ] = None,
    publish: Annotated[
        str, typer.Option(metavar="[zenoh|off]", help="The truth, beside `shadow live`'s shadow.")
    ] = "zenoh",
    json: AsJson = False,
) -> None:
    """The autopilot in the loop: real firmware steers the vessel, as if it were the boat.

    The firmware runs with its simulator set to this address: ArduPilot as
    `ardurover --model json:127.0.0.1`, PX4 as `PX4_SYS_AUTOSTART=1070 px4`. Either side may start
    first, and be started again. The recording holds the truth beside the
    outputs. Ctrl-C ends.
    """
    from gateway.bus import DEFAULT_ENDPOINT as BUS
    from gateway.hil.day_file import load_day
    from gateway.hil.run import DEFAULT_ENDPOINT, LoopOptions, plans_of, run_until_stopped
    from gateway.plants import load_plant
    from gateway.vessel_file import load_vessel

    if not vessel:
        raise BadInput("no model of the boat: give --vessel FILE (TOML)")
    if publish not in ("zenoh", "off"):
        raise BadInput(f"--publish {publish}: expected zenoh or off")
    if record:
        check_place(out)
    own = effects_from(effects)
    plans = plans_of(endpoints or [DEFAULT_ENDPOINT], vessel, lambda file: load_vessel(file, own))
    options = LoopOptions(
        seed=seed, out=out if record else None, speed=speed, outputs=outputs,
        plant=load_plant(plant, own), bus=None if publish == "off" else connect or BUS,
    )  # fmt: skip
    if script is not None:
        day, text = load_day(script, own)
        options = replace(options, day=day, day_text=text)
    loops = run_until_stopped(plans, options, print_progress)
    print_result(json, lambda: {"boats": [loop.to_dict() for loop in loops]}, lambda: None)


def hil_demo(
    vessel: Annotated[
        Path, typer.Option("--vessel", "-v", help="The boat that is really there (TOML).")
    ] = Path("otter"),
    autopilot: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH", help="ardurover, built for SITL. Default: a small stand-in of our own."
        ),
    ] = None,
    script: Annotated[
        Path | None,
        typer.Option(
            metavar="day.toml", help="Its [[effects]] are hidden. Default: a worn port propeller."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all noise.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for what it writes.")] = Path(
        "shadow-out/hil-demo"
    ),
    effects: EffectFiles = None,
    force: Force = False,
) -> None:
    """The closed story: learn a boat in the loop, spoil it, diagnose it, play the better model.

    An autopilot drives the boat along a plan; the plan's log gives a vessel file; then an effect is
    hidden in the boat, and the steps find out which one it is. Some minutes, offline.
    """
    from gateway.hil.day_file import load_day
    from gateway.hil_demo import StandInAutopilot
    from gateway.hil_demo.ardurover import ArduRover
    from gateway.hil_demo.story import (
        DemoOptions,
        first_guess,
        hidden_effects,
        hil_demo_files,
        run_hil_demo,
    )

    boat = vessel_from(vessel_path(vessel), effects)
    day, _ = load_day(script or DAYS / "worn_propeller.toml", effects_from(effects))
    guess = first_guess(boat)
    pilot = StandInAutopilot(guess) if autopilot is None else ArduRover.of(autopilot, guess)
    inputs = (vessel_path(vessel), script, autopilot, *(effects or ()))
    with guarded_outputs("hil-demo", inputs, hil_demo_files(out), force):
        run_hil_demo(DemoOptions(boat, hidden_effects(day), out, seed), pilot)


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
    from gateway.monitor import MonitorOptions
    from gateway.terminal.monitor import run_monitor

    run_monitor(MonitorOptions(connect, config, vessel), once, json)
