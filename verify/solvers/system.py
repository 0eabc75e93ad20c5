# SPDX-License-Identifier: BSD-3-Clause
"""The linear systems of Newton's method: what a competitor offers, and block Jacobi with or without a matrix."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.hessian import HessianAssembly
from femgal.assembly.matrix import BlockMatrix
from femgal.kernels.backend import Backend
from femgal.timestep.potential import IncrementalPotential
from verify.solvers.conjugate_gradients import LinearSolution, conjugate_gradients

Floats = NDArray[np.float64]


class LinearSystem(Protocol):
    """A = d2 phi(x) over the free vertices, k of them, and a way to solve with it."""

    def linearise(self, potential: IncrementalPotential, x: Floats, *, definite: bool) -> None:
        """Make ready for A at positions x [m], shape [n, 3].

        Parameters
        ----------
        definite : Replace the Hessian of every element by its positive semi-definite part (Smith et al. 2019).

        Raises
        ------
        LinAlgError
            A is not positive definite. Who does not notice it here says so in the solution.
        """

    def solve(self, b: Floats, tolerance: float) -> LinearSolution:
        """d [m] with |b - A d| <= tolerance |b| for forces b [N], both shape [k, 3].

        Raises
        ------
        LinAlgError
            As above.
        """


@dataclass(eq=False)
class KrylovSystem(ABC):
    """A system solved by preconditioned conjugate gradients.

    Parameters
    ----------
    backend : Element passes, sums and updates.
    iterations : At most this many for one solution.
    """

    backend: Backend
    iterations: int = 5000

    @abstractmethod
    def linearise(self, potential: IncrementalPotential, x: Floats, *, definite: bool) -> None:
        """Make ready for A at positions x."""

    @abstractmethod
    def product(self, p: Floats) -> Floats:
        """A p."""

    @abstractmethod
    def precondition(self, r: Floats) -> Floats:
        """M^-1 r."""

    def solve(self, b: Floats, tolerance: float) -> LinearSolution:
        """Iterate from zero."""
        return conjugate_gradients(self.backend, self.product, self.precondition, b, tolerance, self.iterations)


@dataclass(eq=False)
class AssembledSystem(KrylovSystem):
    """A system with a matrix, in the precision of the backend's element passes; a subclass preconditions."""

    matrix: BlockMatrix = field(init=False, repr=False)
    _assembly: HessianAssembly = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._assembly = HessianAssembly(self.backend.disc, self.backend.precision, self.backend.threads)
        self.matrix = self._assembly.matrix()

    def linearise(self, potential: IncrementalPotential, x: Floats, *, definite: bool) -> None:
        """Assemble, and set the preconditioner up."""
        self._assembly.assemble(x, potential.inverse_h2, definite=definite, out=self.matrix)
        self.set_up(x)

    @abstractmethod
    def set_up(self, x: Floats) -> None:
        """Make the preconditioner of `matrix`, the Hessian at positions x."""

    def product(self, p: Floats) -> Floats:
        """A p."""
        return np.asarray(self.matrix.product(p), np.float64)


@dataclass(eq=False)
class AssembledJacobi(AssembledSystem):
    """Preconditioned by the 3x3 blocks on the diagonal of the matrix."""

    _H: Floats = field(init=False, repr=False)

    def set_up(self, x: Floats) -> None:
        """Take the blocks."""
        self._H = self.matrix.diagonal_blocks().astype(np.float64)

    def precondition(self, r: Floats) -> Floats:
        """Solve block by block."""
        return self.backend.solve(r, self._H, -1.0)


@dataclass(eq=False)
class MatrixFreeJacobi(KrylovSystem):
    """The same with products by passes over the elements.

    The blocks need no filter: they are positive definite at any deformation (Lu et al. 2025, Eq. 16).
    """

    _at: tuple[Floats, float, bool] = field(init=False, repr=False)
    _H: Floats = field(init=False, repr=False)

    def linearise(self, potential: IncrementalPotential, x: Floats, *, definite: bool) -> None:
        """Make the blocks."""
        self._at = (x.copy(), potential.inverse_h2, definite)
        self._H = self.backend.gradient_and_blocks(self.backend.vertices, x, x, potential.inverse_h2)[1]

    def product(self, p: Floats) -> Floats:
        """A p by one pass."""
        x, inverse_h2, definite = self._at
        d = np.zeros_like(x)
        self.backend.prolong(self.backend.vertices, p, d)
        return self.backend.nodal_product(self.backend.vertices, x, d, inverse_h2, definite=definite)

    def precondition(self, r: Floats) -> Floats:
        """Solve block by block."""
        return self.backend.solve(r, self._H, -1.0)
