"""Arrays as the compiled loops take them: contiguous, writable, of one type.

numba compiles anew for every other kind of array.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.state import Floats


def floats(values: ArrayLike) -> Floats:
    """Anything -> float64, contiguous, writable."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.flags.carray:
        return values  # `require` takes 3 µs to find that out, and a live row has a dozen arrays
    return np.require(values, np.float64, ["C", "W"])


def flags(values: ArrayLike | None, count: int) -> NDArray[np.bool_]:
    """Flags (K,), or None -> none of them set."""
    if values is None:
        return np.zeros(count, np.bool_)
    if isinstance(values, np.ndarray) and values.dtype == np.bool_ and values.flags.carray:
        return values
    return np.require(values, np.bool_, ["C", "W"])


def air(voltage: ArrayLike | None, wind: ArrayLike | None, count: int) -> tuple[Floats, Floats]:
    """Voltage (K,) [V] and wind (K, 2) [m/s]; NaN, not measured, where left out."""
    volts = np.full(count, np.nan) if voltage is None else floats(voltage)
    return volts, np.full((count, 2), np.nan) if wind is None else floats(wind)


def frozen(carry: Floats) -> Floats:
    """The same array, read-only: part of a frozen state."""
    carry.flags.writeable = False
    return carry
