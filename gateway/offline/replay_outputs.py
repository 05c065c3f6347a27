"""What a replay writes: frames and topics, to a recording and to zenoh."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.bus import Bus
from gateway.config import Settings
from gateway.json_rows import TopicRows
from gateway.recording.file import Attachment
from gateway.recording.recorder import Recorder
from gateway.shadow.path import Shadowing


class LinkFrames(NamedTuple):
    """Raw frames of one link, with their receive times."""

    link: str
    frames: list[bytes]
    receive_time_ns: Sequence[int] | NDArray[np.int64]


class ReplayStep(NamedTuple):
    """Rows of the path and messages that some inputs led to; `raw` makes the inputs' frames."""

    outs: list[Shadowing]
    rows: list[TopicRows]
    raw: Callable[[], LinkFrames]


@dataclass(frozen=True)
class ReplayOutputs:
    """Recorder and bus, either of which may be absent."""

    recorder: Recorder | None
    bus: Bus | None

    def write(self, step: ReplayStep) -> None:
        """Raw frames first: they were received before what follows from them."""
        if self.recorder is not None:
            raw = step.raw()
            self.recorder.write_raw(raw.frames, raw.receive_time_ns, link=raw.link)
        for part in step.rows:
            if self.recorder is not None:
                self.recorder.write_rows(*part)
            if self.bus is not None and part.payloads:
                wanted = part.payloads if self.bus.wants(part.topic) else part.payloads[-1:]
                for payload in wanted:
                    self.bus.publish(part.topic, payload)

    @property
    def files(self) -> tuple[Path, ...]:
        """The recordings that were written."""
        return self.recorder.paths if self.recorder is not None else ()


def open_outputs(
    scope: ExitStack,
    name: str,
    file: Path | None,
    attachments: Sequence[Attachment],
    metadata: dict[str, dict[str, str]],
    settings: Settings,
) -> ReplayOutputs:
    """Open what the settings ask for until `scope` closes; `file` None: no recording.

    The first attachment is the vessel file, which the bus offers as the model.
    """
    recorder = bus = None
    if file is not None:
        recorder = scope.enter_context(
            Recorder(file, attachments=attachments, metadata=metadata, settings=settings.recording)
        )
    if settings.zenoh.publish:
        model = attachments[0].data
        bus = scope.enter_context(Bus(name, model=model, settings=settings.zenoh.bus()))
    return ReplayOutputs(recorder, bus)
