# SPDX-License-Identifier: BSD-3-Clause
"""Conjugate gradients preconditioned by smoothed aggregation (Vanek, Mandel & Brezina 1996), as pyamg makes it.

It stands for AMGCL, with which Lu et al. 2025 compare, and for algebraic multigrid in general. Rigid body modes as
near null space are what elasticity needs; without them ("plain": the three translations) it is what a package makes of
the matrix alone. The hierarchy is made anew for every Newton system.

Chosen by CPU time of setup and solution, bunny of 2,000 and 20,000 vertices, E = 1e6, rho = 1 and 1000, h = 1/60 and
1/300: connections below 0.02 of the diagonal are dropped; candidates are not improved, which costs as much as the rest
of the setup and saves no iteration; block Gauss-Seidel, forwards before and backwards after the coarse correction;
prolongation smoothed with block weights. pyamg's own choices need up to a third more iterations and twice the setup.
Its pseudo-inverse of the coarsest matrix takes longer than all the rest, and its Cholesky method fails where that is
singular: of the six modes an aggregate of one vertex has three, one of two vertices five. So the diagonal is raised a
little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verify.reference.statics import rigid_body_modes
from verify.solvers.system import AssembledSystem

Floats = NDArray[np.float64]

# Of the mean diagonal entry of the coarsest matrix: above its rounding, far below its smallest eigenvalue.
_SHIFT = 1e-11

_OPTIONS: dict[str, Any] = {
    "strength": ("symmetric", {"theta": 0.02}),
    "improve_candidates": None,
    "smooth": ("jacobi", {"omega": 4.0 / 3.0, "weighting": "block"}),
    "presmoother": ("block_gauss_seidel", {"sweep": "forward"}),
    "postsmoother": ("block_gauss_seidel", {"sweep": "backward"}),
    "max_coarse": 300,
}


@dataclass(eq=False)
class SmoothedAggregation(AssembledSystem):
    """Preconditioned by one V(1, 1) cycle.

    Parameters
    ----------
    rigid_modes : Near null space: translations and rotations about the present positions, or translations alone.
    """

    rigid_modes: bool = True
    _cycle: Callable[[Floats], Floats] = field(init=False, repr=False)

    def set_up(self, x: Floats) -> None:
        """Make the hierarchy."""
        from pyamg import smoothed_aggregation_solver

        A = self.matrix.to_scipy().astype(np.float64)
        hierarchy = smoothed_aggregation_solver(A, B=self._near_null(x), coarse_solver=_Bottom(), **_OPTIONS)
        self._cycle = hierarchy.aspreconditioner().matvec

    def precondition(self, r: Floats) -> Floats:
        """One cycle from zero."""
        return self._cycle(r.ravel()).reshape(-1, 3)

    def _near_null(self, x: Floats) -> Floats:
        modes = rigid_body_modes(x)[np.repeat(self.backend.disc.free, 3)]
        return modes if self.rigid_modes else modes[:, :3].copy()


class _Bottom:
    """Solves with the coarsest matrix, positive semi-definite, which is factored when it is first met."""

    _factor: Any = None

    def __call__(self, A: Any, b: Floats) -> Floats:
        """A^-1 b.

        Raises
        ------
        LinAlgError
            A is not positive definite.
        """
        from scipy.linalg import cho_factor, cho_solve

        if self._factor is None:
            dense = A.toarray()
            dense[np.diag_indices(len(dense))] += _SHIFT * float(dense.diagonal().mean())
            self._factor = cho_factor(dense, lower=True, overwrite_a=True)
        return cho_solve(self._factor, b)
