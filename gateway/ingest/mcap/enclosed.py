"""The log that a recording was made from, enclosed in it byte for byte.

MAVLink frames are messages of a recording. A log of any other format (.BIN, .ulg, a table with its
mapping) lies beside them as attachments, packed with zstandard, so that whoever has the recording
has all that the log had:

    log/NAME.zst        the log
    log/mapping.toml    what its columns mean, where it is a table
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import zstandard

from gateway.errors import BadInput
from gateway.ingest.format import HEAD, read_bytes
from gateway.recording.blocks import ALWAYS_UNPACKED, MAX_EXPANSION
from gateway.recording.reader import Recording
from gateway.recording.recorder import Attachment

if TYPE_CHECKING:
    from gateway.ingest.log import Log

FOLDER, PACKED, MAPPING = "log/", ".zst", "log/mapping.toml"
MAX_BYTES = (
    500_000_000  # of a log; a larger one is not enclosed: its recording would be slow to open
)


def enclosure(raw: bytes, name: str, mapping: bytes | None = None) -> list[Attachment]:
    """A log of that file name, and the mapping of a table, as attachments; none where too large."""
    if len(raw) > MAX_BYTES:
        return []
    packed = zstandard.ZstdCompressor().compress(raw)
    found = [Attachment(f"{FOLDER}{name}{PACKED}", "application/zstd", packed)]
    if mapping is not None:
        found.append(Attachment(MAPPING, "application/toml", mapping))
    return found


def enclosure_of_file(path: Path, mapping: Path | None) -> list[Attachment]:
    """The same of a log on disk; what a recording encloses is passed on."""
    raw = read_bytes(path)
    if raw.startswith(b"\x89MCAP"):
        held = Recording.open(path).attachments
        return [item for name, item in held.items() if name.startswith(FOLDER)]
    return enclosure(raw, path.name, None if mapping is None else mapping.read_bytes())


def open_enclosed(recording: Recording, mapping: str | Path | None) -> "Log | None":
    """The log that a recording encloses; None where there is none."""
    from gateway.ingest.open import known_formats

    held: Mapping[str, Attachment] = recording.attachments
    names = [name for name in held if name.startswith(FOLDER) and name.endswith(PACKED)]
    if not names:
        return None
    path, raw = str(recording.path), _unpacked(recording.path, held[names[0]].data)
    name = Path(names[0].removeprefix(FOLDER).removesuffix(PACKED)).name
    with tempfile.TemporaryDirectory() as folder:
        if mapping is None and MAPPING in held:
            mapping = Path(folder) / "mapping.toml"
            mapping.write_bytes(held[MAPPING].data)
        for one in known_formats():
            if ".mcap" not in one.suffixes and one.recognises(raw[:HEAD], Path(name)):
                return one.open(path, raw, mapping)
    raise BadInput(f"{path}: encloses {name}, which is no log of a known format")


def _unpacked(path: Path, packed: bytes) -> bytes:
    """Bytes of a log; BadInput where they are damaged or unpack without end."""
    room = ALWAYS_UNPACKED + MAX_EXPANSION * len(packed)
    try:
        size = zstandard.frame_content_size(packed)
        if not 0 <= size <= min(room, MAX_BYTES):
            raise BadInput(f"{path}: the enclosed log unpacks to more than a log has: not read")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError:
        raise BadInput(f"{path}: the enclosed log is damaged: use another copy of it") from None
