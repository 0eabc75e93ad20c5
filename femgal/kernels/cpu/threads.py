# SPDX-License-Identifier: BSD-3-Clause
"""Threads of our own for range kernels: no threading layer, no fork trap, half the compile time of parallel loops."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

# Handing a range to another thread costs some 20 us; below this many rows or pairs the range is cheaper than that.
SMALLEST_SHARE = 1024


class Workers:
    """Runs kernel(start, stop, *arguments) over consecutive ranges, one range per thread.

    Kernels release the GIL and write only the rows of their range, so the number of threads never changes a bit.

    Parameters
    ----------
    threads : Number of threads, 1 or more; None takes the processors that this process may use.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads or len(os.sched_getaffinity(0))
        self._pool: ThreadPoolExecutor | None = None
        self._pool_of = 0

    def run(
        self, kernel: Callable[..., None], rows: int, *arguments: object, smallest_share: int | None = None
    ) -> None:
        """Call the kernel over rows 0 to rows - 1, shared out evenly, and wait for all ranges.

        No thread gets fewer than `smallest_share` rows; left out, rows are taken for small pieces of work.
        """
        shares = min(self.threads, max(1, rows // (smallest_share or SMALLEST_SHARE)))
        self._run(kernel, [rows * k // shares for k in range(shares + 1)], arguments)

    def run_ragged(self, kernel: Callable[..., None], ptr: NDArray[np.int64], *arguments: object) -> None:
        """Call the kernel over rows 0 to len(ptr) - 2, shared out by the number of pairs that the rows own."""
        pairs = int(ptr[-1])
        shares = min(self.threads, max(1, pairs // SMALLEST_SHARE), max(1, len(ptr) - 1))
        inner = np.searchsorted(ptr, [pairs * k // shares for k in range(1, shares)]).tolist()
        self._run(kernel, [0, *inner, len(ptr) - 1], arguments)

    def _run(self, kernel: Callable[..., None], bounds: list[int], arguments: tuple[object, ...]) -> None:
        if len(bounds) == 2:
            kernel(bounds[0], bounds[1], *arguments)
            return
        if self._pool is None or self._pool_of != os.getpid():
            # A forked child has its parent's pool but none of its threads.
            self._pool, self._pool_of = ThreadPoolExecutor(self.threads - 1), os.getpid()
        futures = [self._pool.submit(kernel, start, stop, *arguments) for start, stop in pairwise(bounds[1:])]
        kernel(bounds[0], bounds[1], *arguments)
        for future in futures:
            future.result()
