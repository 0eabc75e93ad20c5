# SPDX-License-Identifier: BSD-3-Clause
"""Cases about derivatives of the energy.

1. Every quick row passes.
2. The exact difference of a polynomial of degree six is its derivative, of degree seven it is not.
3. A gradient that is off by a part in a million, a product whose last term is off by a part in a thousand, and one that
   is not symmetric are each seen by the rows named for them, in float32 too.
4. Passes that return zeros or NaN are red, not skipped: only a user's own mesh may drown in rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from verify.cases.derivatives import exact_derivative
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use


def test_quick_rows_pass():
    rows = choose("derivatives/*", quick=True)
    assert len(rows) >= 20
    assert [str(one.row) for one in run(rows, Use()) if one.status is not Status.PASS] == []


def test_exact_derivative():
    six, seven = np.poly1d([3.0, -2.0, 5.0, 0.5, -7.0, 11.0, 13.0]), np.poly1d([1.0, *[0.0] * 7])
    assert exact_derivative(six) == pytest.approx(11.0, rel=1e-13)
    assert abs(exact_derivative(seven)) > 1.0


class Faulty:
    """Production passes with a fault in the gradient or in the Hessian product."""

    def __init__(self, backend, gradient, product) -> None:
        self.backend, self.wrong_gradient, self.wrong_product = backend, gradient, product

    def __getattr__(self, name):
        return getattr(self.backend, name)

    def gradient(self, x):
        return self.wrong_gradient(self.backend.gradient(x))

    def hessian_product(self, x, d, *, definite=False):
        return self.wrong_product(self.backend.hessian_product(x, d, definite=definite), d)


@dataclass(frozen=True)
class FaultyUse(Use):
    """The suite with a fault in production."""

    wrong_gradient: object = lambda f: f
    wrong_product: object = lambda f, d: f

    def backend(self, disc, precision="float64"):
        return Faulty(super().backend(disc, precision), self.wrong_gradient, self.wrong_product)


GRADIENT = {"wrong_gradient": lambda f: 1.000001 * f}
COARSE_GRADIENT = {"wrong_gradient": lambda f: 1.001 * f}
PRODUCT = {"wrong_product": lambda f, d: 1.001 * f}
SKEW = {"wrong_product": lambda f, d: f + 1e-3 * np.abs(f).mean() * np.cross(d, [1.0, 2.0, 3.0])}
GROUNDED = {"wrong_product": lambda f, d: f + 1e-2 * np.abs(f).mean() * d}


class Blank:
    """Passes that all return one number."""

    def __init__(self, backend, number) -> None:
        self.backend, self.number = backend, number

    def gradient(self, x):
        return np.full_like(x, self.number)

    def hessian_product(self, x, d, *, definite=False):
        return np.full_like(d, self.number)

    def energies(self, x):
        energy, J = self.backend.energies(x)
        return np.full_like(energy, self.number), J


@dataclass(frozen=True)
class BlankUse(Use):
    """The suite with production that computes nothing."""

    number: float = 0.0

    def backend(self, disc, precision="float64"):
        return Blank(super().backend(disc, precision), self.number)


@pytest.mark.parametrize("number", [0.0, np.nan])
@pytest.mark.parametrize("name", ["taylor-energy", "taylor-energy-hessian", "taylor-forces"])
def test_passes_that_compute_nothing_are_red(name, number):
    for row in choose(f"derivatives/{name}[rabbit,*"):
        assert run_row(row, BlankUse(number=number)).status is Status.FAIL


def test_products_that_are_no_numbers_are_red():
    for row in choose("derivatives/definite-part[*,rabbit]"):
        assert run_row(row, BlankUse(number=np.nan)).status is Status.FAIL


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (COARSE_GRADIENT, "derivatives/taylor-energy[rabbit,random]"),
        (GRADIENT, "derivatives/exact-slope[float64,random]"),
        (COARSE_GRADIENT, "derivatives/exact-slope[float32,random]"),
        (PRODUCT, "derivatives/taylor-energy-hessian[rabbit,random]"),
        (PRODUCT, "derivatives/taylor-forces[rabbit,random]"),
        (PRODUCT, "derivatives/exact-product[float32,random]"),
        (PRODUCT, "derivatives/rigid-products[float32,rabbit,random]"),
        (SKEW, "derivatives/symmetry[float32,rabbit,exact]"),
        (GROUNDED, "derivatives/null-space[float32,exact]"),
    ],
)
def test_faults_are_noticed(fault, name):
    (row,) = choose(name)
    assert run_row(row, Use()).status is Status.PASS
    assert run_row(row, FaultyUse(**fault)).status is Status.FAIL
