"""How loops of this package are compiled: cached on disk, without the interpreter lock.

numba's cache notices an edit of the file that a function stands in, but not of the files whose
functions and constants it uses. So the name of the cache file carries a fingerprint of its whole
folder, and of the vocabulary shared with `sim`.
"""

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from numba import njit

import sim.state
import sim.trial

F = TypeVar("F", bound=Callable[..., object])


@lru_cache(maxsize=16)
def fingerprint(folder: Path) -> str:
    """Changes with every source that a compiled function in that folder can depend on."""
    sources = [*sorted(folder.glob("*.py")), Path(sim.state.__file__), Path(sim.trial.__file__)]
    digest = hashlib.sha256()
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


def compiled(function: F) -> F:
    """The same function, compiled; it keeps its type."""
    return _compiled(function, "never")


def inlined(function: F) -> F:
    """The same for a small function that is to be merged into whatever calls it."""
    return _compiled(function, "always")


def _compiled(function: F, inline: str) -> F:
    function.__qualname__ += f"_{fingerprint(Path(function.__code__.co_filename).parent)}"
    return njit(  # type: ignore[no-any-return]
        cache=True, nogil=True, error_model="numpy", inline=inline
    )(function)
