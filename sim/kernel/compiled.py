"""How loops beside the kernels are compiled: cached on disk, without the interpreter lock.

numba keeps machine code on disk and notices an edit of the file that a function stands in, but not
of the files that it imports from, directly and indirectly: so the name of a cache file carries a
fingerprint of all those sources, and is never out of date.
"""

import ast
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec, resolve_name
from pathlib import Path
from threading import Event
from typing import Any, TypeVar

from numba import njit
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock


def source_text(module: str) -> str:
    """Text of a module, which is not imported for it; ImportError where there is none."""
    file = _file(module)
    if file is None:
        raise ImportError(f"no source of {module}")
    return file.read_text(encoding="utf-8")


def dependencies(text: str, module: str = "") -> set[str]:
    """Modules that a source text imports, and those that they import in turn.

    Followed are imports from `sim` and from the package that the text's own `module` belongs to:
    what comes from elsewhere is known by its version.
    """
    packages = frozenset({"sim", module.partition(".")[0]})
    found: set[str] = set()
    new = set(_imported(text, module, packages))
    while new - found:
        found |= new
        new = set().union(*(_imports_of(name, packages) for name in new))
    return found


def sources_of(module: str) -> set[str]:
    """A module and its dependencies; nothing where it has no file."""
    return {module} | dependencies(source_text(module), module) if _file(module) else set()


def fingerprint(texts: Iterable[str], modules: Iterable[str]) -> str:
    """Hexadecimal digest of some texts and of the sources of some modules."""
    digest = hashlib.sha256()
    for text in (*texts, *(source_text(module) for module in sorted(modules))):
        digest.update(text.encode())
    return digest.hexdigest()


@lru_cache(maxsize=1024)
def _imports_of(module: str, packages: frozenset[str]) -> frozenset[str]:
    return _imported(source_text(module), module, packages)


@lru_cache(maxsize=256)  # texts of effects are read again for every kernel that holds them
def _imported(text: str, module: str, packages: frozenset[str]) -> frozenset[str]:
    """Modules of these packages that a source text imports, or imports names from."""
    names: set[str] = set()
    for node in ast.walk(_parsed_imports(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            package = module if _is_package(module) else module.rpartition(".")[0]
            base = resolve_name("." * node.level + (node.module or ""), package or None)
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return frozenset(n for n in names if n.partition(".")[0] in packages and _file(n))


IMPORT = re.compile(
    r"^(?:from[ \t]+[.\w]+[ \t]+import[ \t]+(?:\([\w\s,]*\)|[\w, \t]+)|import[ \t]+[\w., \t]+)$",
    re.M,
)


def _parsed_imports(text: str) -> ast.Module:
    """The imports of a source text alone, where each stands in lines of its own; else all of it.

    To parse whole sources for them takes half a second of each program that uses a kernel. A text
    in quotes that reads like an import counts as one: a source too many does no harm.
    """
    found, word = IMPORT.findall(text), re.compile(r"\bimport\b")
    if sum(len(word.findall(part)) for part in found) == len(word.findall(text)):
        try:
            return ast.parse("\n".join(found))
        except SyntaxError:
            pass
    return ast.parse(text)


def _is_package(module: str) -> bool:
    file = _file(module) if module else None
    return file is not None and file.name == "__init__.py"


@lru_cache(maxsize=4096)
def _file(module: str) -> Path | None:
    """File of a module, found without importing it."""
    top, *parts = module.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):  # ValueError: a module that was made, not loaded
        return None
    for folder in (spec and spec.submodule_search_locations) or ():
        path = Path(folder, *parts)
        for file in (path.with_name(f"{path.name}.py"), path / "__init__.py"):
            if file.is_file():
                return file
    return None


F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """The same function, compiled; it keeps its type."""
    return _compiled(function, "never")


def inlined(function: F) -> F:
    """The same for a small function that is to be merged into its callers."""
    return _compiled(function, "always")


@lru_cache(maxsize=64)
def _version(module: str) -> str:
    """Changes with every source that a compiled function of that module can depend on."""
    return fingerprint((), sources_of(module))[:12]


def _compiled(function: F, inline: str) -> F:
    function.__qualname__ += f"_{_version(function.__module__)}"
    # nobody calls these from C: without that wrapper a tenth less is compiled
    jit = njit(cache=True, nogil=True, error_model="numpy", inline=inline, no_cfunc_wrapper=True)
    return compiled_once(jit(function))  # type: ignore[no-any-return]


COMPILED_ELSEWHERE = "shadow:compiled-elsewhere"  # kind of event, while another process is awaited
LOCK_TRIES, LOCK_WAIT_S = 300, 0.2  # a minute: longer than any function compiles


@contextmanager
def _one_process_at_a_time(file: Path) -> Iterator[None]:
    """Those that hold the same file wait for one another, for a minute and not for ever.

    Where a process was stopped while it holds the file, the others go on beside it: numba's cache
    bears two that compile the same. So they do where the file cannot be made or locked.
    """
    try:
        import fcntl

        lock = file.open("w")
    except (ImportError, OSError):
        yield
        return
    with lock:
        with event.trigger_event(COMPILED_ELSEWHERE):
            for _ in range(LOCK_TRIES):
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    Event().wait(LOCK_WAIT_S)
                except OSError:  # a file system without locks
                    break
        yield


def compiled_once(dispatcher: Any) -> Any:
    """A function of numba with a cache: of several processes one compiles it, the others load it.

    numba asks `compile` for every type of arguments that is new to the process. Its own lock comes
    first: a thread that has it and waits for the file would else wait for one that has the file.
    """
    if not hasattr(dispatcher, "compile"):  # with NUMBA_DISABLE_JIT it is the function itself
        return dispatcher
    compile_for = dispatcher.compile

    def compile_or_load(signature: Any) -> Any:
        file = Path(dispatcher.stats.cache_path, f"{dispatcher.py_func.__qualname__}.lock")
        with global_compiler_lock, _one_process_at_a_time(file):
            return compile_for(signature)

    dispatcher.compile = compile_or_load
    return dispatcher
