"""How loops beside the kernels are compiled: cached on disk, without the interpreter lock.

numba's cache notices an edit of the file that a function stands in, but not of the files that it
imports from: so the name of the cache file carries a fingerprint of them all.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

from numba import njit

from sim.kernel.sources import fingerprint, sources_of

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
    return njit(  # type: ignore[no-any-return]
        cache=True, nogil=True, error_model="numpy", inline=inline
    )(function)
