# SPDX-License-Identifier: BSD-3-Clause
"""Numbers that are fetched when somebody looks.

1. Nothing is read before, and everything anew at each look.
2. The largest of some numbers is not a number where one of them is not, wherever it stands; empty gives zero.
"""

from __future__ import annotations

import math

import pytest

from femgal.kernels.deferred import Deferred, largest_of, times


def test_read_at_each_look():
    looks: list[int] = []
    number = times(2.0, Deferred(lambda: float(len(looks.__iadd__([1])))))
    assert looks == []
    assert [float(number), float(number)] == [2.0, 4.0]


@pytest.mark.parametrize("wrap", [float, lambda value: Deferred(lambda: value)])
@pytest.mark.parametrize("values", [(0.3, math.nan, 0.2), (math.nan, 0.1, 0.4), (0.1, math.nan)])
def test_largest_is_no_number(wrap, values):
    assert math.isnan(float(largest_of([wrap(value) for value in values])))


def test_largest():
    assert largest_of([]) == 0.0
    assert largest_of([0.25, 0.5, 0.125]) == 0.5
    assert times(3.0, 0.5) == 1.5
    assert float(largest_of([0.25, Deferred(lambda: 0.75)])) == 0.75
