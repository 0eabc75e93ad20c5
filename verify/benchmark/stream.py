# SPDX-License-Identifier: BSD-3-Clause
"""Sustainable memory bandwidth: the triad of the STREAM benchmark (McCalpin 1995), a = b + s c."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.threads import Workers
from meshes.jit import kernel
from verify.benchmark.memory import require_memory

Floats = NDArray[np.float64]

# Larger than any cache by far: smaller arrays measure a cache that other users of the machine may take any moment.
DEFAULT_MEGABYTES = 900.0
SCALE = 3.0


@kernel
def triad(start: int, stop: int, a: Floats, b: Floats, c: Floats, s: float) -> None:
    """a = b + s c over a range."""
    for i in range(start, stop):
        a[i] = b[i] + s * c[i]


@kernel
def _fill(start: int, stop: int, a: Floats, b: Floats, c: Floats) -> None:
    for i in range(start, stop):
        a[i], b[i], c[i] = 0.0, 1.0, 2.0


class Stream:
    """Three float64 arrays and the triad over them.

    Parameters
    ----------
    megabytes : Size of each of the three arrays [10^6 bytes].

    Raises
    ------
    InputError
        The arrays do not fit into the memory that is left.
    """

    def __init__(self, megabytes: float = DEFAULT_MEGABYTES) -> None:
        advice = "a smaller --stream-mb; bandwidth counts only well beyond the caches"
        require_memory(3e6 * megabytes, "the three arrays of STREAM", where="--stream-mb", advice=advice)
        n = max(1, int(megabytes * 1e6 / 8))
        self.a, self.b, self.c = np.empty(n), np.empty(n), np.empty(n)
        # Pages are handed out when they are first written to, which is no part of the bandwidth.
        _fill(0, n, self.a, self.b, self.c)

    @property
    def bytes_moved(self) -> int:
        """Bytes of one triad as STREAM counts them: two arrays read, one written."""
        return 3 * self.a.nbytes

    def run(self, workers: Workers) -> None:
        """One triad."""
        workers.run(triad, len(self.a), self.a, self.b, self.c, SCALE)
