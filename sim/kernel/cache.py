"""Compiled kernels, one per combination of thrusters, rudders and effects, cached on disk.

`sim.kernel.generator` writes the module; numba compiles it and keeps the machine code beside it.
The file name is a hash of everything that the machine code depends on: the module's text, the
effects' sources, the sources of all modules that these import directly or indirectly, the options
of compilation (this file) and the versions. A change in any of them gives a new kernel.

A law outside numba's subset runs in numpy instead, with a warning.
"""

import importlib.util
import os
import platform
import re
import sys
import tempfile
import warnings
from collections import namedtuple
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numba
import numpy as np

from sim.effects.effect import LawError
from sim.kernel import rollout_numpy
from sim.kernel.compiled import compiled_once, dependencies, fingerprint, sources_of
from sim.kernel.generator import Structure, kernel_text, numbers_of
from sim.kernel.rows import compiled_numbers_at, numbers_at

Jit = Callable[[Callable[..., Any]], Any]


OTHERS_MAY_WRITE = 0o022  # group and all


def _cache_folder() -> Path:
    """Where kernels are kept: what lies there is executed, so nobody else may write there.

    A folder of the user's that others could write is made private and emptied: a cache. A temporary
    folder where the user's cache cannot be written, or belongs to someone else.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "shadow-gateway" / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for one in (folder.parent, folder, folder / "__pycache__"):
            if not _made_private(one):
                break
        else:
            with tempfile.TemporaryFile(dir=folder):
                return folder
    except OSError:
        pass
    return _temporary_folder()


@lru_cache(maxsize=1)
def _temporary_folder() -> Path:
    """One for this process."""
    return Path(tempfile.mkdtemp(prefix="shadow-kernels-"))


def _made_private(folder: Path) -> bool:
    """Whether only the user can have written what is in a folder, after tightening it."""
    if not folder.exists() or not hasattr(os, "getuid"):
        return True
    found = folder.stat()
    if found.st_uid != os.getuid():
        return False
    if found.st_mode & OTHERS_MAY_WRITE:
        folder.chmod(0o700)
        for file in folder.iterdir():
            if not file.is_dir():
                file.unlink()
    return _holds_only_files_of(found.st_uid, folder)


@lru_cache(maxsize=32)  # once a process: while a folder is private nobody else puts a file there
def _holds_only_files_of(user: int, folder: Path) -> bool:
    """Whether all that is in a folder belongs to a user."""
    return all(_owner(file) in (user, None) for file in folder.iterdir())


def _owner(file: Path) -> int | None:
    """User id of a file; None where another process has just removed it."""
    try:
        return file.lstat().st_uid
    except FileNotFoundError:
        return None


def kernel_sources(s: Structure, text: str) -> set[str]:
    """Modules whose source decides the machine code of a kernel with this text.

    What the text and the effects' laws import, directly or indirectly, and this module.
    """
    modules = {__name__} | dependencies(text)
    for effect in s.effects:
        modules |= dependencies(effect.source_code, effect.module)
        modules |= set().union(*(sources_of(law.__module__) for law in effect.laws.values()))
    return modules


def _fingerprint(s: Structure, text: str) -> str:
    """Hash of all that the machine code depends on."""
    versions = f"{numba.__version__} {np.__version__} {platform.python_version()}"
    texts = (text, *(effect.source_code for effect in s.effects), versions, platform.machine())
    return fingerprint(texts, kernel_sources(s, text))[:24]


def _load(file: Path, s: Structure, jit: Jit, entry: Jit) -> ModuleType:
    """Execute a kernel file with its laws, the classes of their numbers and its decorators in
    place.
    """
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load the kernel {file}")
    module = importlib.util.module_from_spec(spec)
    module.__dict__["jit"] = jit
    module.__dict__["entry"] = entry
    module.__dict__["numbers_at"] = numbers_at if jit is _uncompiled else compiled_numbers_at
    for e, effect in enumerate(s.effects):
        module.__dict__[f"P{e}"] = _numbers_class(numbers_of(effect))
        for place, law in effect.laws.items():
            module.__dict__[f"{place}_{e}"] = _law(jit, law)
    sys.modules[file.stem] = module  # numba finds a function's home there when it loads its cache
    spec.loader.exec_module(module)
    return module


@lru_cache(maxsize=1024)
def _law(jit: Jit, law: Callable[..., Any]) -> Any:
    """A law of an effect: the same in all kernels, so that it is compiled once."""
    return jit(law)


@lru_cache(maxsize=1024)
def _numbers_class(names: tuple[str, ...]) -> type:
    """Numbers of an effect as its laws take them: of one class in all kernels, as the laws are."""
    return namedtuple("EffectNumbers", names)


def _write(text: str, name: str) -> Path:
    """The kernel's text as a file, replaced in one piece (several processes may do this)."""
    file = _cache_folder() / f"kernel_{name}.py"
    if not file.exists():
        with tempfile.NamedTemporaryFile(
            "w", dir=file.parent, suffix=".tmp", delete=False, encoding="utf-8"
        ) as out:
            out.write(text)
        Path(out.name).replace(file)
    return file


