# SPDX-License-Identifier: BSD-3-Clause
"""Static equilibrium under dead loads by Newton's method in float64: slow, obvious, and able to say how it went.

The forces whose zero is sought and the matrix of the Newton step come from two places on purpose. With both from
scikit-fem the solution is a reference. With production's forces and scikit-fem's matrix it is what production's
passes hold for equilibrium: a wrong force moves it, a wrong matrix could only slow it down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from verify.reference.elasticity import AssembledElasticity
from verify.reference.newton import backtrack, solve_definite

Floats = NDArray[np.float64]

LinearSolver = Literal["direct", "multigrid"]

# Of the residual, for the conjugate gradients of one Newton step.
_CG_TOLERANCE = 1e-10


class Elasticity(Protocol):
    """Energy [J], forces [N] and stiffness [N/m] at positions x [m] of shape [n, 3]."""

    def energy(self, x: Floats) -> float:
        """Elastic energy."""

    def gradient(self, x: Floats) -> Floats:
        """Its gradient, shape [n, 3]."""

    def hessian(self, x: Floats) -> sp.csr_matrix:
        """Its Hessian, shape [3n, 3n], or a matrix near it."""


@dataclass(frozen=True, eq=False)
class ProductionElasticity:
    """Energy and forces of production's passes with scikit-fem's matrix, for Newton steps on production's forces."""

    backend: Backend
    assembled: AssembledElasticity

    @classmethod
    def of(cls, backend: Backend) -> ProductionElasticity:
        """The passes of a backend with the matrix of its bodies."""
        disc = backend.disc
        return cls(backend, AssembledElasticity(disc.mesh, disc.mu, disc.lam))

    def energy(self, x: Floats) -> float:
        """Elastic energy [J]."""
        return float(self.backend.energies(x)[0].sum())

    def gradient(self, x: Floats) -> Floats:
        """Its gradient at the free vertices [N], shape [n, 3]."""
        return self.backend.gradient(x)

    def hessian(self, x: Floats) -> sp.csr_matrix:
        """Assembled Hessian [N/m], shape [3n, 3n]."""
        return self.assembled.hessian(x)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Where Newton's method ended.

    Parameters
    ----------
    x : Positions [m], shape [n, 3].
    steps : Largest |component| of each Newton step [m]; the last one says how well it converged.
    converged : Whether that met the tolerance.
    """

    x: Floats
    steps: tuple[float, ...]
    converged: bool


def equilibrium(
    elasticity: Elasticity,
    load: Floats,
    free: NDArray[np.bool_],
    start: Floats,
    *,
    tolerance: float = 1e-11,
    iterations: int = 40,
    linear: LinearSolver = "direct",
) -> Equilibrium:
    """Minimise E(x) - load . x over the free components of the nodes.

    Parameters
    ----------
    load : Dead forces [N], shape [n, 3].
    free : Components that may move, shape [n, 3]; rollers hold one or two of a node.
    start : First iterate [m], shape [n, 3], with held components where they belong.
    tolerance : Converged when a Newton step moves nothing by more than this share of the body's size.
    linear : Sparse factorisation, or conjugate gradients with algebraic multigrid.
    """
    x, at, steps = start.copy(), np.flatnonzero(free.ravel()), []
    size = float(np.ptp(start, axis=0).max())

    def value(y: Floats) -> float:
        return elasticity.energy(y) - float((load * (y - start)).sum())

    for _ in range(iterations):
        g = (elasticity.gradient(x) - load).ravel()[at]
        A = elasticity.hessian(x)[at][:, at].tocsr()
        d = np.zeros(x.size)
        d[at] = -_SOLVERS[linear](A, g, x.reshape(-1, 3), at)
        t = _length(value, x, d.reshape(-1, 3), float(g @ d[at]))
        x = x + t * d.reshape(-1, 3)
        steps.append(t * float(np.abs(d).max()))
        if steps[-1] <= tolerance * size:
            return Equilibrium(x, tuple(steps), True)
    return Equilibrium(x, tuple(steps), False)


def _length(value: Callable[[Floats], float], x: Floats, d: Floats, slope: float) -> float:
    return backtrack(lambda t: value(x + t * d), slope)


def rigid_body_modes(x: Floats) -> Floats:
    """Three translations and three linearised rotations about the centre of x [n, 3], shape [3n, 6]."""
    y = x - x.mean(axis=0)
    y = y / np.abs(y).max()
    modes = np.zeros((len(x), 3, 6))
    modes[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], y)
    return modes.reshape(-1, 6)


def solve_by_multigrid(A: sp.csr_matrix, b: Floats, near_null: Floats) -> Floats:
    """Solve A y = b, A positive definite, by conjugate gradients with smoothed aggregation (pyamg).

    Parameters
    ----------
    near_null : Rigid body modes at the rows of A, shape [rows, 6].

    Raises
    ------
    ArithmeticError
        Not converged, as with an indefinite A.
    """
    from pyamg import smoothed_aggregation_solver

    hierarchy = smoothed_aggregation_solver(A, B=near_null, max_coarse=300)
    y, failed = spla.cg(A, b, rtol=_CG_TOLERANCE, maxiter=1000, M=hierarchy.aspreconditioner())
    if failed:
        raise ArithmeticError(f"conjugate gradients with algebraic multigrid: {len(b)} unknowns, code {failed}")
    return y


def _direct(A: sp.csr_matrix, b: Floats, x: Floats, at: NDArray[np.int64]) -> Floats:
    return solve_definite(A, b)


def _multigrid(A: sp.csr_matrix, b: Floats, x: Floats, at: NDArray[np.int64]) -> Floats:
    return solve_by_multigrid(A, b, rigid_body_modes(x)[at])


_SOLVERS: dict[LinearSolver, Callable[..., Floats]] = {"direct": _direct, "multigrid": _multigrid}
