"""What a fleet has worked out already: one line a recording, in a file beside its table.

    key = SHA-256 of the content of the recording, SHA-256 of the settings and the vessel file

Lines are added as results come in, and nothing else is ever done to the file: a run that was killed
goes on after the last whole one. A
recording whose content and settings have not changed is not run again, wherever it lies now.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gateway.errors import BadInput, ShadowError
from gateway.fleet.analysis import LASTING, Analysis, AnalysisSettings
from gateway.fleet.fleet_file import Boat
from gateway.fleet.recording_files import stamp
from gateway.fleet.table import SCHEMA_VERSION

RESULTS_FILE = "results.jsonl"


def settings_digest(boat: Boat, settings: AnalysisSettings) -> str:
    """Of all that a result depends on beside the recording: files by their content."""
    files = [boat.vessel_file, *settings.effects, *([boat.mapping] if boat.mapping else [])]
    try:
        contents = [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in files]
    except OSError as error:
        raise BadInput(f"{error.filename}: cannot read it: {error.strerror}") from None
    depends = {
        "schema": SCHEMA_VERSION, "version": version("shadow-gateway"), "system": boat.system,
        "files": contents, **asdict(settings),
        "effects": len(settings.effects),  # by content, wherever they lie
    }  # fmt: skip
    return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()


class ResultStore:
    """The results of a fleet's folder, and the digests of local files that have not changed."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / RESULTS_FILE
        self._results: dict[tuple[str, str], Analysis] = {}
        self._digests: dict[str, tuple[str, str]] = {}
        for line in _lines(self._file):
            if "stamp" in line:
                self._digests[line["recording"]] = (line["stamp"], line["sha256"])
            else:
                found = Analysis(line["row"], tuple(line["estimates"]))
                self._results[line["sha256"], line["settings"]] = found

    def known_digest(self, recording: str) -> str | None:
        """Of a local file with the size and time of change that it had when it was read."""
        now, content = self._digests.get(recording, (None, None))
        return content if now is not None and now == stamp(recording) else None

    def note_digests(self, digests: Mapping[str, str]) -> None:
        """Keep digests of local files for the next run."""
        for recording, content in digests.items():
            now = stamp(recording)
            if now and content:
                self._append({"recording": recording, "stamp": now, "sha256": content})

    def get(self, content: str, settings: str) -> Analysis | None:
        """What came of this content under these settings; None where it was not run."""
        return self._results.get((content, settings)) if content else None

    def put(self, content: str, settings: str, found: Analysis) -> None:
        """Keep what would be the same another time."""
        if content and found.row["state"] in LASTING:
            self._append({"sha256": content, "settings": settings, **asdict(found)})

    def _append(self, entry: Mapping[str, Any]) -> None:
        """One line more; a line that was cut off before it stays a line of its own."""
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open("ab+") as stream:
                stream.seek(-1, 2) if stream.tell() else None
                cut = stream.read(1) not in (b"", b"\n")
                stream.write(b"\n" * cut + json.dumps(entry).encode() + b"\n")
        except OSError as error:
            raise ShadowError(f"{self._file}: cannot write a result: {error.strerror}") from None


def _lines(file: Path) -> Iterator[dict[str, Any]]:
    """The whole lines of the file; one that was cut off is left out."""
    try:
        lines = file.read_bytes().splitlines()
    except FileNotFoundError:
        return
    except OSError as error:
        raise BadInput(f"{file}: cannot read earlier results: {error.strerror}") from None
    for line in lines:
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if isinstance(entry, dict):
            yield entry
