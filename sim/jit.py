"""Functions that serve numpy arrays as they stand and compiled code when it calls them."""

from collections.abc import Callable
from typing import TypeVar

from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., object])


def jitable(function: F) -> F:
    """The same function, callable from compiled kernels too."""
    return register_jitable(function)  # type: ignore[no-any-return]
