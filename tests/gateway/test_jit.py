"""Machine code of loops that are no kernels is kept under the fingerprint of all their sources."""

import importlib
from pathlib import Path

import pytest

from sim.kernel import compiled
from tests.sim.kernel.reachable import entries, modules_reached

ROOT = Path(__file__).resolve().parents[2]
COMPILED = sorted(
    ".".join(file.relative_to(ROOT).with_suffix("").parts)
    for package in ("gateway", "sim")
    for file in (ROOT / package).rglob("*.py")
    if "\n@compiled" in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", COMPILED)
def test_every_function_that_is_reached_is_in_the_fingerprint(name, monkeypatch):
    module = importlib.import_module(name)
    own = [f for f in entries(module) if f.py_func.__module__ == name]
    reached = modules_reached(own, {"sim", "gateway"})
    assert own
    assert name in reached
    assert reached <= compiled.sources_of(name)
    before, read = compiled._version(name), compiled.source_text
    assert all(f.py_func.__qualname__.endswith(before) for f in own)
    for other in reached:
        with monkeypatch.context() as patch:
            compiled._version.cache_clear()
            patch.setattr(
                compiled, "source_text", lambda n, o=other: read(n) + "\nX = 1\n" * (n == o)
            )
            assert compiled._version(name) != before, other
    compiled._version.cache_clear()


def test_the_loops_of_both_packages_are_found():
    assert {"gateway.estimation.filter", "sim.plants.hydrodynamics"} <= set(COMPILED)
