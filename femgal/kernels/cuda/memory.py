# SPDX-License-Identifier: BSD-3-Clause
"""Device arrays that are used again: allocating on a device waits for all that runs there."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from femgal.kernels.cuda.jit import cuda


class Pool:
    """Hands out device arrays and takes them back when nobody holds them any more.

    All work is in one stream, so an array may be handed out again while a kernel that was launched before still uses
    it: what is launched later runs later. Whoever keeps a slice must keep the array, too.
    """

    def __init__(self) -> None:
        self._free: dict[tuple[int, str], list[Any]] = {}
        self.nbytes = 0

    def take(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> Any:
        """An array of this shape with any contents."""
        kind, count = np.dtype(dtype), max(1, math.prod(shape))
        free = self._free.setdefault((count, kind.name), [])
        if not free:
            self.nbytes += count * kind.itemsize
        base = free.pop() if free else cuda.device_array((1, 1, count), kind)
        if math.prod(shape) == 0:
            return base.reshape(count)[:0].reshape(shape)
        view = base.reshape(shape)
        weakref.finalize(view, free.append, base).atexit = False
        return view
