"""Compiled kernels, one per combination of thrusters, rudders and effects, cached on disk.

`sim.kernel.generator` writes the module; numba compiles it and keeps the machine code beside it.
numba notices changes of that module only, so the file name is a hash of everything that the
machine code depends on: the module's text, the sources of all modules that it imports directly or
indirectly (`sources_of`), the effects' sources and the versions. A change in any of them gives a
new kernel.

A law outside numba's subset runs in numpy instead, with a warning.
"""

import ast
import hashlib
import importlib.util
import os
import platform
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numba
import numpy as np

from sim.body import Body, RudderParameters, ThrusterParameters
from sim.effects.effect import LawError
from sim.kernel import loops_numpy
from sim.kernel.generator import Structure, kernel_text, owners_of, source_file

Jit = Callable[[Callable[..., Any]], Any]


def _cache_folder() -> Path:
    """Where kernels are kept; a temporary folder where the user's cache cannot be written."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "shadow-gateway" / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return Path(tempfile.mkdtemp(prefix="shadow-kernels-"))


def sources_of(text: str) -> set[str]:
    """Modules of `sim` whose source decides the machine code of a kernel with this text.

    What the text imports, what those modules import in turn, and the compiler's own options.
    """
    found, new = {__name__}, _imported(text)
    while new - found:
        found |= new
        new = {name for module in new for name in _imports_of(module)}
    return found


@lru_cache
def _imports_of(module: str) -> frozenset[str]:
    return frozenset(_imported(source_file(module).read_text(encoding="utf-8")))


def _imported(text: str) -> set[str]:
    """Modules of `sim` from which a source text imports names."""
    return {
        str(node.module)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("sim.")
    }


def _fingerprint(s: Structure, text: str) -> str:
    """Hash of all that the machine code depends on."""
    digest = hashlib.sha256(text.encode())
    for module in sorted(sources_of(text)):
        digest.update(source_file(module).read_bytes())
    for effect in s.effects:
        digest.update(effect.source_code.encode())
    versions = f"{numba.__version__} {np.__version__} {platform.python_version()}"
    digest.update(f"{versions} {platform.machine()}".encode())
    return digest.hexdigest()[:24]


def _load(file: Path, s: Structure, jit: Jit, entry: Jit) -> ModuleType:
    """Execute a kernel file with its laws and `jit` in place."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load the kernel {file}")
    module = importlib.util.module_from_spec(spec)
    module.__dict__["jit"] = jit
    module.__dict__["entry"] = entry
    for e, effect in enumerate(s.effects):
        for place, law in effect.laws.items():
            module.__dict__[f"{place}_{e}"] = jit(law)
    sys.modules[file.stem] = module  # numba finds a function's home there when it loads its cache
    spec.loader.exec_module(module)
    return module


def _write(text: str, fingerprint: str) -> Path:
    """The kernel's text as a file, replaced in one piece (several processes may do this)."""
    file = _cache_folder() / f"kernel_{fingerprint}.py"
    if not file.exists():
        with tempfile.NamedTemporaryFile(
            "w", dir=file.parent, suffix=".tmp", delete=False, encoding="utf-8"
        ) as out:
            out.write(text)
        Path(out.name).replace(file)
    return file


class Kernel(NamedTuple):
    """The compiled functions of one structure, and whether they are compiled at all."""

    module: Any
    structure: Structure
    compiled: bool


def _jit(function: Callable[..., Any]) -> Any:
    """What only compiled code calls: without the wrappers for Python it compiles twice as fast."""
    return numba.njit(
        nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)


def _entry(function: Callable[..., Any]) -> Any:
    """What Python calls, with arrays alone: its machine code, callees included, goes to disk."""
    return numba.njit(nogil=True, error_model="numpy", cache=True)(function)


def _as_it_is(function: Callable[..., Any]) -> Any:
    return function


def _compiles(kernel: ModuleType, s: Structure, parameters: int) -> str | None:
    """Compile the dynamics once -> None, or what numba could not do, and where."""
    try:
        kernel.rollout(*_smallest(s, parameters, 1))
    except numba.core.errors.NumbaError as error:
        return _reason(str(error))
    return None


def _smallest(s: Structure, parameters: int, runs: int) -> tuple[Any, ...]:
    """Arguments of `rollout` for runs of no length at all."""
    na, none = max(s.thrusters + len(s.rudders), 1), np.zeros(runs, np.int64)
    return (
        np.ones((1, parameters)), np.zeros((runs, s.nx)), none, none, none, np.zeros(runs),
        np.zeros((1, 2, na)), np.zeros((1, 1)), np.zeros((1, 1, 2)), np.zeros((1, 1)), 0.1, 1,
        np.zeros((runs, 1, s.nx)), np.zeros((runs, 1, 9)),
    )  # fmt: skip


def _tried(kernel: Kernel, names: str, parameters: int) -> Kernel:
    """The plain kernel, once its laws have answered on floats and on arrays."""
    try:
        with np.errstate(all="ignore"):  # made-up parameters: the numbers mean nothing
            kernel.module.rollout(*_smallest(kernel.structure, parameters, 1))
            loops_numpy.rollout(kernel.module, *_smallest(kernel.structure, parameters, 2))
    except Exception as error:  # whatever a user's law does wrong is one line for its user
        raise LawError(f"effects {names}: {type(error).__name__}: {error}") from error
    return kernel


def _reason(says: str) -> str:
    """The line of numba's message that tells something, and the place in the source."""
    lines = [line.strip() for line in says.splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith("Failed in nopython mode")]
    place = [line.rstrip(":") for line in lines if line.startswith("File ")]
    return ", ".join([*telling[:1], *place[:1]]) or "unknown reason"


@lru_cache(maxsize=128)
def kernel_for(s: Structure) -> Kernel:
    """The kernel of a structure: compiled, or in numpy where a law cannot be compiled."""
    text = kernel_text(s)
    file = _write(text, _fingerprint(s, text))
    module = _load(file, s, _jit, _entry)
    parameters = (
        len(Body._fields) + s.thrusters * (len(ThrusterParameters._fields) - 1)
        + len(s.rudders) * (len(RudderParameters._fields) - 1) + sum(len(e.parameters) for e in s.effects)
        + sum(len(s.knots[i]) for i in owners_of(s))
    )  # fmt: skip
    problem = _compiles(module, s, parameters)
    if problem is None:
        return Kernel(module, s, True)
    names = ", ".join(effect.name for effect in s.effects)
    plain = _tried(plain_kernel_for(s), names, parameters)
    warnings.warn(
        f"effects {names} run in numpy, slower: numba cannot compile them ({problem})", stacklevel=2
    )
    return plain


@lru_cache(maxsize=128)
def plain_kernel_for(s: Structure) -> Kernel:
    """The kernel of a structure in plain Python: on floats, or on arrays over a batch."""
    text = kernel_text(s)
    return Kernel(_load(_write(text, _fingerprint(s, text)), s, _as_it_is, _as_it_is), s, False)
