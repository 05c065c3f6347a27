"""The view of `shadow monitor`: what it holds, and that it fits the terminal."""

import io
import json
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from gateway.monitor import Judged, Latest, VesselStatus, decode
from gateway.terminal.monitor import monitor_view
from gateway.topics import TOPICS
from tests.gateway.monitor.statuses import SECOND, message, status


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
        height=24,
    )  # fmt: skip
    words_shown = " ".join(text.replace("│", " ").split())
    for words in (
        "otter", "alive", "50 Hz", "2.92 kn", "heading 270.0°", "boat 1.50 ±0.50", "5.7 ±28.6",
        "shadow 1.25", "boat − shadow 0.25", "error at 10 s -0.77", "missing force -42.5 ±3.2",
        "silent for 7.2 s", "loss 12.5 %", "NIS 1.37", "attitude 31", "event 8", "event 7",
    ):  # fmt: skip
        assert words in words_shown
    assert "…" not in text


@pytest.mark.parametrize("width", [80, 120])
def test_a_shadow_that_diverges_is_not_said_to_be_alive_and_well(width: int) -> None:
    fit = {"diverging": 0, "divergences": 3, "unfit": ""}
    well = shown(status(health=fit, surroundings={"misfit": 0.5}), width=width)
    assert "● alive" in well
    assert "diverged 3" in well
    ill = shown(status(health={"diverging": 1, "divergences": 3, "unfit": ""}), width=width)
    assert "● diverges" in ill
    assert "alive" not in ill


@pytest.mark.parametrize("width", [80, 120])
def test_no_line_is_wider_than_the_terminal_and_one_vessel_fits(width: int) -> None:
    lines = shown(status("a-vessel-with-quite-a-long-name"), width=width, height=24).splitlines()
    assert max(len(line) for line in lines) <= width
    assert len(lines) <= 24


def test_many_vessels_get_a_line_each_where_full_views_do_not_fit() -> None:
    fleet = [status(f"boat-{i}") for i in range(5)]
    lines = shown(*fleet, height=24).splitlines()
    assert len(lines) <= 24
    assert sum(line.startswith("boat-") and "●" in line for line in lines) == 5
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
    assert f"cannot judge: {why}" in text
    well = shown(status(health={"diverging": 0, "unfit": ""}))
    assert "● alive" in well
    assert "cannot judge" not in well


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


FIT = {"diverging": 0, "unfit": ""}
BEGAN = "since 14:32:05 UTC the model is wrong when heading west (after 5 s off by 0.46 m/s ahead, "
CAUSE = "noise explains 0.039): looks like thruster left giving 45 % less thrust"
STEADY = {"misfit": 0.5, "explains": "none"}


def event(second: int, kind: str, says: str, severity: str = "info") -> dict[str, Any]:
    return message(
        "event", kind=kind, says=says, severity=severity, receive_time_ns=second * SECOND
    )


def watched(
    *events: dict[str, Any],
    judged: dict[str, Any] | None = None,
    name: str = "otter",
    **topics: Any,
) -> VesselStatus:
    """A vessel whose data are fit, of which these events were heard."""
    changed = {"health": FIT, "surroundings": STEADY, **topics}
    known = None if judged is None else Judged(judged)
    return replace(status(name, **changed), events=events, judged=known)


def words_of(text: str) -> str:
    """What is shown, however it is broken into lines."""
    return " ".join(text.replace("│", " ").split())


WRONG = event(10, "model_explained", BEGAN + CAUSE, "warning")
REQUESTS = [
    event(20 + k, "rate_request", f"system 1: MESSAGE_{k} at {k} Hz: no answer") for k in range(9)
]


@pytest.mark.parametrize("height", [24, 50])
def test_that_the_model_is_wrong_stands_there_with_its_cause_whatever_came_since(
    height: int,
) -> None:
    text = shown(watched(WRONG, *REQUESTS, judged=WRONG), height=height)
    assert words_of(text).count(BEGAN + CAUSE) == 1
    assert "● model wrong" in text
    assert "alive" not in text
    assert len(text.splitlines()) <= height
    assert max(len(line) for line in text.splitlines()) <= 80


def test_a_model_that_is_right_again_is_said_to_be_so() -> None:
    says = "the model is right again; it was wrong since 14:32:05 UTC"
    text = shown(watched(WRONG, judged=event(30, "model_right", says)), height=24)
    assert "● alive" in text
    assert says in text


