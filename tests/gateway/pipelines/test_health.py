"""The health topic counts what came and what is missing, second by second."""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from gateway.estimation import Flag
from gateway.estimation.filter import Estimator, FilterRows
from gateway.ingest.mavlink.log import tlog_from_bytes
from gateway.offline.replay import replay_input_of
from gateway.shadow.health import SECOND, STEADY_S, WINDOW_S, LogHealth
from gateway.shadow.path import ShadowRows
from tests.gateway.pipelines.sailing import RATE_HZ, frames, parameters, voyage

NO_ROWS = ShadowRows.none(0)


def health(raw: list[bytes]) -> dict[int, dict[str, Any]]:
    """Second after the first receipt -> what the topic says then."""
    given = replay_input_of(tlog_from_bytes(b"".join(raw)))
    meter = LogHealth.of(given.log, given.decoded)
    estimator = Estimator()
    _, filtered = estimator.advance(estimator.start(), given.feed.events)
    rows = meter.advance(given.feed.receive_time_ns, filtered, NO_ROWS)
    first = int(given.feed.receive_time_ns[0]) // SECOND
    found = [json.loads(payload) for payload in rows.payloads]
    return {row["receive_time_ns"] // SECOND - first: row for row in found}


def test_rates_are_those_of_the_last_seconds() -> None:
    row = health(frames(voyage(12.0)))[10]
    assert row["rate_attitude_hz"] == RATE_HZ
    assert row["rate_local_position_hz"] == RATE_HZ
    assert row["rate_actuators_hz"] == RATE_HZ
    assert row["rate_heartbeat_hz"] == 1.0
    assert row["rate_gps_hz"] == row["rate_imu_hz"] == row["rate_wind_hz"] == 0.0
    assert row["rate_hz"] == 3.0 * RATE_HZ + 1.0


def test_there_is_one_row_a_second_from_the_end_of_the_first() -> None:
    assert list(health(frames(voyage(6.0)))) == [1, 2, 3, 4, 5]


def test_loss_is_the_share_of_numbers_that_never_came() -> None:
    said = voyage(20.0)
    raw = frames(said)
    kept = [f for k, (f, (t, _)) in enumerate(zip(raw, said, strict=True)) if t < 6.0 or k % 5]
    found = health(kept)
    assert found[5]["loss"] == 0.0
    assert abs(found[18]["loss"] - 0.2) < 0.01
    assert found[18]["rate_attitude_hz"] < 0.9 * RATE_HZ


def test_late_and_repeated_frames_are_not_lost() -> None:
    raw = frames(voyage(12.0))
    for k in range(100, len(raw) - 10, 40):
        # stamps stay in order: the frames change their places
        (a, b) = raw[k], raw[k + 1]
        raw[k], raw[k + 1] = a[:8] + b[8:], b[:8] + a[8:]
    doubled = [f for k, f in enumerate(raw) for _ in range(2 if k % 50 == 0 else 1)]
    assert {row["loss"] for row in health(doubled).values()} == {0.0}


def test_messages_without_a_definition_are_not_lost() -> None:
    raw = frames(voyage(12.0))
    number = (400_000).to_bytes(3, "little")
    for k in range(20, len(raw), 7):
        raw[k] = raw[k][:15] + number + raw[k][18:]
    assert {row["loss"] for row in health(raw).values()} == {0.0}


def test_a_burst_that_is_lost_counts_whole() -> None:
    said = voyage(12.0)
    raw = frames(said)
    kept = raw[:400] + raw[440:]
    at = int(said[440][0])
    row = health(kept)[at + 2]
    heard = row["rate_hz"] * WINDOW_S
    assert abs(row["loss"] - 40.0 / (40.0 + heard)) < 1e-12


def test_other_voices_on_the_link_are_not_the_boats() -> None:
    raw = frames(voyage(12.0))
    other = frames([(t, m) for t, m in voyage(12.0) if m.get_type() == "ATTITUDE"], system=9)
    alone, both = health(raw), health(sorted([*raw, *other], key=lambda frame: frame[:8]))
    assert both[8]["rate_attitude_hz"] == alone[8]["rate_attitude_hz"]
    assert both[8]["loss"] == 0.0


def test_everything_that_the_boat_says_counts_as_life() -> None:
    quiet = health(frames(voyage(12.0)))[8]
    said = sorted([*voyage(12.0), *((7.97, m) for _, m in parameters())], key=lambda s: s[0])
    row = health(frames(said))[8]
    assert row["link_age_s"] < quiet["link_age_s"] <= 0.05
    assert row["rate_hz"] == quiet["rate_hz"] + len(parameters()) / WINDOW_S


def rows_of(nis: list[float], flags: int = 0) -> FilterRows:
    """What the filter says, made up."""
    count = len(nis)
    return FilterRows(
        np.zeros(count), np.zeros((count, 9)), np.zeros((count, 9)), np.zeros((count, 0, 0)),
        np.array(nis), np.ones(count, np.int8), np.full(count, flags, np.uint8),
        np.zeros(count, np.int64),
    )  # fmt: skip


def told(receive_s: list[float], cuts: list[int], **more: Any) -> list[dict[str, Any]]:
    """Rows of a made-up second-hand, cut into chunks."""
    times = np.array([round(t * SECOND) for t in receive_s], np.int64)
    stamps = np.stack([times, times - 7 * SECOND], axis=1)
    meter = LogHealth({"ATTITUDE": np.sort(times)}, np.zeros(0, np.int64), np.sort(stamps, axis=0))
    payloads: list[bytes] = []
    for chunk in np.split(np.arange(len(times)), cuts):
        nis = [float(k + 1) for k in chunk]
        payloads += meter.advance(times[chunk], rows_of(nis, **more), NO_ROWS).payloads
    return [json.loads(payload) for payload in payloads]


def test_the_innovations_of_each_second_are_averaged() -> None:
    found = told([10.0, 10.5, 11.0, 11.9, 12.0], [])
    assert [row["nis"] for row in found] == [1.5, 3.5]


def test_what_the_filter_refused_is_counted_from_the_start() -> None:
    found = told([10.0, 10.5, 11.0, 12.0], [], flags=int(Flag.GATED | Flag.REFUSED))
    assert [row["gated"] for row in found] == [2, 3]
    assert [row["late"] for row in found] == [2, 3]


def test_a_shadow_that_diverged_is_counted_and_said_for_a_minute() -> None:
    none = ShadowRows.none(0)
    seconds = np.arange(100)
    times, meter = (seconds + 10) * SECOND, LogHealth({}, none.row, np.zeros((0, 2), np.int64))
    twice = replace(none, row=seconds, diverged=(seconds == 20) | (seconds == 22))
    found = [json.loads(p) for p in meter.advance(times, rows_of([0.0] * 100), twice).payloads]
    by_second = {row["receive_time_ns"] // SECOND - 10: row for row in found}
    assert [by_second[k]["divergences"] for k in (20, 21, 22, 23, 99)] == [0, 1, 1, 2, 2]
    last = 22 + int(STEADY_S)
    assert [by_second[k]["diverging"] for k in (20, 21, last - 1, last)] == [0, 1, 1, 0]


def test_the_clocks_are_apart_by_the_least_delay() -> None:
    assert {row["clock_offset_s"] for row in told([10.0, 11.0, 12.0], [])} == {7.0}


def test_receipts_out_of_order_change_nothing_with_the_chunks() -> None:
    times = [10.2, 11.1, 10.9, 11.4, 12.3, 11.9, 12.5, 14.0]
    whole = told(times, [])
    assert [row["receive_time_ns"] // SECOND for row in whole] == [11, 12, 14]
    for cut in range(1, len(times)):
        assert told(times, [cut]) == whole


def test_a_receivers_clock_set_back_does_not_silence_it() -> None:
    times = [5000.0 + 0.5 * k for k in range(6)] + [1000.0 + 0.5 * k for k in range(6)]
    seconds = [row["receive_time_ns"] // SECOND for row in told(times, [])]
    assert seconds == [5001, 5002, 1001, 1002]
