"""A short voyage in rows and frames, and writing it down: what recorder and reader tests share."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gateway.json_rows import TopicRows, encode, encode_rows
from gateway.recording.recorder import Attachment, Recorder, RecordingSettings, TopicsKept
from gateway.topics import TOPICS, FieldType

START = 1_700_000_000_000_000_000
STEP = 20_000_000
LATE = 7_000_000  # receipt after the boat's time
VESSEL = Attachment("vessel.toml", "application/toml", b'name = "otter"\n')
WHOLE = RecordingSettings(topics=TopicsKept.ALL)
METADATA = {"shadow": {"gateway": "0.1.0", "vessel": "otter"}}


def times(rows: int, first: int = 0) -> np.ndarray[Any, np.dtype[np.int64]]:
    """The boat's time of each row: (rows,) [ns]."""
    return START + (first + np.arange(rows)) * STEP


def rows_of(topic: str, rows: int, first: int = 0) -> TopicRows:
    """Some messages of a topic without integers."""
    width = len(TOPICS[topic].names(FieldType.NUMBER))
    values = np.random.default_rng(first).normal(size=(rows, width))
    strings = dict.fromkeys(TOPICS[topic].names(FieldType.STRING), "measured")
    vehicle = times(rows, first)
    return encode_rows(topic, vehicle, vehicle + LATE, values, strings)


def event(severity: str = "warning") -> TopicRows:
    """One event."""
    row = {"kind": "test", "severity": severity, "says": "something happened"}
    stamp = {"vehicle_time_ns": START, "receive_time_ns": START + LATE}
    payload = encode("event", {**stamp, **row})
    assert payload is not None
    return TopicRows("event", np.array([START]), np.array([START + LATE]), [payload])


def frames_of(count: int, seed: int = 0) -> list[bytes]:
    """Bytes that stand for frames, of many lengths."""
    rng = np.random.default_rng(seed)
    return [rng.bytes(int(length)) for length in rng.integers(8, 300, count)]


def record(path: Path, rows: int = 100, **options: Any) -> tuple[Path, ...]:
    """Record a voyage of some rows -> the files."""
    settings = replace(options.pop("settings", WHOLE), topics=TopicsKept.ALL)
    given = {"attachments": [VESSEL], "metadata": METADATA, "settings": settings, **options}
    with Recorder(path, free=lambda _: 10**12, **given) as recorder:
        for topic in ("measured", "shadow", "position", "control"):
            recorder.write_rows(rows_of(topic, rows))
        recorder.write_rows(event())
        recorder.write_raw(frames_of(rows), times(rows) + LATE, times(rows), link="udpin:a")
    return recorder.paths
