"""Options and arguments that several commands take, each said in one way."""

from pathlib import Path
from typing import Annotated

import typer

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
