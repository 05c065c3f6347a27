"""The table of topics, and the documents made from it, agree."""

import jsonschema
import pytest

from gateway.topics import (
    JUDGING,
    LOOP_TOPICS,
    MODEL_RIGHT,
    RATED,
    TOPICS,
    Field,
    FieldType,
    Overflow,
    Topic,
    markdown,
)
from sim.monitoring.alarm import ModelEvent
from tests.conftest import ROOT

EVERY = {**TOPICS, **LOOP_TOPICS}


def test_the_topics_of_the_design_are_there() -> None:
    assert list(TOPICS) == [
        "measured", "reference", "shadow", "position", "control", "residual", "surroundings",
        "wind", "parameters", "health", "event",
    ]  # fmt: skip


def test_docs_are_current() -> None:
    text = (ROOT / "docs" / "topics.md").read_text("utf-8")
    assert text == markdown(), "run: python -m gateway.topics > docs/topics.md"


@pytest.mark.parametrize("topic", EVERY.values(), ids=list(EVERY))
def test_every_schema_is_a_json_schema(topic: Topic) -> None:
    jsonschema.Draft202012Validator.check_schema(topic.json_schema())


@pytest.mark.parametrize("topic", EVERY.values(), ids=list(EVERY))
def test_field_names_are_unique_and_carry_their_unit(topic: Topic) -> None:
    names = [field.name for field in topic.all_fields]
    assert len(names) == len(set(names))
    endings = {
        "m/s": "mps", "m/s²": "mps2", "rad/s": "radps", "rad/s²": "radps2", "m": "m", "rad": "rad",
        "N": "n", "N m": "nm", "°": "deg", "s": "s", "1/s": "hz", "ns": "ns",
        "V": "v", "µs": "us",
    }  # fmt: skip
    for field in topic.all_fields:
        if field.unit:
            parts = field.name.removesuffix("_std").split("_")
            assert endings[field.unit] in parts, field


def test_topics_of_one_schema_have_the_same_fields() -> None:
    fields = {topic.schema: topic.fields for topic in TOPICS.values()}
    assert all(fields[topic.schema] == topic.fields for topic in TOPICS.values())


def test_a_slow_subscriber_never_holds_up_the_gateway() -> None:
    assert {topic.overflow for topic in TOPICS.values()} == {Overflow.DROP}


def test_no_message_is_counted_in_two_rates() -> None:
    messages = [message for group in RATED.values() for message in group]
    assert len(messages) == len(set(messages))


def test_strings_before_numbers_are_refused() -> None:
    fields = (Field("a", "", "text", FieldType.STRING), Field("b", "", "number"))
    with pytest.raises(ValueError, match="numbers, integers, then strings"):
        Topic("x", "X", "", "", fields)


def test_kinds_of_events_that_judge_the_model_are_those_of_its_alarm() -> None:
    assert {event.value for event in ModelEvent} == JUDGING
    assert ModelEvent.RIGHT.value == MODEL_RIGHT
