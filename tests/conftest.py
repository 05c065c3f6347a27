"""Fixtures shared by all tests."""

import gc
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

# each process has a core of its own: threads of BLAS would wait for one another
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parent.parent

# a machine that has other work is no fault: speed is measured in benchmarks/
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")


# numba makes and drops millions of small objects while it compiles, beside a heap of all packages
# that stays: by default the collector walks through both again and again, a tenth of all time
COLLECT_AFTER = 50_000  # new objects


# Files that take longest, from a full run: begun first, so that none of them runs alone at the end.
LONG = (
    "benchmarks/test_blind", "sim/kernel/test_kernel", "gateway/offline/test_replay",
    "sim/effects/test_effects", "gateway/offline/test_diagnose",
    "gateway/simulated_boat/test_replay_of_simulated", "sim/diagnosis/test_evidence",
    "gateway/commands/test_bad_input", "sim/diagnosis/test_diagnose", "benchmarks/test_generator",
    "sim/identification/test_identify", "sim/diagnosis/test_recordings",
    "gateway/pipelines/test_live", "gateway/studio/test_serve", "sim/hil/test_boat",
    "fuzz/test_fuzz",
)  # fmt: skip


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What runs alone is slow too. Long files first; the order in each stays."""
    for item in items:
        if item.get_closest_marker("alone"):
            item.add_marker("slow")
    places = {ROOT / "tests" / f"{name}.py": k for k, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path, len(LONG)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Where a run has to end (CI), the slow tests that come after `SHADOW_SLOW_UNTIL` [Unix s] are
    skipped and counted: on a machine that is slow on a day a part of them is better than none.
    """
    until = float(os.environ.get("SHADOW_SLOW_UNTIL", "inf"))
    if time.time() > until and item.get_closest_marker("slow"):
        pytest.skip("no time is left for slow tests")


def pytest_configure() -> None:
    gc.set_threshold(COLLECT_AFTER, 20, 20)


def pytest_collection_finish() -> None:
    """What is imported by now stays: it is not searched for garbage."""
    gc.freeze()


def pytest_unconfigure() -> None:
    gc.unfreeze()  # at the end of the process all of it goes


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process more than there are cores: tests that wait for a program leave theirs idle."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture(scope="session", autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What commands remember between runs is the tests' own, not the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def plain_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Models in plain Python: for kernels that no other test needs, seconds to compile each."""
    from sim.model import Model
    from tests.sim.simulated import floats_kernel_for

    monkeypatch.setattr(Model.of.__func__, "__defaults__", (floats_kernel_for,))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of third-party logs that is not part of the project; skips where it is absent."""
    folder = Path(os.environ.get("SHADOW_SHARED", ROOT.parent / "shared")) / "data"
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder}: set SHADOW_SHARED to a folder that holds data/")
    return folder
