"""What comes next for a recording: commands that work on it, each on a line that can be pasted."""

from pathlib import Path

from gateway.errors import BadInput, shell_path
from gateway.ingest.log import Log, not_a_boat
from gateway.ingest.mapping import THRUST_FUNCTIONS
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.ingest.px4_outputs import named_only
from gateway.ingest.survey import BoatSurvey, Survey
from gateway.vessel_file import ENCLOSED_VESSEL, load_vessel

BOAT = Path("boat.toml")  # the name that commands are suggested with


def main_boat(found: Survey) -> BoatSurvey:
    """The boat of a recording that commands are suggested for: the one heard for longest."""
    return max(found.boats, key=lambda boat: boat.seconds)


def holds_vessel(log: Log) -> bool:
    """Is it a recording of the gateway's, with a vessel file that needs no effects beside it?"""
    ours = log.recording if isinstance(log, MavlinkLog) else None
    if ours is None or ENCLOSED_VESSEL not in ours.attachments:
        return False
    try:
        load_vessel(ours.path)
    except BadInput:  # effects of somebody's own
        return False
    return True


def after_info(
    found: Survey,
    unusable: str = "",
    mapping: Path | None = None,
    system: int | None = None,
    holds_vessel: bool = False,
) -> str:
    """What can be done with a recording that was looked at; `unusable`: why nothing can be compared
    in it, empty where something can; `holds_vessel`: the gateway made it, its vessel file is in it.
    """
    one = main_boat(found)
    system = one.boat.system if len(found.boats) > 1 else system
    words = log_words(found.path, system, bool(not_a_boat(one.boat)), mapping)
    if holds_vessel and not unusable:
        held = shell_path(found.path)
        return (
            "compare it with the vessel file that it holds, or with a better one:\n"
            f"  shadow compare {words} --vessel {held}"
        )
    has_motors = any(actuator.kind in THRUST_FUNCTIONS for actuator in one.actuators)
    init = f"shadow init {words} --out {_free_name()}"
    compare = f"shadow compare {words} --vessel {BOAT}"
    if unusable and has_motors and not not_a_boat(one.boat):
        return (
            f"nothing can be compared in it: {unusable}; for other logs of this boat its "
            f"parameters begin a vessel file:\n  {init}"
        )
    if unusable:
        return f"nothing can be compared in it: {unusable}"
    if not has_motors:
        why = named_only(one.named_outputs) or "no parameter in the log names the motors"
        return (
            f"write {BOAT} like a file in configs/vessels, with this boat's channels ({why}), "
            f"then:\n  {compare}"
        )
    if BOAT.exists():
        return f"if {BOAT} is this boat's:\n  {compare}\nelse:\n  {init}"
    return init


def after_init(out: Path, words: str, unusable: str) -> str:
    """What to do with a vessel file that was begun from a log; `words`: the log and its options."""
    edit = f"correct {out} by hand"
    if unusable:
        return f"{edit}, then compare another log with it: nothing can be in this one: {unusable}"
    return f"{edit}, then:\n  shadow compare {words} --vessel {shell_path(out)}"


def log_words(
    path: str | Path, system: int | None, anyway: bool, mapping: Path | None = None
) -> str:
    """A recording on a command line, with the options that it needs to be read."""
    words = [shell_path(path)]
    words += ["--system", str(system)] if system is not None else []
    words += ["--anyway"] if anyway else []
    words += ["--mapping", shell_path(mapping)] if mapping is not None else []
    return " ".join(words)


def _free_name() -> Path:
    """The first name for a vessel file that is not taken here: what is there stays."""
    name, number = BOAT, 2
    while name.exists():
        name, number = BOAT.with_stem(f"{BOAT.stem}_{number}"), number + 1
    return name
