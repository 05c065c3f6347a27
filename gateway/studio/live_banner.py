"""What a live gateway says of the model of its boat, and a way from there to a diagnosis.

`shadow live` records each boat in a file of its own, which can be read while it grows: a copy of it
is worked on, with the vessel that the gateway uses, over its last minutes.
"""

import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from gateway.errors import BadInput, ShadowError
from gateway.ingest.mavlink.definitions import ids_by_name
from gateway.offline.export.frames import message_keys
from gateway.recording.blocks import Block
from gateway.recording.reader import Recording, rewrite
from gateway.recording.recorder import RAW
from gateway.shadow.topic_rows import LIVE, METADATA
from gateway.studio.live_history import WatchedBoat
from gateway.studio.page import NO_BUTTON, button, html, stack
from gateway.studio.worker import Send
from sim.monitoring.alarm import ModelEvent

FROZEN_S = 300.0  # of a recording, worked on
GROWING_S = 30.0  # without a byte, and a recording no longer grows: it is flushed twice a second
ALERT = {
    "background": "var(--paper)", "border": "2px solid var(--warn)", "border-radius": "10px",
    "padding": "8px 14px", "margin": "0 0 14px 0", "flex-direction": "row", "flex-wrap": "wrap",
    "align-items": "center", "gap": "4px 14px",
}  # fmt: skip


def sentence_of(boat: WatchedBoat) -> str | None:
    """What its gateway says now of a model that is wrong; None where it says nothing of the kind.

    A boat that is not heard says nothing now, and what an earlier run of the gateway said is over.
    """
    if boat.status.silent_s is not None or boat.status.link_silent_s is not None:
        return None
    kinds = {event.value for event in ModelEvent}
    said = [e for e in boat.status.events
            if e["kind"] in kinds and e["receive_time_ns"] * 1e-9 > boat.gone]  # fmt: skip
    if not said or said[-1]["kind"] == ModelEvent.RIGHT.value:
        return None
    return str(said[-1]["says"])


class Banners:
    """A banner for each boat whose model is wrong, with a button that calls `diagnose(name)`."""

    def __init__(self, diagnose: Callable[[str], None]) -> None:
        self.part = stack(margin=0)
        self._diagnose = diagnose
        self._shown: list[tuple[str, str]] = []

    def show(self, boats: Iterable[WatchedBoat]) -> None:
        """What is said now; a banner that stays the same keeps the keyboard's focus."""
        said = [(b.status.name, text) for b in boats if (text := sentence_of(b)) is not None]
        if [name for name, _ in said] != [name for name, _ in self._shown]:
            self.part.objects = [self._banner(name) for name, _ in said]
        for banner, (name, text) in zip(self.part.objects, said, strict=True):
            line = f"<p role='status'><strong>{escape(name)}</strong>: {escape(text)}.</p>"
            if banner[0].object != line:
                banner[0].object = line
        self._shown = said

    def _banner(self, name: str) -> Any:
        text = html()
        text.styles = {"flex": "1 1 20rem"}
        press = button("Diagnose this", lambda: self._diagnose(name), "primary", width=150)
        return pn.Column(text, press, styles=ALERT, sizing_mode="stretch_width",
                         stylesheets=[NO_BUTTON])  # fmt: skip


def growing_recording(name: str, files: Sequence[Path]) -> Path:
    """The recording that a live gateway writes of a boat now; BadInput where there is none."""
    live = [file for file in files if file.suffix == ".mcap" and _age_s(file) < GROWING_S]
    for file in sorted(live, key=_age_s):
        try:
            about = Recording.open(file).metadata.get(METADATA, {})
        except ShadowError:
            continue  # of another program, or only just begun
        if LIVE in about and about.get("vessel") == name:
            return file
    raise BadInput(
        f"{name}: no recording of it grows in a folder that the studio was given: start it with "
        "--folder, the folder into which `shadow live` records (its --out)"
    )


def _age_s(file: Path) -> float:
    """Time since it was written to [s]."""
    return time.time() - file.stat().st_mtime


@dataclass(frozen=True)
class Frozen:
    """The last minutes of a growing recording, and the vessel file that its gateway uses."""

    file: Path
    vessel: str


def freeze_task(send: Send, path: str, folder: str) -> Frozen:
    """Copy the last minutes of a growing recording, and all parameters, into a folder."""
    send("keeping the last minutes")
    recording = Recording.open(Path(path))
    ends = [int(block.log_time_ns.max()) for block in recording.blocks() if len(block.log_time_ns)]
    since = max(ends, default=0) - round(FROZEN_S * 1e9)

    def is_kept(block: Block) -> NDArray[np.bool_]:
        raw = [number for number, channel in block.channels.items() if channel.topic == RAW]
        frames = np.flatnonzero(np.isin(block.channel, raw) & (block.end > block.start))
        kind = message_keys(block.data, block.start[frames], block.end[frames])[:, 2]
        kept = block.log_time_ns >= since
        kept[frames[kind == ids_by_name()["PARAM_VALUE"]]] = True
        return kept

    stem = re.sub(r"[^\w.+-]", "_", recording.path.stem)
    file = Path(folder) / f"{stem}-until-{time.strftime('%H%M%S')}.mcap"
    whole = file.with_suffix(".part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with whole.open("wb") as stream:
            rewrite(recording, Writer(stream, compression=CompressionType.ZSTD), is_kept)
        whole.replace(file)
    except OSError as error:
        raise ShadowError(f"{file.name}: cannot be kept: {error.strerror or error}") from error
    finally:
        whole.unlink(missing_ok=True)
    return Frozen(file, recording.attachments["vessel.toml"].data.decode())
