"""A folder of recordings, their boats, and a cluster that lives as long as a file of tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster

from gateway.fleet.run import local_cluster
from gateway.vessel_file import dump_vessel
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.sim.vessels import WAMV

FLEET = """
[[vessels]]
name = "heron"
file = "boat.toml"
recordings = ["heron/*", "short.tlog"]

[[vessels]]
name = "otter-1"
file = "otter"
recordings = ["otter_*"]
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Workers in this process: what they do is the same, and they start at once.

    No longer than a file of tests: their loop draws random numbers, which Hypothesis forbids.
    """
    with local_cluster(2, processes=False) as made:
        yield made


@pytest.fixture(scope="session")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of forty seconds."""
    path = tmp_path_factory.mktemp("sailed") / "a.tlog"
    return tlog(path, [*parameters(), *voyage(40.0)]).read_bytes()


@pytest.fixture
def folder(tmp_path: Path, sailed: bytes) -> Path:
    """Two recordings of the heron that differ, a cut one, one of nobody, and the fleet file."""
    logs = tmp_path / "logs"
    (logs / "heron").mkdir(parents=True)
    (logs / "heron" / "monday.tlog").write_bytes(sailed)
    (logs / "heron" / "tuesday.tlog").write_bytes(sailed[: len(sailed) * 9 // 10])
    (logs / "short.tlog").write_bytes(sailed[:500])
    (logs / "stray.tlog").write_bytes(sailed[: len(sailed) * 8 // 10])
    (logs / "notes.txt").write_text("no recording")
    (tmp_path / "boat.toml").write_text(dump_vessel(WAMV), encoding="utf-8")
    (tmp_path / "fleet.toml").write_text(FLEET, encoding="utf-8")
    return tmp_path
