# SPDX-License-Identifier: BSD-3-Clause
"""The one stream that all work of a backend is in, and what has been launched there, to be launched again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Prescribed
from femgal.kernels.cuda.jit import SIMULATED, cuda

# Threads of a block; in the simulator, where each is a thread of Python, few.
THREADS = 4 if SIMULATED else 256

# Blocks of a launch over rows, each thread taking several where there are more rows than that.
MOST_BLOCKS = 65_535


@dataclass(frozen=True, eq=False)
class Launch:
    """One launch of a kernel; it keeps the arrays that it uses.

    Parameters
    ----------
    kernel, arguments : What was launched.
    blocks, threads, shared : Grid, and bytes of dynamic shared memory.
    """

    kernel: Any
    blocks: int
    threads: int
    shared: int
    arguments: tuple[Any, ...]

    def run(self, stream: Any) -> None:
        """Launch in a stream, or into a graph under construction."""
        self.kernel[self.blocks, self.threads, stream, self.shared](*self.arguments)


@dataclass(frozen=True, eq=False)
class Upload:
    """Positions of prescribed vertices at a time, to be sent to the device.

    Parameters
    ----------
    motion : Gives the positions.
    time : [s]; in a recording, after the beginning of the step.
    target : Array of the device, shape [k, 3].
    """

    motion: Prescribed
    time: float
    target: Any

    def run(self, stream: Stream, start: float = 0.0) -> None:
        """Send them."""
        stream.send(self.motion.positions(start + self.time), self.target)


class Stream:
    """Launches kernels, copies arrays, and remembers launches while it is asked to.

    Attributes
    ----------
    launches : Kernels and graphs launched so far.
    waits : How often the host has waited for the device.
    exchanges : How often a number has gone from one to the other, prescribed positions left out.
    """

    def __init__(self) -> None:
        self.handle = cuda.stream()
        self.launches = 0
        self.waits = 0
        self.exchanges = 0
        self._record: list[Launch] | None = None
        self._uploads: list[Upload] = []

    def over_rows(self, kernel: Any, rows: int, *arguments: Any) -> None:
        """Launch a kernel whose threads share out rows."""
        self.over_blocks(kernel, blocks_for(rows), THREADS, 0, *arguments)

    def over_blocks(self, kernel: Any, blocks: int, threads: int, shared: int, *arguments: Any) -> None:
        """Launch a kernel with a number of blocks, and nothing where there are none."""
        if blocks == 0:
            return
        one = Launch(kernel, blocks, min(threads, THREADS), shared, arguments)
        self.launches += 1
        if self._record is not None:
            self._record.append(one)
        one.run(self.handle)

    def upload(self, values: NDArray[Any], to: Any) -> Any:
        """Copy a host array into a device array of its shape and type, which is returned."""
        self.exchanges += 1
        self.send(values, to)
        return to

    def upload_later(self, upload: Upload) -> None:
        """Send prescribed positions, now and, where a step is being recorded, whenever it is repeated."""
        if self._record is not None:
            self._uploads.append(upload)
        upload.run(self)

    def send(self, values: NDArray[Any], to: Any) -> None:
        """Copy a host array into a device array."""
        if values.size:
            to.copy_to_device(np.ascontiguousarray(values), stream=self.handle)

    def download(self, values: Any) -> NDArray[Any]:
        """The host's copy of a device array, after all that was launched before."""
        self.waits += 1
        self.exchanges += 1
        host = np.empty(values.shape, values.dtype)
        if host.size:
            values.copy_to_host(host, stream=self.handle)
            self.handle.synchronize()
        return host

    def wait(self) -> None:
        """Wait for all that was launched."""
        self.waits += 1
        self.handle.synchronize()

    def record(self, work: Callable[[], Any], start: float) -> tuple[Any, list[Launch], list[Upload]]:
        """Do some work that begins at a time [s]; with its result, its launches and uploads."""
        launches: list[Launch] = []
        self._record, self._uploads = launches, []
        try:
            result = work()
        finally:
            self._record = None
        return result, launches, [replace(one, time=one.time - start) for one in self._uploads]


def blocks_for(rows: int) -> int:
    """Blocks of a launch over rows."""
    return min(MOST_BLOCKS, -(-rows // THREADS))
