"""What is kept of a studio from one day to the next: named ranges, plots and derived signals.

One small file, studio-layout.json, beside the results; it is written whole or not at all.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from gateway.errors import BadInput
from gateway.files import write_whole
from gateway.studio.views import TimeRanges

NAME = "studio-layout.json"


@dataclass(frozen=True)
class NamedRange:
    """Stretches of time [s] of one recording."""

    recording: str
    times: TimeRanges


@dataclass(frozen=True)
class Layout:
    """ranges by name; derived signals, name -> expression; plots, each the names of its signals."""

    ranges: Mapping[str, NamedRange] = field(default_factory=dict)
    derived: Mapping[str, str] = field(default_factory=dict)
    plots: tuple[tuple[str, ...], ...] = ()


def load_layout(folder: Path) -> Layout:
    """What was kept there; an empty layout where nothing was, BadInput where it cannot be read."""
    file = folder / NAME
    try:
        return msgspec.json.decode(file.read_bytes(), type=Layout)
    except FileNotFoundError:
        return Layout()
    except (OSError, msgspec.MsgspecError) as error:
        raise BadInput(f"{NAME} cannot be read, move it away to begin anew: {error}") from None


def save_layout(layout: Layout, folder: Path) -> None:
    """Keep it, but never in the place of a file that cannot be read."""
    load_layout(folder)
    text = msgspec.json.format(msgspec.json.encode(layout), indent=1)
    write_whole(folder / NAME, text, "the layout")
