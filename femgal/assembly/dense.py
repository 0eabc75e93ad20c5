# SPDX-License-Identifier: BSD-3-Clause
"""Small block matrices solved directly."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.matrix import BlockMatrix
from meshes.jit import kernel

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Added to the unit diagonal that the matrix is scaled to: what rounding of single precision may have taken away. Where
# it is not enough, and a pivot is negative, ten times as much, up to what makes any matrix definite that is so but for
# its rounding.
SHIFT, MOST_SHIFT = 1e-7, 10.0

# Partial sums of a dot product, which fill the vector units.
_LANES = 16


class DenseSolver:
    """A x = r by Cholesky's method, factored in float64, kept and applied in the precision of A.

    Parameters
    ----------
    A : Symmetric, positive definite up to rounding; its values may change between calls of `refresh`.
    """

    def __init__(self, A: BlockMatrix) -> None:
        n = 3 * A.n_rows
        self.A = A
        self._scale, self._shift = np.empty(n), SHIFT
        self._dense = np.empty((n, n), order="F")
        self._columns = np.empty(n * (n + 1) // 2, A.values.dtype)
        self._sums = np.empty(_LANES, A.values.dtype)
        self._x = np.empty((A.n_rows, 3), A.values.dtype)

    @property
    def shift(self) -> float:
        """What was added to the diagonal, in units of itself."""
        return self._shift

    def refresh(self) -> None:
        """Factor the present matrix; where it is not finite, solutions will not be numbers either."""
        from scipy.linalg.lapack import dpotrf

        pattern, values = self.A.pattern, self.A.values
        with np.errstate(divide="ignore", invalid="ignore"):
            np.sqrt(1.0 / values[pattern.diagonal][:, [0, 4, 8]].ravel().astype(np.float64), out=self._scale)
        self._shift, info = SHIFT, 1
        while info != 0 and self._shift <= MOST_SHIFT:
            self._dense[:] = 0.0
            _fill_lower(pattern.ptr, pattern.column, values, self._scale, 1.0 + self._shift, self._dense)
            # On one thread: where a core is busy with something else, BLAS' own threads wait for each other in every
            # column, which takes longer than the whole factorization.
            with _linear_algebra().limit(limits=1, user_api="blas"):
                info = dpotrf(self._dense, lower=1, clean=0, overwrite_a=1)[1]
            self._shift *= 1.0 if info == 0 else 10.0
        if info != 0:
            self._dense[:] = np.nan
        _pack(self._dense, self._columns)

    def solve(self, r: Reals) -> Reals:
        """A^-1 r, shape [n, 3]; an array of this solver, overwritten by its next use."""
        _solve(self._columns, self._scale, r.reshape(-1), self._sums, self._x.reshape(-1))
        return self._x

    def inverse(self) -> Floats:
        """A^-1 as it has been factored, shape [3 n, 3 n]; not numbers where the matrix is not finite."""
        from scipy.linalg.lapack import dpotri

        lower = np.tril(dpotri(self._dense, lower=1)[0])
        whole = lower + np.tril(lower, -1).T
        return np.ascontiguousarray(self._scale[:, None] * whole * self._scale)


@cache
def _linear_algebra() -> ThreadpoolController:
    """The thread pools of the libraries that are loaded, which takes milliseconds to find out."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@kernel
def _fill_lower(ptr: Longs, column: Ints, values: Reals, scale: Floats, diagonal: float, out: Floats) -> None:
    for i in range(len(ptr) - 1):
        for j in range(ptr[i], ptr[i + 1]):
            if column[j] > i:
                continue
            for b in range(3):
                for a in range(3):
                    p, q = 3 * i + a, 3 * column[j] + b
                    if p >= q:
                        out[p, q] = values[j, 3 * a + b] * scale[p] * scale[q]
    for p in range(len(scale)):
        out[p, p] = diagonal


@kernel
def _pack(L: Floats, columns: Reals) -> None:
    """Columns of L from the diagonal on, one after the other, with the reciprocal of each diagonal entry."""
    n = len(L)
    at = 0
    for q in range(n):
        columns[at] = 1.0 / L[q, q]
        for p in range(q + 1, n):
            columns[at + p - q] = L[p, q]
        at += n - q


@kernel
def _solve(columns: Reals, scale: Floats, r: Reals, sums: Reals, x: Reals) -> None:
    """x = S L^-T L^-1 S r."""
    n = len(x)
    for p in range(n):
        x[p] = r[p] * scale[p]
    at = 0
    for q in range(n):
        x[q] *= columns[at]
        y, below, column = x[q], x[q + 1 :], columns[at + 1 : at + n - q]
        for k in range(len(column)):
            below[k] -= y * column[k]
        at += n - q
    for q in range(n - 1, -1, -1):
        at -= n - q
        below, column = x[q + 1 :], columns[at + 1 : at + n - q]
        sums[:] = 0
        for t in range(len(column) // _LANES):
            a, b = column[t * _LANES : (t + 1) * _LANES], below[t * _LANES : (t + 1) * _LANES]
            for lane in range(_LANES):
                sums[lane] += a[lane] * b[lane]
        for k in range(len(column) // _LANES * _LANES, len(column)):
            sums[0] += column[k] * below[k]
        total = x[q]
        for lane in range(_LANES):
            total -= sums[lane]
        x[q] = total * columns[at]
    for p in range(n):
        x[p] *= scale[p]
