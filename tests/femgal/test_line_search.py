# SPDX-License-Identifier: BSD-3-Clause
"""How far to go along a correction, from the polynomial of the potential.

1. `change` is the polynomial.
2. The first minimum is the smallest positive stationary point, of corrections at the size of rounding too.
3. Backtracking takes the first of start, start / 2, ... that gains Armijo's share, whatever the polynomial.
4. Neither ever raises the potential; both stay where it does not fall, and say NaN to coefficients that are none.
5. Along real corrections, from all kinds of states, both lower the energy that the elements have there.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.line_search import SUFFICIENT, backtrack, change, first_minimum
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import STATES, distorted_box, left_end, positions, rng, uniform

SEARCHES = (first_minimum, backtrack)


def random_coefficients(count: int) -> np.ndarray:
    """Polynomials that fall at zero, over 24 decades, and rise in the end; shape [count, 6]."""
    c = rng(210).standard_normal((count, 6)) * 10.0 ** rng(211).uniform(-12.0, 12.0, (count, 1))
    c[:, 0], c[:, 5] = -np.abs(c[:, 0]), np.abs(c[:, 5])
    return c


def test_change_is_the_polynomial():
    for c in random_coefficients(50):
        t = 1.7
        assert change(c, t) == pytest.approx(np.polynomial.polynomial.polyval(t, [0.0, *c]), rel=1e-12)


def test_first_minimum():
    # (t - 1)(t - 2) as slope: the minimum of -(...) is at 1 only when the slope at 0 is negative.
    assert first_minimum(np.array([-2.0, 1.5, -1.0 / 3.0, 0, 0, 0])) == pytest.approx(1.0, rel=1e-12)
    assert first_minimum(np.array([-2.0, 1.0, 0, 0, 0, 0])) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("scale", [1e-3, 1e-6, 1e-9, 1e-12])
def test_first_minimum_of_small_corrections(scale):
    # Coefficients of a correction of relative size s go as s, s^2 (times the gradient's own s), s^3, ...
    c = np.array([-1.3, 1.0, 0.7, -0.4, 0.2, 0.1]) * [scale**2, *(scale ** np.arange(2, 7))]
    assert first_minimum(c) == pytest.approx(0.65, rel=10.0 * scale + 1e-9)


@pytest.mark.parametrize("size", [1e-16, 1e-8, 1e-3, 0.02, 0.04, 0.3])
def test_first_minimum_near_a_quadratic(size):
    # On both sides of where higher terms are too small for more than one root.
    for c in rng(212).uniform(-size, size, (40, 4)):
        t = first_minimum(np.array([-2.0, 1.0, *c]) * 1e-7)
        slope = np.array([-2.0, 2.0, *(c * [3, 4, 5, 6])])
        roots = np.roots(slope[::-1])
        first = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].min(initial=math.inf)
        assert t == (pytest.approx(first, rel=1e-9) if math.isfinite(first) else 0.0)


def test_backtrack():
    # -t + a t^2 gains Armijo's share up to t = (1 - share) / a.
    for a, expected in ((0.9, 1.0), (1.1, 0.5), (3.0, 0.25), (100.0, 2.0**-7)):
        assert backtrack(np.array([-1.0, a, 0, 0, 0, 0])) == expected
    assert backtrack(np.array([-1.0, 1.1, 0, 0, 0, 0]), start=0.9) == 0.9
    assert backtrack(np.array([-1.0, 1.2, 0, 0, 0, 0]), start=0.9) == 0.45


def test_backtracking_takes_the_first_step_that_is_good_enough():
    for c in random_coefficients(500):
        t = backtrack(c)
        assert change(c, t) <= SUFFICIENT * t * c[0] < 0.0
        assert t == 1.0 or change(c, 2.0 * t) > SUFFICIENT * 2.0 * t * c[0]
        assert math.frexp(t)[0] == 0.5


@pytest.mark.parametrize("search", SEARCHES)
def test_never_uphill(search):
    for c in random_coefficients(500):
        assert change(c, search(c)) < 0.0


@pytest.mark.parametrize("search", SEARCHES)
def test_nothing_to_gain(search):
    assert search(np.array([1.0, 1.0, 0, 0, 0, 0])) == 0.0
    assert search(np.zeros(6)) == 0.0
    for bad in (np.inf, -np.inf, np.nan):
        assert math.isnan(search(np.array([-1.0, bad, 0, 0, 0, 0])))


MESH = distorted_box((4, 3, 2))
DISC = uniform(MESH, left_end(MESH))


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("search", SEARCHES)
def test_lowers_the_energy_of_the_elements(search, state):
    x = np.where(DISC.free[:, None], positions(MESH, state), MESH.points)
    xhat = x + 0.05 * rng(212).standard_normal(x.shape) * DISC.free[:, None]
    phi = IncrementalPotential(CpuBackend(DISC, 1), xhat, 0.03)
    layer = phi.backend.vertices
    dx, slope = phi.backend.correction(layer, x, xhat, phi.inverse_h2)
    d = np.zeros_like(x)
    phi.backend.prolong(layer, dx, d)
    c = phi.along(layer, x, d)
    assert c[0] == pytest.approx(slope, rel=1e-9)
    t = search(c)
    assert t > 0.0
    assert phi.value(x + t * d) - phi.value(x) == pytest.approx(change(c, t), rel=1e-6)
    assert change(c, t) < 0.0
