# SPDX-License-Identifier: BSD-3-Clause
"""A Galerkin multigrid cycle: levels with their smoothers, and how they hang together."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.dense import DenseSolver
from femgal.assembly.galerkin import GalerkinProduct
from femgal.assembly.matrix import BlockMatrix
from femgal.assembly.smoothing import (
    chebyshev_coefficients,
    invert_blocks,
    largest_eigenvalue,
    prolong,
    restrict,
    scale_blocks,
    smooth,
    subtract_product,
)

Reals = NDArray[np.floating]

SEED = 60_091_837

# The smoother takes care of the eigenvalues of D^-1 A from lambda_max / SMOOTHED on; the bottom, where it cannot be
# solved directly, of all above lambda_max / SOLVED.
SMOOTHED, SOLVED = 5.0, 100.0

# Power iterations end some per cent below lambda_max, and a mode above the interval would be amplified.
SAFETY = 1.1

# Power iterations, from the same random vector every time: what a cycle does must not depend on earlier matrices.
ITERATIONS = 15


@dataclass(eq=False)
class Level:
    """One matrix with its smoother.

    Parameters
    ----------
    A : The matrix; its values may change between calls of `refresh`.
    degree : Of the Chebyshev polynomial.
    smoothed : Ratio of the largest eigenvalue to the smallest that the polynomial takes care of.
    """

    A: BlockMatrix
    degree: int
    smoothed: float = SMOOTHED
    _inverse: Reals = field(init=False, repr=False)
    _start: Reals = field(init=False, repr=False)
    _work: tuple[Reals, ...] = field(init=False, repr=False)
    _lambda: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        n, dtype = self.A.n_rows, self.A.values.dtype
        self._inverse = np.empty((n, 6), dtype)
        self._start = np.random.default_rng(SEED).standard_normal((n, 3)).astype(dtype)
        self._work = tuple(np.empty((n, 3), dtype) for _ in range(4))

    @property
    def largest_eigenvalue(self) -> float:
        """Estimate of lambda_max(D^-1 A)."""
        return self._lambda

    @property
    def inverse_blocks(self) -> Reals:
        """Inverse diagonal blocks of the matrix, shape [k, 6]."""
        return self._inverse

    @property
    def coefficients(self) -> list[tuple[float, float]]:
        """Of the smoother's polynomial (`femgal.assembly.smoothing.chebyshev_coefficients`)."""
        highest = SAFETY * self._lambda
        return chebyshev_coefficients(highest / self.smoothed, highest, self.degree)

    def refresh(self) -> None:
        """Blocks and largest eigenvalue of the present matrix."""
        A = self.A
        A.workers.run(invert_blocks, A.n_rows, A.pattern.diagonal, A.values, self._inverse)
        self._lambda = largest_eigenvalue(A, self._inverse, self._start.copy(), ITERATIONS)

    def solve(self, r: Reals) -> Reals:
        """What the polynomial makes of A^-1 r; an array of this level, overwritten by its next use."""
        (_, b), *steps = self.coefficients
        one, _, _, _ = self._work
        self.A.workers.run(scale_blocks, self.A.n_rows, self._inverse, self._real(b), r, one)
        return self._iterate(steps, r, one)

    def smooth(self, r: Reals, x: Reals) -> Reals:
        """x improved; both it and the result are arrays of this level."""
        return self._iterate(self.coefficients, r, x)

    def _iterate(self, steps: list[tuple[float, float]], r: Reals, x: Reals) -> Reals:
        one, other, d, _ = self._work
        A, before = self.A, x
        matrix = (A.pattern.ptr, A.pattern.column, A.values, self._inverse)
        for a, b in steps:
            out = other if x is one else one
            A.workers.run_ragged(smooth, A.pattern.ptr, *matrix, self._real(a), self._real(b), r, x, before, d, out)
            x, before = out, d
        return x

    def _real(self, value: float) -> np.floating:
        return self.A.values.dtype.type(value)

    def residual(self, r: Reals, x: Reals) -> Reals:
        """r - A x, an array of this level."""
        A, out = self.A, self._work[3]
        A.workers.run_ragged(subtract_product, A.pattern.ptr, A.pattern.ptr, A.pattern.column, A.values, x, r, out)
        return out


@dataclass(eq=False)
class VCycle:
    """Symmetric V-cycle: smooth, correct on the next coarser level, smooth.

    Parameters
    ----------
    levels : Finest first.
    products : How the matrix of each level makes that of the next.
    bottom : Of the coarsest matrix; a level where that is too large to be solved directly.
    """

    levels: list[Level]
    products: list[GalerkinProduct]
    bottom: DenseSolver | Level
    _right: list[Reals] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._right = [np.empty((p.transfer.n_coarse, 3), p.transfer.weight.dtype) for p in self.products]

    def refresh(self) -> None:
        """Make all coarse matrices and smoothers anew from the finest matrix."""
        below = [*(level.A for level in self.levels[1:]), self.bottom.A]
        for number, level in enumerate(self.levels):
            level.refresh()
            self.products[number].coarsen(level.A, below[number])
        self.bottom.refresh()

    def solve(self, r: Reals, number: int = 0) -> Reals:
        """One cycle for A x = r from zero, on a level and all below it; returns an array of that level."""
        if number == len(self.levels):
            return self.bottom.solve(r)
        level, t, right = self.levels[number], self.products[number].transfer, self._right[number]
        x, workers = level.solve(r), level.A.workers
        children = (t.child_ptr, t.child, t.child_weight)
        workers.run_ragged(restrict, t.child_ptr, *children, level.residual(r, x), right)
        workers.run(prolong, t.n_fine, t.parent, t.weight, self.solve(right, number + 1), x)
        return level.smooth(r, x)
