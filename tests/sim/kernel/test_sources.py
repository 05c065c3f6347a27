"""The fingerprint of a kernel covers every source that its machine code comes from."""

import ast
import importlib
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from sim.effects import steady_wind
from sim.kernel import cache, compiled
from sim.kernel.generator import kernel_text
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.kernel.reachable import entries, modules_reached
from tests.sim.vessels import RUDDER_BOAT, SHAPES, WAMV, added, with_every_effect

ALL_AT_ONCE = [with_every_effect(v) for v in SHAPES]


def not_yet_compiled(structure):
    """The functions of a kernel as numba gets them: which there are is known before it compiles."""
    text = kernel_text(structure)
    file = cache._write(text, cache._fingerprint(structure, text))
    module = cache._load(file, structure, cache._jit, cache._entry)
    return cache.Kernel(module, structure, True)


def changed(monkeypatch, module):
    """From now on the module's source is another one."""
    read = compiled.source_text
    monkeypatch.setattr(
        compiled, "source_text", lambda name: read(name) + "\nX = 1\n" * (name == module)
    )


@pytest.mark.parametrize("vessel", [*ALL_AT_ONCE, WAMV, RUDDER_BOAT], ids=lambda v: v.name)
def test_every_function_that_a_kernel_reaches_is_in_its_fingerprint(vessel, monkeypatch):
    kernel = Model.of(vessel, not_yet_compiled).kernel
    reached = modules_reached(entries(kernel.module), {"sim"})
    text = kernel_text(kernel.structure)
    assert {"sim.state", "sim.balance", "sim.following"} <= reached
    assert reached <= cache.kernel_sources(kernel.structure, text)
    before = cache._fingerprint(kernel.structure, text)
    for module in reached:
        with monkeypatch.context() as patch:
            changed(patch, module)
            assert cache._fingerprint(kernel.structure, text) != before, module
    assert cache._fingerprint(kernel.structure, text) == before


def test_what_an_effects_file_imports_is_covered_with_its_constants():
    wind = Model.of(WAMV.with_effects(added(steady_wind.EFFECT)), not_yet_compiled).kernel
    reached = modules_reached(entries(wind.module), {"sim"})
    assert "sim.wind" in reached
    assert reached <= cache.kernel_sources(wind.structure, kernel_text(wind.structure))
    plain = Model.of(WAMV, not_yet_compiled).kernel.structure
    assert "sim.wind" not in cache.kernel_sources(plain, kernel_text(plain))


LAW = """
from sim.effects.effect import Effect, Parameter, Scope
from .shapes import skeg
EFFECT = Effect("keel", Scope.BOAT, (Parameter("k", "N s²", 0.0, 9.0, 1.0),), "slow", force=skeg)
"""
SHAPES_PY = """
from sim.state import Wrench
import lab.numbers
def skeg(flow, p):
    return Wrench(0.0, 0.0, -p.k * flow.u * flow.r * lab.numbers.HALF)
"""


@pytest.mark.slow
def test_the_package_of_a_plug_in_is_covered_too(tmp_path, monkeypatch):
    (tmp_path / "lab").mkdir()
    files = {"__init__": "", "keel": LAW, "shapes": SHAPES_PY, "numbers": "HALF = 0.5\n"}
    for name, text in files.items():
        (tmp_path / "lab" / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    keel = importlib.import_module("lab.keel").EFFECT
    try:
        structure = Model.of(WAMV.with_effects(AddedEffect(keel, {"k": 1.0}))).kernel.structure
        found = cache.kernel_sources(structure, kernel_text(structure))
        assert {"lab.shapes", "lab.numbers", "sim.state"} <= found
        before = cache._fingerprint(structure, kernel_text(structure))
        (tmp_path / "lab" / "numbers.py").write_text("HALF = 0.25\n", encoding="utf-8")
        assert cache._fingerprint(structure, kernel_text(structure)) != before
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == "lab"]:
            del sys.modules[name]
        compiled._file.cache_clear()


def test_imports_of_every_form_are_followed():
    text = "import sim.state\nfrom sim import body\nfrom sim.effects import cubic_drag as c\n"
    found = compiled.dependencies(text + "def f():\n    from sim.jit import jitable\n")
    assert {"sim.state", "sim.body", "sim.effects.cubic_drag", "sim.jit"} <= found
    assert compiled.dependencies("from .loops import predict", "sim.following.x") >= {
        "sim.following.loops"
    }
    assert compiled.dependencies("import numpy, os.path\nfrom scipy import linalg") == set()
    assert compiled.sources_of("no.such.module") == set()
    with pytest.raises(ImportError, match="no source of sim"):
        compiled.source_text("sim.nothing")


def test_no_import_of_any_source_is_missed_where_imports_alone_are_read():
    """What is read is compared with the whole source, for every module of the project."""

    def imports(tree: ast.Module) -> set[str]:
        kinds = (ast.Import, ast.ImportFrom)
        return {ast.dump(node) for node in ast.walk(tree) if isinstance(node, kinds)}

    for package in ("sim", "gateway"):
        folder = Path(str(find_spec(package).submodule_search_locations[0]))
        for file in folder.rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            assert imports(compiled._parsed_imports(text)) >= imports(ast.parse(text)), file


@pytest.mark.parametrize(
    "text",
    [
        "import sim.body; import sim.state",
        "if True: import sim.body\nimport sim.state",
        "from sim import (\n    body,  # the hull (rigid)\n    state,\n)",
        "from sim import body, \\\n    state",
        "from sim import body, state  # both",
        '"""Of old:\nfrom sim import (body body)\n"""\nimport sim.body\nimport sim.state',
    ],
)
def test_imports_written_otherwise_are_read_too(text: str):
    assert {"sim.body", "sim.state"} <= compiled.dependencies(text)


def test_a_law_and_its_numbers_are_the_same_in_all_kernels():
    """So that it is compiled once in a process, whatever stands beside it."""
    wind = added(steady_wind.EFFECT)
    alone = Model.of(WAMV.with_effects(wind), not_yet_compiled).kernel
    among = Model.of(with_every_effect(WAMV), not_yet_compiled).kernel
    place = [effect.name for effect in among.structure.effects].index("steady_wind")
    assert place > 0
    assert alone.module.force_0 is getattr(among.module, f"force_{place}")
    assert alone.module.P0 is getattr(among.module, f"P{place}")
