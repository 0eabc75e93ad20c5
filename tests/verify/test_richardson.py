# SPDX-License-Identifier: BSD-3-Clause
"""Richardson's extrapolation.

1. Of f + a h^p it gives f and p for any p, and an index of 1.25 times the error.
2. It refuses values that do not converge.
"""

from __future__ import annotations

import pytest

from verify.reference.richardson import extrapolate


@pytest.mark.parametrize("p", [0.7, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("a", [-0.3, 2.0])
def test_power_law(p, a):
    values = [5.0 + a * h**p for h in (0.4, 0.2, 0.1)]
    limit = extrapolate(values)
    assert limit.value == pytest.approx(5.0, rel=1e-12)
    assert limit.order == pytest.approx(p, rel=1e-9)
    assert limit.gci == pytest.approx(1.25 * abs(values[-1] - 5.0) / values[-1], rel=1e-9)
    assert extrapolate([99.0, *values]) == limit


@pytest.mark.parametrize("values", [(1.0, 2.0, 4.0), (1.0, 2.0, 1.5), (1.0, 2.0, 3.0)])
def test_no_convergence(values):
    with pytest.raises(ArithmeticError, match="no convergence"):
        extrapolate(values)
