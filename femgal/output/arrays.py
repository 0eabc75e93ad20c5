# SPDX-License-Identifier: BSD-3-Clause
"""How an array of the solver is stored: the element types and shapes that every VTK reader understands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def storable(name: str, values: ArrayLike, rows: int) -> NDArray[Any]:
    """Return `values` as float32, int32, int64 or uint8, shape [rows] or [rows, components].

    Booleans become uint8 (the .vtu writer knows no bool), 3x3 tensors 9 components row by row (they are mangled
    otherwise), 2-D vectors get a zero third component, integers int32 where they fit.

    Raises
    ------
    ValueError
        Wrong number of rows, too many axes, or not numbers.
    """
    array = np.asarray(values)
    if "/" in name or name in ("", "."):
        raise ValueError(f"array name {name!r}: a name without '/' is needed")
    if array.ndim == 0 or len(array) != rows:
        raise ValueError(f"array {name!r}: shape {array.shape}, needed [{rows}, ...]")
    if array.dtype.kind not in "biuf" or array.ndim > 3:
        raise ValueError(f"array {name!r}: {array.dtype} with {array.ndim} axes, needed at most 3 axes of numbers")
    if array.ndim == 3:
        array = array.reshape(rows, -1)
    if array.ndim == 2 and array.shape[1] == 2:
        array = np.column_stack([array, np.zeros(rows, array.dtype)])
    return np.ascontiguousarray(array, _stored_type(array))


def storable_all(data: Mapping[str, ArrayLike], rows: int) -> dict[str, NDArray[Any]]:
    """Return every array of `data` in its stored form; see `storable`."""
    return {name: storable(name, values, rows) for name, values in data.items()}


def _stored_type(array: NDArray[Any]) -> np.dtype[Any]:
    if array.dtype.kind == "b" or array.dtype == np.uint8:
        return np.dtype(np.uint8)
    if array.dtype.kind == "f":
        return np.dtype(np.float32)
    limits = np.iinfo(np.int32)
    fits = array.size == 0 or (int(array.min()) >= limits.min and int(array.max()) <= limits.max)
    return np.dtype(np.int32 if fits else np.int64)
