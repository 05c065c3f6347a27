"""What is fuzzed: each parser with specimens of a few kilobytes, and what is done with a mutant.

A target does what the command line would do with such a file, as far as it reads it. It may raise
what the command line turns into one line; anything else is a fault.
"""

import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.config import load_settings, recorded_settings
from gateway.errors import NUMERICAL_ERRORS, ShadowError
from gateway.hil import Notices, Played, Session
from gateway.hil.ahrs import AhrsSession, sentence
from gateway.hil.ardupilot_json import JsonSession
from gateway.hil.day_file import load_day
from gateway.hil.px4 import Px4Session
from gateway.ingest.log import boats_of
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from gateway.links import Arrival, Datagram, EventReporter, Inbox, LinkCounts
from gateway.links.frame_reader import FrameReader, Peers
from gateway.live.boats import BoatPlan, Fleet
from gateway.monitor import decode
from gateway.offline.add import read_diagnosis
from gateway.offline.export import ExportFormat, ExportOptions, export, export_files
from gateway.offline.simulate import read_commands
from gateway.offline.trials import TrialOptions, trials_of
from gateway.recording.origin_gate import allowed, origin_of
from gateway.studio import ranges_in
from gateway.topics import TOPICS
from gateway.vessel_file import dump_vessel, load_vessel
from sim.effects.effect import LawError
from sim.hil.boat import Boat
from sim.hil.day import Day
from tests.conftest import ROOT
from tests.gateway.ingest.blueos_writer import write_blueos
from tests.gateway.ingest.dataflash_writer import voyage_log
from tests.gateway.ingest.ulog_writer import as_ulog
from tests.gateway.pipelines.aboard import SETTINGS
from tests.gateway.pipelines.sailing import frames, parameters, tlog, voyage
from tests.sim.vessels import IACQUABOT, WAMV

SECONDS = 8.0  # of the voyages in the specimens
TRIALS = TrialOptions(motion_only=True, anyway=True)


@dataclass(frozen=True)
class Target:
    """One parser.

    corpus  makes the specimens
    read    does with some bytes what a user would have done with them
    text    the specimens are texts
    """

    name: str
    corpus: Callable[[], Sequence[bytes]]
    read: Callable[[bytes], None]
    text: bool = False


def is_fault(error: BaseException) -> bool:
    """Would the command line call it a fault of the program?"""
    if isinstance(error, (ShadowError, LawError, OSError, *NUMERICAL_ERRORS)):
        return False
    return not (isinstance(error, ValueError) and type(error).__module__.startswith("sim."))


