# SPDX-License-Identifier: BSD-3-Clause
"""Arrays on their way to the host while the device goes on: pinned memory, a stream of their own, and events."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cuda.jit import cuda
from femgal.kernels.cuda.stream import Stream


class Arriving:
    """An array that has been sent home; calling it waits for it.

    Parameters
    ----------
    source : Of the device. It is kept until the copy has been taken over: memory that nobody holds is handed out again.
    buffer : Pinned memory that the copy goes to; it is used again when nobody holds this object any more.
    arrived : Event behind the copy.
    """

    def __init__(self, source: Any, buffer: NDArray[Any], arrived: Any) -> None:
        self._source, self._buffer, self._arrived = source, buffer, arrived
        self._values: NDArray[Any] | None = None

    def __call__(self) -> NDArray[Any]:
        """The values, in memory of their own."""
        if self._values is None:
            self._arrived.synchronize()
            self._values, self._source = self._buffer.copy(), None
        return self._values


class Homeward:
    """Sends arrays home.

    Parameters
    ----------
    stream : In which the arrays are made: a copy begins when all that was launched there before is done.
    """

    def __init__(self, stream: Stream) -> None:
        self._main, self._own = stream, cuda.stream()
        # Pinning memory takes longer than copying it. A buffer whose copy nobody waited for may be given to another
        # copy at once: copies are made in their order.
        self._free: dict[tuple[int, str], list[NDArray[Any]]] = {}

    def send(self, values: Any) -> Arriving:
        """Begin to copy a device array."""
        made, arrived = cuda.event(), cuda.event()
        made.record(self._main.handle)
        made.wait(self._own)
        free = self._free.setdefault((math.prod(values.shape), np.dtype(values.dtype).name), [])
        base = free.pop() if free else cuda.pinned_array(math.prod(values.shape), values.dtype)
        buffer = base.reshape(values.shape)
        if buffer.size:
            values.copy_to_host(buffer, stream=self._own)
        arrived.record(self._own)
        arriving = Arriving(values, buffer, arrived)
        weakref.finalize(arriving, free.append, base).atexit = False
        return arriving
