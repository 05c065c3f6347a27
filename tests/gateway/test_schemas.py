"""docs/schemas, what recordings hold and what goes over zenoh come from the one table of topics."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader

from gateway.json_rows import TopicRows, encode
from gateway.recording.foxglove import SCHEMAS, schema_text
from gateway.recording.recorder import Recorder
from gateway.topics import LOOP_TOPICS, TOPICS, FieldType, schema_files, write_schemas
from tests.conftest import ROOT

EVERY = {**TOPICS, **LOOP_TOPICS}
FOLDER = ROOT / "docs" / "schemas"
VALUES = {
    FieldType.NUMBER: 0.5,
    FieldType.INTEGER: 1_700_000_000_000_000_000,
    FieldType.STRING: "text",
}


def some_message(topic: str) -> bytes:
    """A message of any topic."""
    row = {f.name: f.choices[0] if f.choices else VALUES[f.type] for f in EVERY[topic].all_fields}
    payload = encode(topic, row)
    assert payload is not None
    return payload


def refuse(text: str) -> None:
    raise ValueError(f"{text} is no JSON")


def without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    assert len(dict(pairs)) == len(pairs), "a member stands twice"
    return dict(pairs)


def strict(text: bytes) -> Any:
    """JSON as the standard has it: no NaN, no member twice."""
    return json.loads(text, parse_constant=refuse, object_pairs_hook=without_repetition)


def refused_by_players(schema: dict[str, Any], name: str = "") -> list[str]:
    """Fields whose schema Lichtblick does not read (parseJsonSchema of its public source).

    An object is said to be one, a field has one type, an array's items too, text no other encoding.
    """
    if schema.get("type") != "object":
        return [name]
    out: list[str] = []
    for field, given in schema["properties"].items():
        one = given["items"] if given.get("type") == "array" else given
        if one.get("type") == "object":
            out += refused_by_players(one, f"{name}.{field}")
        else:
            plain = one.get("type") in ("boolean", "string", "number", "integer")
            if not plain or one.get("contentEncoding", "base64") != "base64":
                out.append(f"{name}.{field}")
    return out


@pytest.mark.parametrize("name", [*(f"topic {t}" for t in EVERY), *SCHEMAS])
def test_players_read_every_schema(name: str) -> None:
    kind, _, topic = name.partition(" ")
    text = (FOLDER / f"{topic}.json").read_bytes() if topic else schema_text(kind)
    schema = strict(text)
    assert refused_by_players(schema) == []
    first = next(iter(schema["properties"]))
    schema["properties"][first] = {"type": ["number", "null"]}
    assert refused_by_players(schema) == [f".{first}"]


def test_the_files_are_current() -> None:
    found = {path.name: path.read_bytes() for path in FOLDER.iterdir()}
    assert found == schema_files(), "run: python -m gateway.topics docs/schemas"


def test_a_topic_that_is_no_more_leaves_no_file(tmp_path: Path) -> None:
    (tmp_path / "former.json").write_text("{}")
    write_schemas(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {f"{topic}.json" for topic in EVERY}


@pytest.mark.parametrize("topic", EVERY)
def test_a_message_obeys_its_file_and_a_changed_one_does_not(topic: str) -> None:
    schema = strict((FOLDER / f"{topic}.json").read_bytes())
    message = strict(some_message(topic))
    jsonschema.validate(message, schema)
    first = EVERY[topic].fields[0].name
    for wrong in ({**message, first: None}, {**message, "more": 1}, {"vehicle_time_ns": 1}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, schema)


def test_every_channel_of_a_recording_reads_as_strict_json_and_obeys_the_files(
    tmp_path: Path,
) -> None:
    at = np.array([10**18])
    with Recorder(tmp_path / "all.mcap", free=lambda _: 10**12) as recorder:
        for topic in EVERY:
            recorder.write_rows(TopicRows(topic, at, at, [some_message(topic)]))
    seen = set()
    with (tmp_path / "all.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            recorded = strict(schema.data)
            jsonschema.validate(strict(message.data), recorded)
            if channel.topic in TOPICS:
                ours = strict((FOLDER / f"{channel.topic}.json").read_bytes())
                assert recorded["properties"] == ours["properties"]
                assert (schema.name, recorded["title"]) == (ours["title"], ours["title"])
            seen.add(channel.topic)
    assert set(TOPICS) < seen
