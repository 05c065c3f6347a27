"""Makes the recordings again, bit for bit.

    python -m recordings.make [--into FOLDER] [--otter otter_calm.tlog]

The voyages come from the generator (`benchmarks.hidden`) by the recipes in answers.json. The piece
of the Otter's log is cut from the whole log where that is at hand; its frames are not touched.
"""

import argparse
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.talk import MODEST
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage

HERE = Path(__file__).resolve().parent
VESSEL = HERE.parent / "configs" / "vessels" / "demo_boat.toml"
OTTER = "otter_piece.tlog"
FIRST_BOOT_MS, LAST_BOOT_MS = 125_384, 265_384  # 75 s and 215 s after arming
ATTITUDE = 30
PREFACE = (22, 49, 148, 242, 253)  # parameters, origin, version, home, texts: kept from the start


def recipes() -> dict[str, Any]:
    """File name -> boat, pilot, seed, seconds and what is hidden."""
    answers: dict[str, Any] = json.loads((HERE / "answers.json").read_text(encoding="utf-8"))
    return answers


def make_voyage(name: str, into: Path) -> Path:
    """Write one voyage by its recipe."""
    recipe = recipes()[name]
    hidden = [Hidden(cause, values) for cause, values in recipe["hidden"].items()]
    boat, file = BOATS[recipe["boat"]], into / name
    write_voyage(file, boat, hidden, recipe["pilot"], recipe["seed"], recipe["seconds"], MODEST)
    return file


def cut_otter(whole: Path, into: Path) -> Path:
    """Write a piece of the Otter's log: its frames as they are, and the log's PREFACE messages."""
    data, pieces, inside = whole.read_bytes(), [], False
    for start, end, message in frames(data):
        if message == ATTITUDE:
            boot_ms = int.from_bytes(data[start + 18 : start + 22], "little")
            inside = FIRST_BOOT_MS <= boot_ms < LAST_BOOT_MS
            if boot_ms >= LAST_BOOT_MS:
                break
        if inside or message in PREFACE:
            pieces.append(data[start:end])
    file = into / OTTER
    file.write_bytes(b"".join(pieces))
    return file


def frames(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Start and end of each record (8 bytes of time, one MAVLink 2 frame), and its message id."""
    at = 0
    while at < len(data):
        length = 8 + 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        yield at, at + length, int.from_bytes(data[at + 15 : at + 18], "little")
        at += length


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m recordings.make", description=__doc__)
    parser.add_argument("--into", type=Path, default=HERE, help="folder to write to")
    parser.add_argument("--otter", type=Path, help="the whole log, to cut the piece from")
    a = parser.parse_args()
    a.into.mkdir(parents=True, exist_ok=True)
    files = [make_voyage(name, a.into) for name in recipes()]
    if a.otter:
        files.append(cut_otter(a.otter, a.into))
    if a.into == HERE:
        VESSEL.write_text(vessel_toml(BOATS["grebe"]), encoding="utf-8")
    for file in files:
        print(hashlib.sha256(file.read_bytes()).hexdigest(), file.stat().st_size, file.name)


if __name__ == "__main__":
    main()
