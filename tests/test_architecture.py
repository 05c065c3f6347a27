"""Who may import what: `sim` is physics alone, arrays in, arrays out; imports run downwards.

`LAYERS` lists the modules and folders of both packages from the bottom up, those of one line side
by side: nothing imports anything of a later line, nor a neighbour on its own line.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SIM = sorted((ROOT / "sim").rglob("*.py"))
FORBIDDEN = {
    "gateway", "tests", "benchmarks",  # the world, and those who watch
    "socket", "ssl", "http", "urllib", "select", "selectors", "zenoh", "pymavlink", "serial",
    "mcap", "io", "os", "pathlib", "shutil", "tempfile", "glob", "sqlite3", "tomllib", "json",
    "time", "datetime", "sched", "asyncio", "threading", "multiprocessing", "concurrent",
    "queue", "subprocess", "signal", "logging", "argparse", "typer", "rich", "pydantic",
}  # fmt: skip
CALLS = {"open", "input", "print", "exec", "eval"}
KERNELS = {"os", "pathlib", "tempfile"}
ALLOWED = {  # these keep kernels on disk: a compiler's cache, nothing that a result depends on
    "kernel/cache.py": KERNELS,
    # reads the sources that name a kernel; waits while another process compiles the same
    "kernel/compiled.py": {"pathlib", "threading"},
}


def imports(tree: ast.AST) -> Iterator[str]:
    """Names of all packages that a module imports, wherever in the file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield (node.module or "").split(".")[0] if node.level == 0 else "relative import"


def calls(tree: ast.AST) -> Iterator[str]:
    """Names of all functions that are called plainly."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield node.func.id


@pytest.mark.parametrize("path", SIM, ids=lambda p: str(p.relative_to(ROOT)))
def test_sim_knows_nothing_of_the_world(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    name = str(path.relative_to(ROOT / "sim"))
    pure_path = {"pathlib"} if name == "effects/effect.py" else set()  # a file's name, not a file
    wrong = set(imports(tree)) & (FORBIDDEN - ALLOWED.get(name, set()) - pure_path)
    wrong |= set(imports(tree)) & {"relative import"}
    assert not wrong, f"sim/{name} imports {', '.join(sorted(wrong))}"
    used = set(calls(tree)) & CALLS
    assert not used, f"sim/{name} calls {', '.join(sorted(used))}"


VALUES = [*SIM, *sorted((ROOT / "gateway" / "estimation").rglob("*.py"))]


def test_values_are_frozen():
    """Of the model, the diagnosis and the filter: a step returns a new state."""
    loose = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in VALUES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        for decorator in map(ast.unparse, node.decorator_list)
        if decorator.startswith("dataclass") and "frozen=True" not in decorator
    ]
    assert loose == []


def test_effect_py_uses_pure_paths_only():
    tree = ast.parse((ROOT / "sim/effects/effect.py").read_text(encoding="utf-8"))
    taken = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "pathlib"
        for alias in node.names
    }
    assert taken == {"PurePath"}


def test_the_check_can_fail():
    """Every kind of offence is seen."""
    tree = ast.parse("def f():\n    import socket\n    from os import path\n    open('x')\n")
    assert set(imports(tree)) & FORBIDDEN == {"socket", "os"}
    assert set(calls(tree)) & CALLS == {"open"}
    assert len(SIM) > 30


def test_sim_stands_alone():
    """It is imported whole without one module of the gateway."""
    import subprocess
    import sys

    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in SIM
    ]
    world = {"gateway", "zenoh", "pymavlink", "mcap"}
    code = (
        f"import importlib, sys; [importlib.import_module(m) for m in {modules!r}]; "
        f"found = {{m.split('.')[0] for m in sys.modules}} & {world!r}; "
        "sys.exit(f'sim brings along {sorted(found)}' if found else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


LAYERS = {
    "sim": """
        jit near_names
        state
        body
        wind
        balance actuators sensing effects
        vessel
        trial kernel
        model
        prediction excitation plants
        following identification hil
        comparison
        diagnosis monitoring wear
        api
    """,
    "gateway": """
        errors samples topics
        files toml_file long_running kernels_ahead compiling keelson json_rows result_json
        user_effects estimation recording bus vessel_tables
        vessel_file vessel_questions number_keys ingest monitor
        links shadow plants
        config
        live figures
        offline
        fleet
        simulated_boat terminal api
        studio demo hil stand_in
        hil_demo
        commands
        cli
        program
    """,
}


def place_of(module: str) -> str:
    """`sim.diagnosis.fit` -> `diagnosis`: the folder or file at the top of its package."""
    return module.split(".")[1]


def layered_imports(package: str) -> Iterator[tuple[str, str, str]]:
    """File, its place and the place that it imports, for all imports within a package."""
    for path in sorted((ROOT / package).rglob("*.py")):
        own = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if own == package:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            for name in names:
                if name.startswith(f"{package}.") and place_of(name) != place_of(own):
                    yield str(path.relative_to(ROOT)), place_of(own), place_of(name)


@pytest.mark.parametrize("package", LAYERS)
def test_imports_run_downwards(package):
    level = {
        place: number
        for number, line in enumerate(LAYERS[package].strip().splitlines())
        for place in line.split()
    }
    wrong = [
        f"{file} imports {package}.{imported}"
        for file, own, imported in layered_imports(package)
        if level[imported] >= level[own]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("package", LAYERS)
def test_every_place_has_its_layer(package):
    there = {
        path.stem if path.is_file() else path.name
        for path in (ROOT / package).iterdir()
        if path.suffix == ".py" or (path.is_dir() and list(path.glob("*.py")))
    } - {"__init__"}
    assert there == set(LAYERS[package].split())


def test_an_effect_is_named_in_its_own_file_alone():
    """Whatever the rest of the software needs to know of an effect is declared in its file."""
    from sim.effects.catalogue import EFFECTS

    word = re.compile(r"\b(" + "|".join(effect.name for effect in EFFECTS) + r")\b")
    product = [*(ROOT / "sim").rglob("*.py"), *(ROOT / "gateway").rglob("*.py")]
    named = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in product
        if path.parent.name != "effects"
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if word.search(line)
    ]
    assert not named, "\n".join(named)
    assert word.search("steady_current")
