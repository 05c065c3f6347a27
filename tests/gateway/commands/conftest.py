"""A vessel file and a short log."""

from pathlib import Path

import pytest

from gateway.vessel_file import dump_vessel
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.sim.vessels import WAMV


@pytest.fixture
def boat(tmp_path: Path) -> Path:
    path = tmp_path / "boat.toml"
    path.write_text(dump_vessel(WAMV), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of forty seconds with the boat's parameters."""
    path = tmp_path_factory.mktemp("sailed") / "a.tlog"
    return tlog(path, [*parameters(), *voyage(40.0)]).read_bytes()


@pytest.fixture
def log(tmp_path: Path, sailed: bytes) -> Path:
    path = tmp_path / "voyage.tlog"
    path.write_bytes(sailed)
    return path
