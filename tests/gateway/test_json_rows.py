"""Every message is strict JSON that its own schema accepts; incomplete ones are withheld."""

import json
import math
from typing import Any

import jsonschema
import numpy as np
import orjson
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gateway.json_rows import Value, encode, encode_rows
from gateway.topics import TOPICS, FieldType

VEHICLE, RECEIVED = 1_700_000_000_123_456_789, 1_700_000_000_200_000_001
COLUMNAR = [name for name, topic in TOPICS.items() if not topic.names(FieldType.INTEGER)]


def sample_row(topic: str) -> dict[str, Value]:
    """A complete message of any topic."""
    values: dict[FieldType, Value] = {FieldType.NUMBER: -0.125, FieldType.INTEGER: 7}
    row: dict[str, Value] = {}
    for field in TOPICS[topic].fields:
        text = field.choices[0] if field.choices else 'said "so" – ünïcode\n'
        row[field.name] = values.get(field.type, text)
    return {"vehicle_time_ns": VEHICLE, "receive_time_ns": RECEIVED, **row}


def strict(payload: bytes) -> dict[str, Any]:
    """Parse JSON, refusing what Python would let pass: NaN and infinities."""

    def refuse(text: str) -> None:
        raise ValueError(f"not JSON: {text}")

    message = json.loads(payload, parse_constant=refuse)
    assert isinstance(message, dict)
    return message


@pytest.mark.parametrize("topic", TOPICS)
def test_a_message_is_accepted_by_its_schema_and_reads_back(topic: str) -> None:
    row = sample_row(topic)
    payload = encode(topic, row)
    assert payload is not None
    jsonschema.validate(strict(payload), TOPICS[topic].json_schema())
    assert strict(payload) == row


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("topic", [name for name in TOPICS if TOPICS[name].names(FieldType.NUMBER)])
def test_a_message_with_a_number_that_is_not_finite_is_withheld(topic: str, bad: float) -> None:
    for name in TOPICS[topic].names(FieldType.NUMBER):
        assert encode(topic, {**sample_row(topic), name: bad}) is None


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"north_m_std": None}, "north_m_std"),
        ({"depth_m": 1.0}, "depth_m"),
        ({"source": "guessed"}, "one of measured, model"),
        ({"receive_time_ns": 1.5}, "an integer"),
    ],
)
def test_misuse_raises(change: dict[str, Any], text: str) -> None:
    row = {k: v for k, v in {**sample_row("measured"), **change}.items() if v is not None}
    with pytest.raises(ValueError, match=text):
        encode("measured", row)


def test_numpy_scalars_are_numbers_too() -> None:
    row = {**sample_row("control"), "surge_n": np.float64(0.1), "vehicle_time_ns": np.int64(5)}
    assert strict(encode("control", row) or b"")["surge_n"] == 0.1


def columns(topic: str, values: list[list[float]]) -> NDArray[np.float64]:
    width = len(TOPICS[topic].names(FieldType.NUMBER))
    return np.array(values, float).reshape(len(values), width)


@pytest.mark.parametrize("topic", COLUMNAR)
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_columns_and_single_messages_give_the_same_bytes(topic: str, data: st.DataObject) -> None:
    entry = TOPICS[topic]
    numbers = entry.names(FieldType.NUMBER)
    one = st.lists(st.floats(width=64), min_size=len(numbers), max_size=len(numbers))
    values = columns(topic, data.draw(st.lists(one, max_size=12)))
    K = len(values)
    times = np.arange(K) + VEHICLE
    strings = {
        field.name: data.draw(
            st.lists(st.sampled_from(field.choices or ("a", 'b"')), min_size=K, max_size=K)
        )
        for field in entry.fields
        if field.type is FieldType.STRING
    }
    rows = encode_rows(topic, times, times - 9, values, strings)
    single = [
        encode(
            topic,
            {
                "vehicle_time_ns": int(times[k]),
                "receive_time_ns": int(times[k]) - 9,
                **dict(zip(numbers, values[k].tolist(), strict=True)),
                **{name: strings[name][k] for name in strings},
            },
        )
        for k in range(K)
    ]
    assert rows.payloads == [payload for payload in single if payload is not None]


def test_numbers_of_any_size_are_written_in_one_way() -> None:
    """The two writers differ from 1e16 on; a recording shows one of them."""
    sizes = [0.0, -0.0, 5e-324, 1e-7, 0.1, 9.9e15, 1e16, -1.5e17, 1e300]
    times = np.arange(len(sizes))
    values = np.zeros((len(sizes), 6))
    values[:, 2] = sizes
    for chosen in (slice(0, 6), slice(None)):
        rows = encode_rows("control", times[chosen], times[chosen], values[chosen])
        assert [p.split(b'"yaw_nm":')[1].split(b",")[0] for p in rows.payloads] == [
            orjson.dumps(size) for size in sizes[chosen]
        ]


def test_times_stay_beside_their_messages_when_rows_are_withheld() -> None:
    values = np.zeros((30, 6))
    values[[1, 3], [0, 5]] = np.nan, np.inf
    rows = encode_rows("control", np.arange(30), np.arange(30) + 10, values)
    assert rows.vehicle_time_ns.tolist() == [0, 2, *range(4, 30)]
    assert [strict(p)["receive_time_ns"] for p in rows.payloads] == rows.receive_time_ns.tolist()


def test_columns_of_the_wrong_width_and_strings_of_the_wrong_length_raise() -> None:
    times = np.arange(2)
    with pytest.raises(ValueError, match=r"expected \(K, 6\)"):
        encode_rows("control", times, times, np.zeros((2, 5)))
    with pytest.raises(ValueError, match="3 strings for 2 rows"):
        encode_rows("measured", times, times, np.zeros((2, 18)), {"source": ["model"] * 3})
    with pytest.raises(ValueError, match="expected \\['source'\\]"):
        encode_rows("measured", times, times, np.zeros((2, 18)))
