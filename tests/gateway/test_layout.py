"""The layout for Foxglove and Lichtblick refers only to what a recording holds."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

import orjson
import pytest

from gateway.recording import foxglove
from gateway.topics import TOPICS
from tests.conftest import ROOT

LAYOUT = json.loads((ROOT / "configs" / "foxglove-layout.json").read_text("utf-8"))
PANELS: Mapping[str, Mapping[str, Any]] = LAYOUT["configById"]
SCHEMAS: Mapping[str, Mapping[str, Any]] = {
    **{name: topic.json_schema() for name, topic in TOPICS.items()},
    **{c.topic: orjson.loads(foxglove.schema_text(c.schema)) for c in foxglove.CHANNELS},
}
WELL_KNOWN = {channel.topic: channel.schema for channel in foxglove.CHANNELS}


def of_kind(kind: str) -> list[Mapping[str, Any]]:
    """Panels of one kind; an id is kind!name."""
    return [panel for name, panel in PANELS.items() if name.split("!")[0] == kind]


def topics_of(kind: str) -> Iterator[str]:
    """Topics that panels of a kind name."""
    for panel in of_kind(kind):
        yield from {
            "map": lambda p: [p["followTopic"], *p["topicColors"], *p["disabledTopics"]],
            "3D": lambda p: list(p["topics"]),
            "RosOut": lambda p: [p["topicToRender"]],
        }[kind](panel)


def paths() -> Iterator[str]:
    """Message paths of all plots and state panels: topic.field.field."""
    for panel in PANELS.values():
        yield from (path["value"] for path in panel.get("paths", ()))


def leaf_type(path: str) -> str | None:
    """The JSON type that a message path ends at; None where it leads nowhere."""
    topic, *fields = path.split(".")
    schema: Any = SCHEMAS.get(topic, {})
    for field in fields:
        schema = schema.get("properties", {}).get(field, {})
    return schema.get("type")


def leaves(node: Any) -> Iterator[str]:
    """Panel ids of a tree of splits."""
    if isinstance(node, str):
        yield node
    else:
        assert node["direction"] in ("row", "column")
        assert 0 < node["splitPercentage"] < 100
        yield from leaves(node["first"])
        yield from leaves(node["second"])


@pytest.mark.parametrize("path", list(paths()))
def test_every_path_ends_at_a_field_of_a_topic(path: str) -> None:
    assert leaf_type(path) in ("number", "integer", "string")
    assert path.split(".")[0] in TOPICS


def test_a_path_that_leads_nowhere_is_noticed() -> None:
    assert leaf_type("measured.surge") is None
    assert leaf_type("measure.surge_mps") is None


@pytest.mark.parametrize(
    ("kind", "schemas"),
    [
        ("map", {"foxglove.LocationFix"}),
        ("3D", {"foxglove.PoseInFrame"}),
        ("RosOut", {"foxglove.Log"}),
    ],
)
def test_panels_that_draw_topics_name_those_they_can_draw(kind: str, schemas: set[str]) -> None:
    named = set(topics_of(kind))
    assert named
    assert {WELL_KNOWN[topic] for topic in named} == schemas


def test_map_and_scene_show_boat_and_shadow() -> None:
    assert set(topics_of("map")) == {"foxglove/boat_fix", "foxglove/shadow_fix"}
    assert set(topics_of("3D")) == {"foxglove/boat_pose", "foxglove/shadow_pose"}


def test_frames_are_those_of_the_transforms() -> None:
    row = dict.fromkeys(("north_m", "east_m", "yaw_rad"), 0.0) | {"receive_time_ns": 0}
    moved = [c.convert(row) for c in foxglove.CHANNELS if c.schema == "foxglove.FrameTransform"]
    children = {message["child_frame_id"] for message in moved}
    for scene in of_kind("3D"):
        assert scene["followTf"] in children
        for layer in scene["layers"].values():
            assert layer["frameId"] in children | {foxglove.WORLD}


def test_every_panel_is_shown_once_under_a_title_for_both_programs() -> None:
    assert sorted(leaves(LAYOUT["layout"])) == sorted(PANELS)
    for panel in PANELS.values():
        assert panel["foxglovePanelTitle"] == panel["lichtblickPanelTitle"] != ""


def test_every_plot_draws() -> None:
    plots = of_kind("Plot")
    assert {"measured", "reference", "shadow", "residual"} <= {p.split(".")[0] for p in paths()}
    for plot in plots:
        assert plot["paths"]
        for path in plot["paths"]:
            assert path["enabled"]
            assert path["timestampMethod"] == "receiveTime"
            assert leaf_type(path["value"]) in ("number", "integer")