@contextmanager
def file_with(data: bytes, name: str) -> Iterator[Path]:
    """A file of that name, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        yield path


def _log_reader(name: str, *beside: tuple[str, bytes]) -> Callable[[bytes], None]:
    """What `info`, `compare` and `export` read of a log."""

    def read(data: bytes) -> None:
        with file_with(data, name) as path:
            for other, content in beside:
                path.with_name(other).write_bytes(content)
            if path.suffix == ".mcap":
                recorded_settings(path)
            log = open_log(path)
            survey(log)
            for boat in boats_of(log)[:2]:
                log.parameters(boat)
                trials_of(log, TrialOptions(motion_only=True, anyway=True, system=boat.system))

    return read


def _file_reader(name: str, read: Callable[[Path], Any]) -> Callable[[bytes], None]:
    def read_bytes(data: bytes) -> None:
        with file_with(data, name) as path:
            read(path)

    return read_bytes


@cache
def _tlogs() -> list[bytes]:
    with file_with(b"", "a.tlog") as path:
        whole = tlog(path, [*parameters(), *voyage(SECONDS)]).read_bytes()
        other = tlog(path, voyage(SECONDS, vessel=IACQUABOT), 7).read_bytes()
    return [whole, other]


def _exported(to: str) -> bytes:
    with file_with(_tlogs()[0], "a.tlog") as path:
        options = ExportOptions(ExportFormat(to))
        files = export_files(path, path.with_name(f"b.{to}"), options)
        export(path, files, options)
        return files[0].read_bytes()


@cache
def _mcaps() -> list[bytes]:
    with file_with(_tlogs()[0], "a.tlog") as path:
        log = open_log(path)
        assert isinstance(log, MavlinkLog)
        blueos = [
            write_blueos(path.with_name(f"{k}.mcap"), log, flags, cut).read_bytes()
            for k, (flags, cut) in enumerate([("names", False), ("bits", True)])
        ]
    return [_exported("mcap"), *blueos]


def _ulog() -> list[bytes]:
    with file_with(_tlogs()[0], "a.tlog") as path:
        return [as_ulog(path).bytes()]


TABLE_MAPPING = b"""
time = { column = "time", unit = "s" }
[columns]
yaw = { column = "yaw", unit = "deg" }
surge = { column = "u", unit = "m/s" }
sway = { column = "v", unit = "m/s" }
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
channel_1 = { column = "left", unit = "us" }
"""


def _table() -> list[bytes]:
    time = np.arange(0.0, SECONDS, 0.1)
    rows = [f"{t:.1f},{10 * np.sin(t):.3f},1.0,0.1,63.4{k:04d},10.4{k:04d},{1500 + k}"
            for k, t in enumerate(time.tolist())]  # fmt: skip
    return ["\n".join(["time,yaw,u,v,lat,lon,left", *rows, ""]).encode()]


def _vessels() -> list[bytes]:
    shipped = [file.read_bytes() for file in sorted((ROOT / "configs/vessels").glob("*.toml"))]
    return [*shipped, dump_vessel(WAMV).encode()]


def _days() -> list[bytes]:
    return [file.read_bytes() for file in sorted((ROOT / "configs/days").glob("*.toml"))]


CONFIG = b"""[links]
endpoints = ["udpin:127.0.0.1:14550"]
[zenoh]
publish = false
endpoint = "tcp/127.0.0.1:7447"
[foxglove]
address = "8765"
origins = ["https://example.org"]
[following]
rate_hz = 50.0
[recording]
rotate_seconds = 10.0
"""
DIAGNOSIS = b"""{"vessel": "boat.toml", "effects": ["current"], "version": "0.2.0",
 "ladder": [
  {"effects": [], "base": "as given", "heldout_nrmse": 1.0},
  {"effects": ["current"], "base": "fitted", "heldout_nrmse": 0.5,
   "parameters": {"current": {"speed": {"value": 0.3, "ci95": [0.2, 0.4], "unit": "m/s"}}}}],
 "formula": {"form": "line", "text": "a x", "numbers": {"a": 1.0}, "table": {"x0": 0.5}},
 "recordings": [{"name": "a", "date": "2026-05-01"}]}"""


def _datagram(data: bytes) -> None:
    """Bytes of a link, in pieces as long as a datagram, through the reader and to the boats."""
    inbox, counts, fleet = Inbox(), LinkCounts(), Fleet([BoatPlan(WAMV)], SETTINGS)
    reader = FrameReader(counts, Peers(), None, EventReporter("fuzz", inbox))
    for k, start in enumerate(range(0, len(data), 280)):
        now_ns = 1_700_000_000_000_000_000 + k * 20_000_000
        got = reader.read(Arrival(data[start : start + 280], ("10.0.0.1", 1), now_ns))
        for _ in fleet.datagrams([Datagram("fuzz", now_ns, got)]):
            pass
    for boat in fleet.boats.values():
        boat.status(now_ns, 0, 0)


def _datagrams() -> list[bytes]:
    return [b"".join(frames(voyage(4.0)))]


class _Outputs:
    """The servo outputs of a board that drives ahead."""

    def pulses(self) -> dict[int, float]:
        return {1: 1700.0, 3: 1700.0}


@cache
def _hull() -> Boat:
    return Boat.of(load_vessel("otter"), Day())


def _board(played: Played) -> AhrsSession:
    return AhrsSession(played, cast(Any, _Outputs()))


PROTOCOLS: tuple[tuple[Callable[[Played], Session], tuple[int, ...]], ...] = (
    (JsonSession, (40, 72)), (Px4Session, (61,)), (_board, (25,)),
)  # fmt: skip


def _autopilot(data: bytes) -> None:
    """Bytes of an autopilot to every protocol of the loop: nothing may end it."""
    for protocol, sizes in PROTOCOLS:
        session = protocol(Played("fuzz", _hull(), Notices("fuzz", lambda line: None)))
        at, now, peer = 0, 0.0, ("127.0.0.1", 1)
        while at < len(data):
            size = sizes[round(now / 0.02) % len(sizes)]
            try:
                answers = session.received(data[at : at + size], peer, now)
                answers += session.due(now, (peer,))
            except (ShadowError, *NUMERICAL_ERRORS) as error:
                raise AssertionError(f"it ends the loop: {error}") from error
            if not all(answers) or session.wait_s(now) < 0.0:
                raise AssertionError("an answer that is empty, or a wait that is over")
            at, now = at + size, now + 0.02


def _autopilots() -> list[bytes]:
    packets = [struct.pack("<HHI16H", 18458, 400, k, *[1500 + 20 * k] * 16) for k in range(12)]
    wide = [struct.pack("<HHI32H", 29569, 400, 12, *[1700] * 32)]
    firmware = mavlink.MAVLink(None, 1, 1)
    controls = [
        mavlink.MAVLink_hil_actuator_controls_message(k, [0.1 * k] * 16, 129, 1).pack(firmware)
        for k in range(8)
    ]
    asked = ["VNASY,0", "VNWRG,75,3,16,01,0721", "VNWRG,76,3,16,31,0001,0106,0613", "VNASY,1"]
    return [
        b"".join(packets + wide), b"".join(controls), b"".join(map(sentence, asked)) * 3,
    ]  # fmt: skip


def _payload(data: bytes) -> None:
    """A payload from zenoh, under every topic, as `shadow monitor` reads it."""
    for topic in TOPICS:
        decode(topic, data)


def _payloads() -> list[bytes]:
    fields = {name: 1.0 for topic in TOPICS.values() for name in (f.name for f in topic.all_fields)}
    return [repr(fields).replace("'", '"').encode(), b'{"says": "a", "kind": "b"}']


def _request(data: bytes) -> None:
    """The head of a request to a socket for pages, and a query of the studio."""
    allowed(origin_of(data), ())
    ranges_in(data.decode("latin-1"))


TARGETS = (
    Target("tlog", _tlogs, _log_reader("a.tlog")),
    Target("BIN", lambda: [voyage_log(year, SECONDS) for year in (2014, 2015, 2025)],
           _log_reader("a.BIN")),
    Target("mcap", _mcaps, _log_reader("a.mcap")),
    Target("csv", _table, _log_reader("a.csv", ("a.toml", TABLE_MAPPING)), text=True),
    Target("mapping", lambda: [TABLE_MAPPING], lambda data: _log_reader(
        "a.csv", ("a.toml", data))(_table()[0]), text=True),
    Target("parquet", lambda: [_exported("parquet")], _log_reader("a.parquet")),
    Target("ulg", _ulog, _log_reader("a.ulg")),
    Target("vessel", _vessels, _file_reader("boat.toml", load_vessel), text=True),
    Target("config", lambda: [CONFIG], _file_reader("gateway.toml", load_settings), text=True),
    Target("day", _days, _file_reader("day.toml", load_day), text=True),
    Target("diagnosis", lambda: [DIAGNOSIS], _file_reader("d.json", read_diagnosis), text=True),
    Target("commands", lambda: [b"time,left,right\n0,0,0\n1,0.5,-1\n2,0,0\n"],
           _file_reader("c.csv", lambda path: read_commands(path, WAMV)), text=True),
    Target("datagrams", _datagrams, _datagram),
    Target("autopilots", _autopilots, _autopilot),
    Target("zenoh", _payloads, _payload, text=True),
    Target("http", lambda: [b"GET /?t=1.0:2.0 HTTP/1.1\r\nHost: localhost:5006\r\n"
                            b"Origin: https://app.foxglove.dev\r\n\r\n", b"12.0:15.5,20.0:31.0"],
           _request, text=True),
)  # fmt: skip