def is_kept(s: Structure) -> bool:
    """Whether the machine code of a structure's free runs is in the cache."""
    name = f"kernel_{_fingerprint(s, kernel_text(s))}.rollout-*.nbi"
    return any((_cache_folder() / "__pycache__").glob(name))


class Kernel(NamedTuple):
    """The composed functions of one structure, and whether they are compiled."""

    module: Any
    structure: Structure
    compiled: bool


def _jit(function: Callable[..., Any]) -> Any:
    """For what only compiled code calls: without the wrappers for Python it compiles faster.

    Each call is put in its place: as arguments, the numbers of thirty effects cost more than their
    laws.
    """
    return numba.njit(
        nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True,
        forceinline=True,
    )(function)  # fmt: skip


def _entry(function: Callable[..., Any]) -> Any:
    """For what Python calls, with arrays alone: its machine code, callees included, is kept."""
    entry = numba.njit(nogil=True, error_model="numpy", cache=True, no_cfunc_wrapper=True)
    return compiled_once(entry(function))


def _uncompiled(function: Callable[..., Any]) -> Any:
    return function


def _empty_runs(s: Structure, count: int) -> tuple[Any, ...]:
    """Arguments of `rollout` for runs of no length."""
    none, parameters = np.zeros(count, np.int64), sum(size for _, _, size in s.tuples)
    return (
        np.ones((1, parameters)), np.zeros((count, s.nx)), none, none, none, np.zeros(count),
        np.zeros((1, 2, s.actuators)), np.zeros((1, 1)), np.zeros((1, 1, 2)), np.zeros((1, 1)),
        0.1, 1, np.zeros((count, 1, s.nx)), np.zeros((count, 1, 9)),
    )  # fmt: skip


def _compilation_problem(kernel: ModuleType, s: Structure) -> str | None:
    """Compile the dynamics once -> None, or what numba could not do, and where."""
    try:
        kernel.rollout(*_empty_runs(s, 1))
    except numba.core.errors.NumbaError as error:
        return _reason(str(error))
    return None


def _reason(message: str) -> str:
    """The line of numba's message that names the problem, and the place in the source."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", message)  # numba writes in colour where colorama is there
    lines = [line.strip() for line in plain.splitlines() if line.strip()]
    problems = [line for line in lines if not line.startswith("Failed in nopython mode")]
    places = [line.rstrip(":") for line in lines if line.startswith("File ")]
    return ", ".join([*problems[:1], *places[:1]]) or "unknown reason"


def _check_laws(kernel: Kernel, names: str) -> None:
    """Call a plain kernel on floats and on arrays; LawError where a law of it fails."""
    s = kernel.structure
    try:
        with np.errstate(all="ignore"):  # made-up parameters: the numbers mean nothing
            kernel.module.rollout(*_empty_runs(s, 1))
            rollout_numpy(kernel.module, *_empty_runs(s, 2))
    except Exception as error:  # whatever a user's law does wrong is one line for its user
        raise LawError(f"effects {names}: {type(error).__name__}: {error}") from error


def compile_entries(kernel: Kernel) -> None:
    """Compile what identification and diagnosis call beside free runs, by calls without rows."""
    s = kernel.structure
    theta = np.ones((1, sum(size for _, _, size in s.tuples)))
    none, commands = np.zeros((0, 9)), np.zeros((0, s.actuators))
    force = np.zeros((0, 3))
    kernel.module.true_states(theta, none, np.zeros((0, 6)))
    kernel.module.missing_force(
        theta[0], np.full(s.nx + 1, np.nan), np.zeros(0), none, commands, commands, np.zeros(0),
        np.zeros((0, 2)), force, force, np.zeros((0, s.nx - 6)),
    )  # fmt: skip


@lru_cache(maxsize=128)
def kernel_for(s: Structure) -> Kernel:
    """The kernel of a structure: compiled, or in numpy where a law cannot be compiled."""
    text = kernel_text(s)
    module = _load(_write(text, _fingerprint(s, text)), s, _jit, _entry)
    problem = _compilation_problem(module, s)
    if problem is None:
        return Kernel(module, s, True)
    names = ", ".join(effect.name for effect in s.effects)
    plain = plain_kernel_for(s)
    _check_laws(plain, names)
    warnings.warn(
        f"effects {names} run in numpy, slower: numba cannot compile them ({problem})", stacklevel=2
    )
    return plain


@lru_cache(maxsize=128)
def plain_kernel_for(s: Structure) -> Kernel:
    """The kernel of a structure in plain Python: on floats, or on arrays over a batch.

    No machine code of it is kept: its text alone names the file.
    """
    text = kernel_text(s, plain=True)
    file = _write(text, fingerprint((text,), ())[:24])
    module = _load(file, s, _uncompiled, _uncompiled)
    return Kernel(module, s, False)
