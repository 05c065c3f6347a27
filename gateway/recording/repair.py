"""Makes a recording whole that was cut off or is damaged, and loses nothing of it.

The file is written anew from all that can be read. Where anything that was in it does not get into
the new file, the old one is kept beside it.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from mcap.writer import CompressionType, Writer

from gateway.errors import BadInput, ShadowError, counted
from gateway.recording.damage import Damage
from gateway.recording.reader import Recording, rewrite

QUIET_SECONDS = 10.0
KEPT = ".damaged"  # behind the name of a file, as it was


class Repair(NamedTuple):
    """What `repair` found and wrote."""

    path: Path
    was_finished: bool
    messages: int
    damage: Damage
    kept: Path | None = None  # the file as it was

    @property
    def was_whole(self) -> bool:
        """Was there nothing to do?"""
        return self.was_finished and not self.damage

    def text(self) -> str:
        """What was done, in one line."""
        if self.was_whole:
            return f"{self.path}: was whole already"
        parts = [f"made whole: {counted(self.messages, 'message')}"]
        if self.damage:
            parts.append(self.damage.text())
        elif self.damage.tail_bytes:
            parts.append("its last bytes are of no whole record")
        if self.damage.not_copied:
            records = counted(self.damage.not_copied, "record")
            parts.append(f"{records} of unknown kinds or of a name that comes again left out")
        if self.kept is not None:
            parts.append(f"the file as it was: {self.kept}")
        return f"{self.path}: " + "; ".join(parts)


def repair(path: Path, now: Callable[[], float] = time.time) -> Repair:
    """Rewrite an unfinished or damaged recording, in its place; a whole one stays as it is."""
    recording = Recording.open(path)
    damage = recording.damage
    messages = sum(recording.counts().values())
    found = Repair(path, recording.finished, messages, damage)
    if found.was_whole:
        return found
    kept = path.with_name(path.name + KEPT) if damage.drops_bytes else None
    _check(recording, messages, kept, now)
    _replace(recording, kept)
    return found._replace(kept=kept)


def _check(
    recording: Recording, messages: int, kept: Path | None, now: Callable[[], float]
) -> None:
    """Refuse what may still be written, what holds nothing, and what would replace a file."""
    path = recording.path
    age = now() - path.stat().st_mtime
    if 0.0 <= age < QUIET_SECONDS:
        raise BadInput(
            f"{path}: was written {age:.0f} s ago, it may still be recording: stop that first, "
            f"or wait {QUIET_SECONDS:.0f} s"
        )
    if not (messages or recording.attachments or recording.metadata):
        raise BadInput(f"{path}: nothing in it can be read: it is left as it is")
    if kept is not None and os.path.lexists(kept):
        raise BadInput(f"{kept} exists: move it away, {path} would be kept there as it was")


def _replace(recording: Recording, kept: Path | None) -> None:
    """Write a recording anew and put it in its place; `kept`: where the old file goes, if anywhere.

    The old file gets its second name before it loses its first, so that it is there at any moment.
    """
    path = recording.path
    whole = path.with_name(path.name + ".repair")
    try:
        with whole.open("wb") as stream:
            rewrite(recording, Writer(stream, compression=CompressionType.ZSTD))
            stream.flush()
            os.fsync(stream.fileno())
        if kept is not None:
            _keep(path, kept)
        whole.replace(path)
    except OSError as error:
        raise ShadowError(f"{path}: cannot be repaired: {error.strerror or error}") from error
    finally:
        whole.unlink(missing_ok=True)


def _keep(path: Path, kept: Path) -> None:
    """Give a file a second name; a disk without such names (FAT) moves it."""
    try:
        kept.hardlink_to(path)
    except FileExistsError:
        raise
    except OSError:
        path.rename(kept)
