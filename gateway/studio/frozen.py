"""The last minutes of a live boat as a recording that can be worked on.

`shadow live` records each boat in a file of its own, which can be read while it grows: of its last
minutes a copy is worked on, with the vessel that the gateway uses. Nothing here needs the pages, so
that a worker's process begins soon.
"""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from gateway.errors import BadInput, ShadowError
from gateway.ingest.mavlink.definitions import ids_by_name
from gateway.offline.export.frames import message_keys
from gateway.recording.blocks import Block
from gateway.recording.reader import Recording, rewrite
from gateway.recording.recorder import RAW
from gateway.shadow.topic_rows import LIVE, METADATA
from gateway.studio.worker import Send

FROZEN_S = 300.0  # of a recording, worked on
GROWING_S = 30.0  # without a byte, and a recording no longer grows: it is flushed twice a second


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
