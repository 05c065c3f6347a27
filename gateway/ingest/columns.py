"""Records in a row -> one contiguous array per field."""

from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = TypeVar("Array", bound=NDArray[np.generic])


def columns(records: NDArray[np.void], fields: Iterable[str]) -> dict[str, NDArray[np.generic]]:
    """Records (K,) -> field -> (K,) or (K, n), aligned, read-only; text ends at its first NUL."""
    return {name: frozen(column(records[name])) for name in fields}


def column(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """One field of packed records -> the same values side by side."""
    aligned = np.ascontiguousarray(values)
    return text(aligned) if aligned.dtype.kind == "S" else aligned


def text(raw: NDArray[np.bytes_]) -> NDArray[np.bytes_]:
    """Text (K,) without what stands behind a NUL."""
    characters = raw.view(np.uint8).reshape(-1, raw.dtype.itemsize)
    inside = np.logical_and.accumulate(characters != 0, axis=1)
    return np.where(inside, characters, 0).astype(np.uint8).view(raw.dtype).reshape(-1)


def frozen(array: Array) -> Array:
    """The same array, read-only."""
    array.setflags(write=False)
    return array
