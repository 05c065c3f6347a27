"""Commands by groups, listed in `gateway.cli`; `gateway.offline` and `gateway.live` do the work.

Here: options that several commands share, what they stand for, and how a result is printed.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.commands.completion import vessels_begun
from gateway.errors import BadInput
from gateway.ingest.open import FORMATS, names_of, takes_mapping
from gateway.long_running import LogFormat, LogLine, print_line
from gateway.result_json import result_json
from sim.near_names import did_you_mean


def short_help(command: Callable[..., None]) -> str:
    """What a command does, for the list of all: whole, for typer cuts it."""
    return " ".join((command.__doc__ or "").partition("\n\n")[0].split())


def vessel_from(path: Path, effects: list[Path] | None) -> Any:
    """Read a vessel file; it may hold effects of the Python files."""
    from gateway.vessel_file import load_vessel

    return load_vessel(path, effects_from(effects))


def effects_from(files: list[Path] | None) -> list[Any]:
    """The effects in the Python files that were named."""
    from gateway.user_effects import load_effects

    return [effect for file in files or [] for effect in load_effects(file)]


def settings_from(
    config: Path | None,
    reference: str | None,
    publish: str | None,
    recorded: Any = None,
    adapt: str | None = None,
    topics: str | None = None,
) -> Any:
    """Flags over the configuration: that of a recording where there is one, else the file's."""
    from gateway.config import load_settings
    from gateway.recording.recorder import TopicsKept
    from gateway.shadow.model_monitor import Adapt
    from sim.following.follower import ReferenceMode

    settings = recorded or load_settings(config)
    if topics is not None:
        names = [kept.value for kept in TopicsKept]
        one_of("--topics", topics, names)
        recording = replace(settings.recording, topics=TopicsKept(topics))
        settings = replace(settings, recording=recording)
    if reference is not None:
        one_of("--reference", reference, tuple(ReferenceMode))
        following = replace(settings.following, reference=ReferenceMode(reference))
        settings = replace(settings, following=following)
    if adapt is not None:
        one_of("--adapt", adapt, tuple(Adapt))
        settings = replace(settings, following=replace(settings.following, adapt=Adapt(adapt)))
    if publish is not None:
        settings = replace(settings, zenoh=_published(publish, settings.zenoh))
    return settings


def _published(where: str, zenoh: Any) -> Any:
    """The settings of zenoh with what `--publish` says."""
    from gateway.keelson import DEFAULT_BASE

    one_of("--publish", where, PUBLISH)
    if where == KEELSON:
        return replace(zenoh, publish=True, keelson=zenoh.keelson or DEFAULT_BASE)
    return replace(zenoh, publish=where == PUBLISH[0])


def one_of(option: str, given: str, known: Sequence[str]) -> None:
    """BadInput where what was given for an option is none of those it takes."""
    if given not in known:
        raise BadInput(f"{option} {given}: {did_you_mean(given, known)}expected {', '.join(known)}")


def print_progress(text: str) -> None:
    """Print a line about long work on standard error."""
    print_line(text)


def tell_unused_mapping(given: dict[str, Any]) -> None:
    """Say of a command's arguments where --mapping is given and none of the logs is a table."""
    logs = given.get("logs") or filter(None, [given.get("log")])
    names = [str(log) for log in logs]
    if given.get("mapping") and names and not any(map(takes_mapping, names)):
        print_progress(f"--mapping is of no use for {', '.join(names)}: only tables take one")


def ask_about_vessels(given: dict[str, Any]) -> None:
    """Ask about numbers in a command's vessel files that no boat has, one line each."""
    named = given.get("vessel") or ()
    files = [named] if isinstance(named, str | Path) else named
    form = LogFormat.JSON if given.get("log") is LogFormat.JSON else LogFormat.TEXT
    for file in dict.fromkeys(map(str, files)):
        for question in _questions(file):
            print_line(LogLine(f"{file}: {question}", "warning"), form)


