"""Commands for a boat that is there now, or simulated."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gateway.commands.options import (
    AsJson,
    Config,
    EffectFiles,
    Plant,
    Publish,
    Record,
    Reference,
    VesselFile,
    ZenohName,
    effects_from,
    print_progress,
    print_result,
    settings_from,
    vessel_from,
)
from gateway.errors import BadInput


def live(
    endpoints: Annotated[
        list[str] | None,
        typer.Argument(
            help="udpin:HOST:PORT, udpout:…, tcp:…, tcpin:…, /dev/NAME[,BAUD]. Default: those of "
            "the configuration."
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
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("shadow-out"),
    record: Record = True,
    publish: Publish = None,
    name: ZenohName = None,
    foxglove: Annotated[
        str | None,
        typer.Option(
            metavar="[HOST:]PORT", help="A WebSocket for Foxglove and Lichtblick, usually 8765."
        ),
    ] = None,
    silent: Annotated[bool, typer.Option("--silent", help="Send nothing at all.")] = False,
    signing_key: Annotated[
        Path | None, typer.Option(help="Key file: only frames signed with it are taken.")
    ] = None,
    effects: EffectFiles = None,
    config: Config = None,
) -> None:
    """The digital shadow beside a running boat: estimate, follow, publish, record. Ctrl-C ends."""
    from gateway.live.gateway import LiveOptions, plans_in, plans_of, run_until_stopped

    settings = settings_from(config, reference, publish)
    if foxglove is not None:
        settings = replace(settings, foxglove=replace(settings.foxglove, address=foxglove))
    links = tuple(endpoints or settings.links.endpoints)
    if not links:
        raise BadInput("nowhere to listen: give an endpoint, such as udpin:0.0.0.0:14550")
    own = effects_from(effects)
    plans = plans_of(vessel, plant, name, own) if vessel else plans_in(settings.boats, own)
    if not vessel and (plant or name):
        raise BadInput("--plant and --name go with --vessel; [[boats]] say theirs themselves")
    if not plans:
        raise BadInput("no model of the boat: give --vessel FILE, or [[boats]] in --config FILE")
    options = LiveOptions(links, out if record else None, silent, signing_key, settings)
    run_until_stopped(plans, options, print_progress)


def show_plants(json: AsJson = False) -> None:
    """The kinds of plant that can play a shadow (--plant of live and replay)."""
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
            help="CSV: time [s] and one column per actuator by name, −1 … 1. With --live also "
            "mixed, steps, zigzag, … (shadow plan --list)."
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
    boat = vessel_from(vessel, effects)
    if live is not None:
        from gateway.simulated_boat.play import play_until_stopped

        play_until_stopped(
            boat, live, print_progress, program=commands or "mixed", system=system, fast=fast,
            seed=seed, seconds=seconds,
        )  # fmt: skip
        return
    from gateway.offline.simulate import simulate as work
    from gateway.terminal.recordings import show_simulation

    if commands is None:
        raise BadInput("no commands: give a CSV, or --live ENDPOINT to play the boat")
    follower = vessel_from(follow, effects) if follow else None
    options = settings_from(config, None, None).following.follower
    show_simulation(work(Path(commands), boat, follower, out, options=options))


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
    from gateway.monitor.watcher import MonitorOptions
    from gateway.terminal.monitor_loop import run_monitor

    run_monitor(MonitorOptions(connect, config, vessel), once, json)
