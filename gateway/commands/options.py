"""What commands are given, made into what pipelines take; and how a result is printed.

Options and arguments that several commands take, each said in one way.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import orjson
import typer

from gateway.errors import BadInput


def vessel_from(path: Path, effects: list[Path] | None) -> Any:
    """A vessel file read, with effects of one's own known."""
    from gateway.vessel_file import load_vessel

    return load_vessel(path, effects_from(effects))


def effects_from(files: list[Path] | None) -> list[Any]:
    """The effects in the Python files that were named."""
    from gateway.user_effects import load_effects

    return [effect for file in files or [] for effect in load_effects(file)]


def settings_from(
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


def tell_line(says: str) -> None:
    """A line about work that goes on, on standard error."""
    print(says, file=sys.stderr, flush=True)


def print_result(json: bool, to_dict: Callable[[], Any], show: Callable[[], None]) -> None:
    """One of the two forms of a result, on standard output."""
    if json:
        options = orjson.OPT_INDENT_2 | orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE
        sys.stdout.buffer.write(orjson.dumps(to_dict(), option=options))
    else:
        show()


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
PlantFile = Annotated[
    Path | None, typer.Option("--plant", help="What the shadow is played by. Default: the vessel.")
]
Reference = Annotated[
    str | None,
    typer.Option(
        "--reference", help="What the shadow follows: measured, model (prediction) or auto."
    ),
]
Record = Annotated[bool, typer.Option("--record/--no-record", help="Record to MCAP.")]
Publish = Annotated[bool | None, typer.Option("--publish/--no-publish", help="Publish on zenoh.")]
ZenohName = Annotated[str | None, typer.Option("--name", help="Name on zenoh: shadow/NAME/…")]
Config = Annotated[Path | None, typer.Option("--config", help="gateway.toml.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON alone on standard output.")]
