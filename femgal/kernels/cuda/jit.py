# SPDX-License-Identifier: BSD-3-Clause
"""The two decorators behind every CUDA kernel, and the types of a kernel's arguments.

A kernel's annotations name the types that it is launched with, so that it can be compiled without a device
(`femgal.kernels.cuda.offline`) exactly as it will be on one. `Reals` has the precision of the element passes; all
other floating-point numbers are double.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import cuda as _cuda
from numba.core.types import float64 as _float64
from numpy.typing import NDArray

from femgal.kernels.backend import Precision
from femgal.kernels.cuda.device import simulator_wanted
from meshes.jit import kernel_cache

Function = TypeVar("Function", bound=Callable[..., Any])

# What Numba puts behind these names in a kernel is not what a type checker sees.
cuda: Any = _cuda
float64: Any = _float64

# Kernels run in Numba's simulator, one Python thread per CUDA thread (NUMBA_ENABLE_CUDASIM=1).
SIMULATED = simulator_wanted()

# Annotations of kernels: element type and number of dimensions, rows contiguous.
Rows = NDArray[np.float64]
Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
IntRows = NDArray[np.int32]
Longs = NDArray[np.int64]
Shorts = NDArray[np.uint16]
Singles = NDArray[np.float32]

_ARRAYS = {
    "Rows": ("float64", 2),
    "Floats": ("float64", 1),
    "Reals": ("", 1),
    "Singles": ("float32", 2),
    "Ints": ("int32", 1),
    "IntRows": ("int32", 2),
    "Longs": ("int64", 1),
    "Shorts": ("uint16", 1),
}
_SCALARS = {"int": "int64", "float": "float64", "bool": "boolean"}

KERNELS: dict[str, Callable[..., Any]] = {}
"""Every kernel by name, as written."""


def kernel(function: Function) -> Any:
    """Compile a CUDA kernel on its first launch; cached on disk like the kernels of the CPU."""
    KERNELS[function.__name__] = function
    if SIMULATED:
        return cuda.jit(function)
    # Numba-CUDA has settings of its own.
    from numba.cuda.core import config as settings

    with kernel_cache(function, settings):
        return cuda.jit(cache=True)(function)


def inlined(function: Function) -> Any:
    """Compile a device function that takes arrays and is always inlined."""
    return cuda.jit(device=True, **({} if SIMULATED else {"forceinline": True}))(function)


def argument_types(function: Callable[..., Any], precision: Precision) -> tuple[tuple[str, int], ...]:
    """Type name and number of dimensions of each argument of a kernel, 0 for scalars."""
    found = []
    for annotation in [text for name, text in function.__annotations__.items() if name != "return"]:
        dtype, ndim = _ARRAYS.get(annotation) or (_SCALARS[annotation], 0)
        found.append((dtype or precision, ndim))
    return tuple(found)
