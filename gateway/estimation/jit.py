"""How the kernels of this package are compiled: cached on disk, without the interpreter lock."""

from collections.abc import Callable
from typing import TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """The same function, compiled; it keeps its type."""
    return njit(cache=True, nogil=True, error_model="numpy")(function)  # type: ignore[no-any-return]
