# SPDX-License-Identifier: BSD-3-Clause
"""STREAM triad.

1. The kernel writes a = b + s c in its range and nowhere else.
2. A run covers all of the arrays, whatever the number of threads.
3. Three arrays of the size asked for; bytes as STREAM counts them: 24 per element.
4. Arrays that do not fit into memory are refused with advice.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.kernels.cpu.threads import Workers
from meshes.errors import InputError
from verify.benchmark.stream import SCALE, Stream, triad
from verify.problems.bodies import rng


def test_triad():
    b, c = rng(901).standard_normal((2, 1000))
    a = np.full(1000, -7.0)
    triad(100, 900, a, b, c, 1.75)
    # A fused multiply-add rounds once, NumPy twice.
    np.testing.assert_allclose(a[100:900], (b + 1.75 * c)[100:900], rtol=0, atol=1e-15)
    assert (a[:100] == -7.0).all()
    assert (a[900:] == -7.0).all()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_run_covers_everything(threads):
    stream = Stream(0.2)
    stream.b[:] = np.arange(len(stream.b))
    assert (stream.a == 0.0).all()
    stream.run(Workers(threads))
    assert (stream.a == np.arange(len(stream.b)) + SCALE * stream.c).all()


def test_sizes():
    stream = Stream(0.8)
    assert [len(array) for array in (stream.a, stream.b, stream.c)] == [100_000] * 3
    assert stream.bytes_moved == 24 * 100_000


def test_refusal():
    with pytest.raises(InputError, match="--stream-mb") as caught:
        Stream(1e9)
    for text in ("3000000000 MB", "available", "smaller --stream-mb"):
        assert text in str(caught.value)
