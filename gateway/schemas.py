"""JSON Schemas of all topics as files, made from the table of topics.

`python -m gateway.schemas docs/schemas` writes one file per topic; it is what a recording holds
and what every payload on zenoh obeys.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import orjson

from gateway.topics import TOPICS


def schema_files() -> Mapping[str, bytes]:
    """File name -> its text."""
    options = orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE
    return {
        f"{name}.json": orjson.dumps(topic.json_schema(), option=options)
        for name, topic in TOPICS.items()
    }


def write_schemas(folder: Path) -> None:
    """Write all files, and remove those of topics that are no more."""
    files = schema_files()
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.json"):
        if old.name not in files:
            old.unlink()
    for name, text in files.items():
        (folder / name).write_bytes(text)


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1]))
