"""Who may import what: `sim` is physics alone, arrays in, arrays out."""

import ast
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
    "compiled.py": KERNELS,
    "compose.py": {"pathlib"},  # reads the loops' own source, which goes into every kernel
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