@pytest.mark.parametrize(
    ("misfit", "explains", "says"),
    [
        (0.5, "none", "the model looks right (misfit 0.5; above 3 is wrong, below 1.5 right)"),
        (2.0, "none", "right or wrong was not heard yet (misfit 2.0;"),
        (5.0, "thrust", "the model looks wrong (misfit 5.0; above 3 is wrong, below 1.5 right)"),
    ],
)
def test_a_monitor_that_heard_no_event_says_what_surroundings_tell(
    misfit: float, explains: str, says: str
) -> None:
    known = {"misfit": misfit, "explains": explains}
    text = shown(watched(surroundings=known), height=24)
    assert says in words_of(text)
    assert ("● model wrong" in text) is (misfit > 3)
    if explains == "thrust":
        assert "as of a thruster" in words_of(text)


def test_a_gateway_that_never_called_its_model_wrong_says_that_it_is_right() -> None:
    quiet = replace(watched(), judged=Judged())
    assert "the model is right so far (misfit 0.5)" in shown(quiet, height=24)
    swell = replace(watched(surroundings={"misfit": 4.0, "explains": "none"}), judged=Judged())
    assert "the model is not found wrong so far (misfit 4.0)" in shown(swell, height=24)
    unseen = {topic: one for topic, one in quiet.latest.items() if topic != "surroundings"}
    assert "not judged yet" in shown(replace(quiet, latest=unseen), height=24)


def test_what_was_wrong_before_the_data_failed_stays() -> None:
    unfit = {"diverging": 0, "unfit": "the GPS has no 3-D fix since 14:33:05 UTC"}
    text = words_of(shown(watched(judged=WRONG, health=unfit), height=24))
    assert "● cannot judge" in text
    assert f"before: {BEGAN}{CAUSE}" in text
    old = watched(judged=WRONG)
    latest = {**old.latest, "surroundings": Latest(message("surroundings"), 23.0)}
    assert "not judged for 23 s" in shown(replace(old, latest=latest), height=24)
    silent = Latest({**message("health"), **FIT, "link_age_s": 23.0}, 0.1)
    text = shown(replace(old, latest={**latest, "health": silent}), height=24)
    assert "not judged for 23 s: nothing is heard of the boat" in text


def test_events_of_the_model_and_the_sensors_go_before_answers_to_requests() -> None:
    failed = event(12, "sensor_failed", "the GPS has no 3-D fix", "warning")
    text = shown(watched(WRONG, failed, *REQUESTS), height=24)
    assert BEGAN + CAUSE in words_of(text)
    assert text.index("looks like") < text.index("the GPS has no 3-D fix")
    old = [event(k, "sensor_failed", f"failure {k}", "warning") for k in range(9)]
    full = event(40, "recording_failed", "the disk is full", "error")
    assert "the disk is full" in shown(watched(*old, full, *REQUESTS), height=24)
    tall = shown(watched(WRONG, failed, *REQUESTS), height=50)
    assert all(f"MESSAGE_{k}" in tall for k in range(9))


@pytest.mark.parametrize("height", [24, 50])
def test_of_two_boats_both_judgements_are_whole(height: int) -> None:
    boats = [watched(WRONG, *REQUESTS, judged=WRONG, name=n) for n in ("lively", "heavy")]
    text = shown(*boats, height=height)
    assert words_of(text).count(CAUSE) == 2
    assert len(text.splitlines()) <= height
    if height == 24:
        assert text.count("● wrong") == 2


def test_where_not_all_judgements_fit_that_is_said() -> None:
    boats = [watched(WRONG, *REQUESTS, judged=WRONG, name=f"boat-{i}") for i in range(12)]
    lines = shown(*boats, height=24).splitlines()
    assert len(lines) <= 24
    assert sum("● wrong" in line for line in lines) == 12
    assert "and 9 more: `shadow monitor NAME` shows one" in lines
    assert sum("less" in line for line in lines) == 3


def test_a_large_deviation_does_not_run_into_its_unit() -> None:
    large = {"missing_yaw_nm": 89.1, "missing_yaw_nm_std": 685.2}
    text = shown(watched(residual=large), height=24)
    assert "89.1 ±685   N, N m" in text
    many = {"missing_yaw_nm": -123456.7, "missing_yaw_nm_std": 98765.4}
    assert "-123456.7 ±98765 N, N m" in shown(watched(residual=many), height=24)
