"""The view of `shadow monitor`: what it holds, and that it fits the terminal."""

import io
import json

import pytest
from rich.console import Console

from gateway.monitor import Latest, VesselStatus, decode
from gateway.terminal.monitor import monitor_view
from gateway.topics import TOPICS
from tests.gateway.monitor.statuses import message, status


def shown(*statuses: VesselStatus, width: int = 80, height: int | None = None) -> str:
    out = Console(file=io.StringIO(), width=width, height=height or 50, color_system=None)
    out.print(monitor_view(statuses, width, height))
    assert isinstance(out.file, io.StringIO)
    return out.file.getvalue()


@pytest.mark.parametrize("width", [80, 120])
def test_the_view_shows_state_residual_errors_health_and_events(width: int) -> None:
    text = shown(
        status(
            measured={"surge_mps": 1.5, "sway_mps": 0.0, "yaw_rate_radps": 0.1, "yaw_rad": -1.5708},
            shadow={"surge_mps": 1.25, "sway_mps": 0.0, "yaw_rate_radps": 0.1},
            residual={"missing_surge_n": -42.5, "missing_surge_n_std": 3.25,
                      "error_surge_mps_10s": -0.77},
            health={"diverging": 0, "unfit": "", "link_age_s": 7.25, "loss": 0.125, "nis": 1.37,
                    "rate_attitude_hz": 31.0},
        ),
        width=width,
    )  # fmt: skip
    words_shown = " ".join(text.replace("│", " ").split())
    for words in (
        "otter", "alive", "50 Hz", "2.92 kn", "heading 270.0°", "boat 1.50 ±0.50", "5.7 ±28.6",
        "shadow 1.25", "boat − shadow 0.25", "error at 10 s -0.77", "missing force -42.5 ±3.2",
        "silent for 7.2 s", "loss 12.5 %", "NIS 1.37", "attitude 31", "event 8", "event 5",
    ):  # fmt: skip
        assert words in words_shown
    assert "event 4" not in words_shown
    assert "…" not in text


@pytest.mark.parametrize("width", [80, 120])
def test_a_shadow_that_diverges_is_not_said_to_be_alive_and_well(width: int) -> None:
    well = shown(status(health={"diverging": 0, "divergences": 3, "unfit": ""}), width=width)
    assert "● alive" in well
    assert "diverged 3" in well
    ill = shown(status(health={"diverging": 1, "divergences": 3, "unfit": ""}), width=width)
    assert "● diverges" in ill
    assert "alive" not in ill


@pytest.mark.parametrize("width", [80, 120])
def test_no_line_is_wider_than_the_terminal_and_one_vessel_fits(width: int) -> None:
    lines = shown(status("a-vessel-with-quite-a-long-name"), width=width).splitlines()
    assert max(len(line) for line in lines) <= width
    assert len(lines) <= 24


def test_many_vessels_get_a_line_each_where_full_views_do_not_fit() -> None:
    fleet = [status(f"boat-{i}") for i in range(5)]
    lines = shown(*fleet, height=24).splitlines()
    assert len(lines) <= 24
    assert sum(line.startswith("boat-") for line in lines) == 5
    assert len(shown(*fleet).splitlines()) > 24


def test_a_vessel_that_is_gone_or_silent_is_shown_so() -> None:
    last = {topic: Latest(message(topic), 12.0) for topic in TOPICS}
    assert "gone" in shown(VesselStatus("otter", False, last, 0.0))
    assert "nothing new for 12 s" in shown(VesselStatus("otter", True, last, 0.0))
    assert "no estimate yet" in shown(VesselStatus("otter", True, {}, 0.0))


def test_data_that_cannot_judge_are_said_to_be_so_and_since_when() -> None:
    why = "the GPS has no 3-D fix since 14:32:05 UTC"
    text = shown(status(health={"diverging": 0, "unfit": why}))
    assert "● cannot judge" in text
    assert f"data: {why}" in text
    well = shown(status(health={"diverging": 0, "unfit": ""}))
    assert "● alive" in well
    assert "data:" not in well


def test_a_silent_boat_is_not_compared_with_its_shadow() -> None:
    text = shown(status(measured={"vehicle_time_ns": 0, "surge_mps": 3.0}))
    (line,) = (line for line in text.splitlines() if "boat − shadow" in line)
    assert "·" in line


@pytest.mark.parametrize("wild", [1e300, -1e300, float("inf"), 1e-300])
def test_absurd_values_stay_in_their_columns(wild: float) -> None:
    fields = [f.name for f in TOPICS["measured"].fields if f.name != "source"]
    changed = dict.fromkeys(fields, wild)
    health = {"receive_time_ns": 2**63 - 1, "nis": wild, "loss": wild}
    text = shown(status(measured=changed, health=health, event={"receive_time_ns": 2**63 - 1}))
    assert max(len(line) for line in text.splitlines()) <= 80


def test_text_of_others_cannot_command_the_terminal() -> None:
    payload = json.dumps(message("event", says="\x1b[2Jgone\n[red]x")).encode()
    event = decode("event", payload)
    assert event is not None
    assert event["says"] == "?[2Jgone?[red]x"
    assert "[red]x" in shown(VesselStatus("o", True, {}, 0.0, (event,), 1))
