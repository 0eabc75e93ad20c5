# SPDX-License-Identifier: BSD-3-Clause
"""Preconditioner of Newton's linear systems: a Galerkin V-cycle on lattices, with assembled matrices.

The definite part of the Hessian is assembled over the free vertices (`femgal.assembly.hessian`) and coarsened to
P^T A P on a chain of nested lattices (`femgal.assembly.lattices`). Each level is smoothed before and after the coarser
one by a Chebyshev polynomial in D^-1 A, D the diagonal blocks; the coarsest is solved by Cholesky's method. The same
polynomial on both sides makes the cycle symmetric, and positive definite for as long as the polynomial's interval holds
the largest eigenvalue.

Everything but the sums of A is single precision: it is bandwidth that a cycle costs. Sums that are rounded once are
random from block to block, so they average out over the soft modes that the cycle is there for.

Why the finest level is assembled too: the coarse matrices need it anyway, and a product with 14 blocks of float32 per
row takes less than half of the time of a matrix-free product in float32. Degree 1 takes half of the time of degree 2
and 1.3 to 1.5 times as many iterations, whose product is matrix-free: no gain; degree 3 is slower.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.hessian import HessianAssembly
from femgal.assembly.lattices import lattice_chain
from femgal.assembly.matrix import BlockMatrix
from femgal.kernels.backend import Backend, CycleOnDevice, Precision
from femgal.solvers.multigrid import DenseSolver, Level, VCycle
from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]

# Unknowns of the dense bottom, k: k^3 <= DENSE_WORK n for n free vertices, and at most MOST_DENSE. Fewer levels
# converge better where the body is only some mean edges thick, for a wide lattice is too stiff in bending: with 2,000
# vertices a bunny hung by an ear takes 4 iterations to 1e-2 with 342 nodes at the bottom and 11 with 84. With 20,000
# vertices 500 nodes instead of 131 save one or two iterations of nine, which the dearer refresh is hardly worth.
DENSE_WORK = 1e6
MOST_DENSE = 1200

# What making it anew, one cycle and one product take, in gradient passes in float64: bunny of 20,000 and 100,000
# vertices, one thread. With 2,000 vertices the first two are 80 and 3.2, most of it the dense bottom.
REFRESH, CYCLE, PRODUCT = 37.0, 2.3, 0.4

# Degree of the bottom's polynomial where it is too large to be dense: many bodies that do not touch.
BOTTOM_DEGREE = 8
BOTTOM_RATIO = 100.0


def most_dense(n: int) -> int:
    """Most unknowns of a dense bottom, for n free vertices."""
    return min(MOST_DENSE, int((DENSE_WORK * n) ** (1.0 / 3.0)))


class LatticeVCycle:
    """One V-cycle; the methods are those of `femgal.solvers.preconditioner.Preconditioner`.

    Parameters
    ----------
    backend : Bodies and threads; no element pass is made.
    degree : Of the Chebyshev polynomials before and after the coarser levels.
    precision : Of matrices and cycle.
    most : Unknowns of a dense bottom, at most; what suits the size of the body where it is left out.
    """

    price = 10.0
    _on_device: CycleOnDevice | None = None

    def __init__(
        self, backend: Backend, degree: int = 2, precision: Precision = "float32", most: int | None = None
    ) -> None:
        self._backend = backend
        self._assembly = HessianAssembly(backend.disc, precision, backend.threads)
        self._A = self._assembly.matrix()
        most = most_dense(self._A.n_rows) if most is None else most
        products = lattice_chain(backend.disc, self._A.pattern, most // 3, precision)
        matrices: list[BlockMatrix] = [self._A]
        for product in products:
            matrices.append(product.matrix(matrices[-1]))
        last = matrices[-1]
        dense = 3 * last.n_rows <= most
        bottom = DenseSolver(last) if dense else Level(last, BOTTOM_DEGREE, BOTTOM_RATIO)
        self._cycle = VCycle([Level(A, degree) for A in matrices[:-1]], products, bottom)

    def __str__(self) -> str:
        cycle = self._cycle
        matrices = [level.A for level in (*cycle.levels, cycle.bottom)]
        rows = [f"{A.n_rows} nodes, {A.pattern.n_blocks / A.n_rows:.1f} blocks per row" for A in matrices]
        bottom = "solved directly" if isinstance(cycle.bottom, DenseSolver) else "smoothed"
        return "\n".join([*rows, f"bottom {bottom}, {sum(A.nbytes for A in matrices) / 2**20:.0f} MiB"])

    def refresh(self, potential: IncrementalPotential, x: Floats) -> None:
        """Matrices of all levels at x."""
        potential.backend.passes.matrix += REFRESH
        self._assembly.assemble(self._backend.to_host(x), potential.inverse_h2, out=self._A)
        self._cycle.refresh()
        if self._on_device is None:
            self._on_device = self._backend.cycle_on_device(self._cycle)
        else:
            self._on_device.refresh()

    def apply(self, r: Floats) -> Floats:
        """What a cycle makes of A^-1 r [m], rows of the free vertices, shape [k, 3]."""
        self._backend.passes.matrix += CYCLE
        if self._on_device is not None:
            return self._on_device.solve(r)
        # Residuals of all sizes must fit into single precision.
        size = float(np.abs(r).max(initial=0.0))
        if size == 0.0:
            return np.zeros_like(r)
        z = self._cycle.solve((r / size).astype(self._A.values.dtype))
        return size * z.astype(np.float64)

    def product(self, p: Floats) -> Floats:
        """The definite part of A at the last refresh, its entries rounded to the cycle's precision, times p [N]."""
        self._backend.passes.matrix += PRODUCT
        if self._on_device is not None and self._cycle.levels:
            return self._on_device.product(p)
        product: Floats = self._A.product(self._backend.to_host(p)).astype(np.float64, copy=False)
        return self._backend.to_device(product)
