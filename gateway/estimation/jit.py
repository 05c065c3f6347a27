"""How the kernels of this package are compiled: cached on disk, without the interpreter lock.

numba's cache notices an edit of the file that a kernel stands in, but not of the files whose
kernels and constants it uses. So the name of the cache file carries a fingerprint of them all.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from numba import njit

import sim.state
import sim.trial

F = TypeVar("F", bound=Callable[..., object])


def _fingerprint() -> str:
    """Changes with every source that a kernel here can depend on."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    sources += [Path(sim.state.__file__), Path(sim.trial.__file__)]
    digest = hashlib.sha256()
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


FINGERPRINT = _fingerprint()


def compiled(function: F) -> F:
    """The same function, compiled; it keeps its type."""
    function.__qualname__ += f"_{FINGERPRINT}"
    return njit(cache=True, nogil=True, error_model="numpy")(function)  # type: ignore[no-any-return]