def _questions(given: str) -> list[str]:
    """Those about one file; of one that cannot be read the command itself tells."""
    from gateway.files import named_vessel, vessel_path
    from gateway.vessel_file import read_vessel_file
    from gateway.vessel_questions import questions

    file = vessel_path(named_vessel(given)[1])
    try:
        return list(questions(read_vessel_file(file))) if file.is_file() else []
    except BadInput:
        return []


def print_result(json: bool, to_dict: Callable[[], Any], show: Callable[[], None]) -> None:
    """Print a result on standard output, as JSON or as text."""
    if json:
        sys.stdout.buffer.write(result_json(to_dict()))
    else:
        show()


LogFile = Annotated[
    Path,
    typer.Argument(metavar="LOG", help=f"A recording: {names_of(FORMATS)}."),
]
LogFiles = Annotated[
    list[Path],
    typer.Argument(metavar="LOG", help=f"Recordings, each {names_of(FORMATS)}."),
]
VesselFile = Annotated[
    Path,
    typer.Option(
        "--vessel",
        "-v",
        help="Model of the boat (TOML, see configs/vessels; or a recording that holds one).",
        autocompletion=vessels_begun,
    ),
]
VesselFiles = Annotated[
    list[Path],
    typer.Option(
        "--vessel",
        "-v",
        help="Model of the boat; several are held side by side.",
        autocompletion=vessels_begun,
    ),
]
EffectFiles = Annotated[
    list[Path] | None, typer.Option("--effects", help="Python files with effects of your own.")
]
System = Annotated[
    int | None, typer.Option("--system", help="MAVLink system id, where a log holds several boats.")
]
Anyway = Annotated[
    bool,
    typer.Option("--anyway", help="Take the log of a copter, plane or submarine for a boat's."),
]
Mapping = Annotated[
    Path | None, typer.Option("--mapping", help="What the columns of a .csv mean (TOML).")
]
Plant = Annotated[
    str | None,
    typer.Option(
        metavar="KIND[:FILE]",
        help="What plays the shadow (shadow plants); FILE alone is a vessel. Default: the vessel.",
    ),
]
PlayedBy = Annotated[
    str | None,
    typer.Option(
        "--plant",
        metavar="KIND[:FILE]",
        help="What moves under the vessel's actuators (shadow plants). Default: the vessel.",
    ),
]
Reference = Annotated[
    str | None,
    typer.Option(
        "--reference", help="What the shadow follows: measured, model (prediction) or auto."
    ),
]
Adapt = Annotated[
    str | None,
    typer.Option(
        "--adapt",
        metavar="[watch|apply]",
        help="Follow the vessel's numbers while sailing (topic `parameters`); with apply the "
        "shadow uses them. Default: neither.",
    ),
]
Record = Annotated[bool, typer.Option("--record/--no-record", help="Record to MCAP.")]
Topics = Annotated[
    str | None,
    typer.Option(
        "--topics",
        metavar="all|thinned|none",
        help="What is recorded of topics that the raw frames give again (thinned: two rows a "
        "second). The frames are always whole.",
    ),
]
KEELSON = "keelson"
PUBLISH = ("zenoh", KEELSON, "off")
Publish = Annotated[
    str | None,
    typer.Option(
        "--publish",
        metavar="[zenoh|keelson|off]",
        help="Publish on zenoh; with keelson under Keelson's keys too. --no-publish: off.",
    ),
]
ZenohName = Annotated[str | None, typer.Option("--name", help="Name on zenoh: shadow/NAME/…")]
Config = Annotated[Path | None, typer.Option("--config", help="gateway.toml.")]
Force = Annotated[
    bool,
    typer.Option("--force", help="Replace files that this command did not write, inputs too."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON alone on standard output.")]
ByRecording = Annotated[
    bool,
    typer.Option(
        "--by-recording",
        help="Fit each recording alone, with a current of its own, and put them together; one "
        "that disagrees is named and left out.",
    ),
]
BoatsOfOneType = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=PATTERN",
        help="With --by-recording: recordings of boats of one type, which share a hull and "
        "have thrusters of their own; the first boat's are those of --vessel.",
    ),
]
