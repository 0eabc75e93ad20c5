# SPDX-License-Identifier: BSD-3-Clause
"""The stored form of arrays.

1. Element types: float64 -> float32, bool -> uint8, int64 -> int32 where it fits and int64 where it does not.
2. Shapes: 3x3 tensors become 9 components row by row, 2-D vectors get a zero third component.
3. Wrong row counts, too many axes, text and names with a slash are refused with the values met.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.output.arrays import storable


@pytest.mark.parametrize(
    ("values", "stored"),
    [
        (np.array([0.5, 1.5]), np.float32),
        (np.array([0.5, 1.5], np.float16), np.float32),
        (np.array([True, False]), np.uint8),
        (np.array([1, 255], np.uint8), np.uint8),
        (np.array([-1, 2**31 - 1]), np.int32),
        (np.array([-1, 2**31]), np.int64),
    ],
)
def test_element_types(values, stored):
    array = storable("a", values, 2)
    assert array.dtype == stored
    assert np.array_equal(array, values)


def test_shapes():
    tensor = np.arange(18.0).reshape(2, 3, 3)
    assert np.array_equal(storable("t", tensor, 2), np.arange(18.0).reshape(2, 9))
    assert np.array_equal(storable("v", np.ones((2, 2)), 2), [[1, 1, 0], [1, 1, 0]])
    assert storable("f", np.asfortranarray(np.ones((4, 3))), 4).flags.c_contiguous


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("a", np.ones(3), r"shape \(3,\), needed \[2"),
        ("a", 1.0, r"shape \(\)"),
        ("a", np.ones((2, 1, 1, 1)), "4 axes"),
        ("a", np.array(["x", "y"]), "<U1"),
        ("a/b", np.ones(2), "'a/b'"),
    ],
)
def test_refusals(name, values, message):
    with pytest.raises(ValueError, match=message):
        storable(name, values, 2)
