# SPDX-License-Identifier: BSD-3-Clause
"""The model of bytes moved.

1. The element phase is its data: 11 values in its precision and four numbers of 16 bits; 52 and 96 bytes.
2. With block output 78 and 149; a vector is a third of that output.
3. Node work is the size of its float64 arrays.
"""

from __future__ import annotations

import numpy as np
import pytest

from verify.benchmark import traffic


@pytest.mark.parametrize(("precision", "element", "blocks"), [("float32", 52, 78), ("float64", 96, 149)])
def test_element_passes(precision, element, blocks):
    assert traffic.element_bytes(precision) == element == 11 * np.dtype(precision).itemsize + 4 * 2
    assert traffic.block_bytes(precision) == blocks
    assert 3 * (traffic.vector_bytes(precision) - element) == pytest.approx(blocks - element, rel=1e-14)
    assert traffic.energy_bytes(precision) == element + np.empty(2).nbytes


def test_node_work():
    nodes, vertices = 700, 900
    g, H, dx = np.empty((nodes, 3)), np.empty((nodes, 6)), np.empty((nodes, 3))
    assert traffic.solve_bytes(nodes) == g.nbytes + H.nbytes + dx.nbytes
    x, parent = np.empty((vertices, 3)), np.empty(vertices, np.int32)
    assert traffic.prolongation_bytes(nodes, vertices) == dx.nbytes + parent.nbytes + 2 * x.nbytes
