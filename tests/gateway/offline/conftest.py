"""One diagnosis of two effects, made once for all tests that read it."""

import pytest

from gateway.offline.diagnose import diagnose_logs, save_diagnosis
from gateway.vessel_file import dump_vessel
from tests.gateway.offline.diagnosis import FEW, sailed
from tests.sim.voyages import WAM_V


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("diagnosed")
    (path / "boat.toml").write_text(dump_vessel(WAM_V))
    return path


@pytest.fixture(scope="session")
def trial():
    """Half a knot of current to the east."""
    return sailed(150.0, (0.0, 0.3), 1)


@pytest.fixture(scope="session")
def found(folder, trial):
    """A real diagnosis, of two effects only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gateway.offline.trials.load_trials", lambda *_: [trial])
        return diagnose_logs(["voyage.tlog"], folder / "boat.toml", settings=FEW)


@pytest.fixture(scope="session")
def saved(found, folder):
    save_diagnosis(found, save=folder / "diagnosis.json")
    return folder / "diagnosis.json"


@pytest.fixture
def ready(found, monkeypatch):
    """`shadow diagnose` without the minute of work."""
    asked = {}

    def instead(*given, **options):
        asked.update(options, given=given)
        return found

    monkeypatch.setattr("gateway.offline.diagnose.diagnose_logs", instead)
    return asked
