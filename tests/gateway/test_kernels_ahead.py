"""Kernels that another process compiles: they are those that are needed, and it ends with us."""

import threading
import time

import pytest

from gateway import kernels_ahead as ahead
from sim.diagnosis.fit_problem import SupersetModel, kernels_of_a_diagnosis
from sim.effects.catalogue import EFFECTS, named
from sim.kernel import cache
from sim.kernel.cache import compile_entries, is_kept, kernel_for
from sim.model import Model, structure_of
from tests.sim.vessels import WAMV, added

PLAIN = structure_of(WAMV)
CURRENT = structure_of(WAMV.with_effects(added(named("steady_current"))))


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """A cache without kernels, and cores without work."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(ahead, "_is_core_free", lambda: True)
    kernel_for.cache_clear()
    yield
    kernel_for.cache_clear()


@pytest.fixture
def started(monkeypatch):
    """The processes that were started."""
    found, start = [], ahead._started

    def noted(structures):
        found.append(start(structures))
        return found[-1]

    monkeypatch.setattr(ahead, "_started", noted)
    return found


def test_another_process_compiles_what_this_one_then_loads(empty, started) -> None:
    with ahead.compiled_ahead([PLAIN, CURRENT]):
        (child,) = started
        assert child.wait(timeout=200) == 0
    assert is_kept(PLAIN)
    assert is_kept(CURRENT)
    kernel = kernel_for(CURRENT)
    compile_entries(kernel)
    for entry in (kernel.module.rollout, kernel.module.true_states, kernel.module.missing_force):
        assert sum(entry.stats.cache_hits.values()) == 1
        assert not entry.stats.cache_misses


def test_what_lies_where_it_is_started_is_not_run(empty, tmp_path, monkeypatch) -> None:
    """Modules of the same names in the user's folder are the user's, or somebody else's."""
    for name in ("sim", "gateway", "numpy"):
        (tmp_path / f"{name}.py").write_text("open('was_run', 'w').close()\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    child = ahead._started([PLAIN])
    assert child is not None
    assert child.wait(timeout=200) == 0
    child.communicate()
    assert is_kept(PLAIN)
    assert not (tmp_path / "was_run").exists()


def test_it_ends_with_what_it_was_started_for_however_far_it_is(empty, started) -> None:
    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt), ahead.compiled_ahead([PLAIN, CURRENT]):
        raise KeyboardInterrupt
    assert started[0].poll() is not None
    until = time.monotonic() + 10.0
    while threading.active_count() > before and time.monotonic() < until:
        time.sleep(0.01)
    assert threading.active_count() == before


def test_it_ends_where_who_started_it_is_gone(empty) -> None:
    child = ahead._started([PLAIN, CURRENT])
    assert child is not None
    assert child.stdin is not None
    time.sleep(0.5)  # so that the order is written
    child.stdin.close()
    assert child.wait(timeout=60) == 0
    assert not is_kept(CURRENT)


def test_nothing_is_started_for_kernels_that_are_kept_or_where_no_core_is_free(
    empty, started, monkeypatch
) -> None:
    with ahead.compiled_ahead([PLAIN]):
        pass
    monkeypatch.setattr(ahead, "_is_core_free", lambda: False)
    with ahead.compiled_ahead([PLAIN, CURRENT]):
        pass
    monkeypatch.setattr(ahead, "_is_core_free", lambda: True)
    monkeypatch.setattr(ahead, "is_kept", lambda structure: True)
    with ahead.compiled_ahead([PLAIN, CURRENT]):
        pass
    assert started == []


@pytest.mark.parametrize(("load", "cores", "free"), [
    (0.2, 2, True), (1.4, 2, True), (1.6, 2, False), (0.0, 1, False), (3.4, 4, True),
])  # fmt: skip
def test_a_core_is_free_where_others_leave_one(load, cores, free, monkeypatch) -> None:
    monkeypatch.setattr(ahead.os, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(ahead.os, "sched_getaffinity", lambda pid: set(range(cores)))
    assert ahead._is_core_free() is free


def test_the_kernels_of_a_diagnosis_are_those_that_its_models_ask_for(empty, monkeypatch) -> None:
    monkeypatch.setattr(cache, "_compilation_problem", lambda module, structure: None)
    for vessel in (WAMV, WAMV.with_effects(added(named("hull_lift")))):
        needed = kernels_of_a_diagnosis(vessel, EFFECTS)
        whole = [e for e in EFFECTS if not e.is_curve]
        superset = SupersetModel.of(vessel, whole)
        asked = [Model.of(vessel), superset.model]
        asked += [superset.with_added([added(named("thruster_lag"))])]
        curves = SupersetModel.of(vessel, [])
        asked += [curves.with_added([added(named("learned_drag"))])]
        assert all(model.kernel.structure in needed for model in asked)
        assert len(needed) == len(set(needed))
