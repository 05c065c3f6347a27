"""Every benchmark can be started: what it imports is where it says."""

import importlib
import pkgutil

import pytest

import benchmarks

MODULES = [m.name for m in pkgutil.walk_packages(benchmarks.__path__, "benchmarks.")]


@pytest.mark.parametrize("name", [m for m in MODULES if not m.endswith("__main__")])
def test_a_benchmark_imports_what_there_is(name: str) -> None:
    importlib.import_module(name)
