# SPDX-License-Identifier: BSD-3-Clause
"""Values on the surface of a mesh.

The weighted vertex average of a constant is the constant, and of two cells their weighted mean.
"""

from __future__ import annotations

import numpy as np

from femgal.output.boundary import vertex_average


def test_vertex_average():
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]], np.int32)
    mean = vertex_average(np.array([2.0, 5.0]), cells, np.array([1.0, 3.0]))
    assert mean.tolist() == [2.0, 4.25, 4.25, 4.25, 5.0]
    constant = vertex_average(np.full(2, 7.0), cells, np.array([0.1, 0.7]))
    assert np.allclose(constant, 7.0, rtol=1e-15)
