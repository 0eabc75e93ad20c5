# SPDX-License-Identifier: BSD-3-Clause
"""The scalable Galerkin multigrid method (SGM) of Xian et al. 2019: V-cycles over assembled levels of affine handles.

What it is: Newton's method, whose linear systems are solved by V-cycles; coarse matrices P^T A P, level by level;
handles with 12 unknowns and piecewise-constant weights (`verify.solvers.handles`). Lu et al. 2025 (section 6.1) run it
with one multigrid iteration per substep and without Chebyshev acceleration.

Chosen here, where that leaves it open:

1. Smoothing is damped block Jacobi, with blocks of 3 x 3 on the vertices and 12 x 12 on the handles, as often before as
   after the coarse correction, so that the cycle is symmetric. Its step is 4 / (3 lambda) with lambda the largest
   eigenvalue of D^-1 A, from power iterations that go on from one Newton system to the next.
2. Clusters of 64 vertices, then of 8 clusters, until at most 100 are left; their matrix is solved by Cholesky's method.
   Of 32 to 128 vertices and 8 or 16 clusters this took the least CPU time on a bunny of 2,000 and 20,000 vertices.
3. A system is solved by conjugate gradients with the cycle as preconditioner. Without `accelerate` cycles follow each
   other, two to eight times as many. One linear and one Newton iteration without acceleration are the multigrid
   iteration per substep of Lu et al. 2025.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.threads import Workers
from verify.solvers.conjugate_gradients import LinearSolution, Map
from verify.solvers.handle_matrices import HandleMatrix, multiply_blocks, prolong, restrict
from verify.solvers.handles import Handles, build_handles
from verify.solvers.system import AssembledSystem

Floats = NDArray[np.float64]

# The bottom is solved densely: at most so many handles, 12 unknowns each.
BOTTOM = 100

# Power iterations of the first estimate, and of each that goes on from the last one.
_FIRST, _NEXT = 20, 3

# Step length times largest eigenvalue: reduces both ends of the upper half of the spectrum to a third.
_SMOOTHING = 4.0 / 3.0


@dataclass(eq=False)
class SGM(AssembledSystem):
    """V-cycles on levels of handles.

    Parameters
    ----------
    cluster : Vertices per handle of the first level.
    ratio : Handles per handle of the next level.
    smoothings : Before and after the coarse correction.
    accelerate : Conjugate gradients around the cycles.
    """

    cluster: int = 64
    ratio: int = 8
    smoothings: int = 1
    accelerate: bool = True
    _handles: tuple[Handles, ...] = field(init=False, repr=False)
    _levels: list[HandleMatrix] = field(init=False, repr=False)
    _smoothers: list[_Smoother] = field(init=False, repr=False)
    _factor: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        workers = Workers(self.backend.threads)
        self._handles = build_handles(self.backend.disc, self.cluster, self.ratio, BOTTOM)
        pattern, self._levels = self.matrix.pattern, []
        for handles in self._handles:
            self._levels.append(HandleMatrix.of(pattern, handles, workers))
            pattern = self._levels[-1].pattern
        self._smoothers = [_Smoother(self.matrix.pattern.n_rows, 3)]
        self._smoothers += [_Smoother(level.pattern.n_rows, 12) for level in self._levels[:-1]]

    def set_up(self, x: Floats) -> None:
        """Matrices of all levels, blocks and steps of their smoothers, factor of the last."""
        from scipy.linalg import cho_factor

        pattern, transposed = self.matrix.pattern, self.matrix.values.reshape(-1, 3, 3).transpose(0, 2, 1)
        for handles, level in zip(self._handles, self._levels, strict=True):
            level.project(pattern, transposed, handles)
            pattern, transposed = level.pattern, level.values
        H = self.matrix.diagonal_blocks().astype(np.float64)
        self._smoothers[0].set_up(self.product, lambda r: self.backend.solve(r, H, -1.0))
        for smoother, level in zip(self._smoothers[1:], self._levels, strict=False):
            smoother.set_up(level.product, _block_map(level))
        self._factor = cho_factor(self._levels[-1].dense(), lower=True, overwrite_a=True, check_finite=False)

    def precondition(self, r: Floats) -> Floats:
        """One V-cycle from zero."""
        return self._cycle(0, r)

    def solve(self, b: Floats, tolerance: float) -> LinearSolution:
        """Conjugate gradients, or cycles from zero."""
        if self.accelerate:
            return super().solve(b, tolerance)
        return self._cycles(b, tolerance)

    def _cycles(self, b: Floats, tolerance: float) -> LinearSolution:
        """Cycles from zero: where A is positive definite each takes d . A d / 2 - b . d = -d . (b + r) / 2 down."""
        d, r, done, energy = np.zeros_like(b), b.copy(), 0, 0.0
        first = left = float(np.linalg.norm(b))
        while done < self.iterations and left > tolerance * first:
            before = d.copy()
            self.backend.add_scaled(d, 1.0, self._cycle(0, r))
            r = self.backend.difference(b, self.product(d))
            db, dr = self.backend.dot(d, b), self.backend.dot(d, r)
            last, energy = energy, -0.5 * (db + dr)
            if not (energy < last and db > dr):
                return LinearSolution(before, done, left / first, definite=False)
            left, done = float(np.linalg.norm(r)), done + 1
        return LinearSolution(d, done, left / first if first > 0.0 else 0.0)

    def _cycle(self, number: int, b: Floats) -> Floats:
        from scipy.linalg import cho_solve

        if number == len(self._levels):
            return cho_solve(self._factor, b.ravel(), check_finite=False).reshape(b.shape)
        smoother, handles, workers = self._smoothers[number], self._handles[number], self._levels[number].workers
        x = smoother.first(b)
        for _ in range(self.smoothings - 1):
            smoother.again(b, x)
        coarse = self._cycle(number + 1, restrict(handles, workers, b - smoother.product(x)))
        prolong(handles, workers, coarse, x)
        for _ in range(self.smoothings):
            smoother.again(b, x)
        return x


class _Smoother:
    """Damped block Jacobi on one level of k nodes with `width` unknowns each."""

    product: Map
    _solve: Map
    _w: float

    def __init__(self, k: int, width: int) -> None:
        # Any vector with a share of the stiffest mode will do; this one is the same in every run.
        self._v = np.cos(np.arange(float(k * width)) ** 2).reshape(k, width)
        self._powers = _FIRST

    def set_up(self, product: Map, solve: Map) -> None:
        """Take A and D^-1, and choose the step."""
        self.product, self._solve = product, solve
        for _ in range(self._powers):
            v = solve(product(self._v))
            largest = float(np.linalg.norm(v))
            self._v = v / largest
        self._w, self._powers = _SMOOTHING / largest, _NEXT

    def first(self, b: Floats) -> Floats:
        """w D^-1 b: what one sweep makes of zero."""
        return self._w * self._solve(b)

    def again(self, b: Floats, x: Floats) -> None:
        """x += w D^-1 (b - A x)."""
        x += self._w * self._solve(b - self.product(x))


def _block_map(level: HandleMatrix) -> Map:
    inverses = level.diagonal_inverses()
    return lambda r: multiply_blocks(level.workers, inverses, r)
