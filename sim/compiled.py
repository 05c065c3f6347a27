"""Vessel + effects → one compiled kernel.

`sim.compose` writes one module per combination of thrusters, rudders and effects; numba compiles
it and keeps the machine code beside it. numba notices only changes of that module itself, so its
file name is a hash of everything that goes in: the generator, the core's sources, the effects'
sources and the versions. Editing an effect makes a new kernel; nothing goes stale.

A law outside numba's subset runs in numpy instead, with a notice.
"""

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

import sim
from sim import numpy_drivers
from sim.body import Blade, Body, Drive
from sim.compose import Structure, kernel_text, owners_of
from sim.effects.effect import LawError

CORE = (
    "jit.py", "state.py", "body.py", "balance.py", "actuators.py", "sensing.py", "drivers.py",
    "compose.py", "compiled.py", "following/law.py", "following/blend.py", "following/drivers.py",
    "following/watch.py",
)  # fmt: skip
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


def _fingerprint(s: Structure, text: str) -> str:
    """Hash of all that the machine code depends on."""
    digest = hashlib.sha256(text.encode())
    for name in CORE:
        digest.update((Path(sim.__file__).parent / name).read_bytes())
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
            numpy_drivers.rollout(kernel.module, *_smallest(kernel.structure, parameters, 2))
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
        len(Body._fields) + s.thrusters * (len(Drive._fields) - 1)
        + len(s.rudders) * (len(Blade._fields) - 1) + sum(len(e.parameters) for e in s.effects)
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
