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
from verify.reference.newton import solve_definite

Floats = NDArray[np.float64]

LinearSolver = Literal["direct", "multigrid"]

# Of the residual, for the conjugate gradients of one Newton step.
_CG_TOLERANCE = 1e-10
# A step that has to be shorter than this share of Newton's leads nowhere.
_SHORTEST = 1e-9


class Elasticity(Protocol):
    """Forces [N] and stiffness [N/m] at positions x [m] of shape [n, 3]."""

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy, shape [n, 3]."""

    def hessian(self, x: Floats) -> sp.csr_matrix:
        """Its Hessian, shape [3n, 3n], or a matrix near it."""


@dataclass(frozen=True, eq=False)
class ProductionElasticity:
    """Forces of production's passes with scikit-fem's matrix, for Newton steps on production's forces."""

    backend: Backend
    assembled: AssembledElasticity

    @classmethod
    def of(cls, backend: Backend) -> ProductionElasticity:
        """The passes of a backend with the matrix of its bodies."""
        disc = backend.disc
        return cls(backend, AssembledElasticity(disc.mesh, disc.mu, disc.lam))

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy at the free vertices [N], shape [n, 3]."""
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
    steps : Largest |component| of each full Newton step [m]; the last one says how well it converged.
    """

    x: Floats
    steps: tuple[float, ...]


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
    """Solve grad E(x) = load for the free components of the nodes.

    Steps are shortened where the forces along them ask for it. No energy is asked, so that a solution is one of the
    forces even where forces and energy disagree.

    Parameters
    ----------
    load : Dead forces [N], shape [n, 3].
    free : Components that may move, shape [n, 3]; rollers hold one or two of a node.
    start : First iterate [m], shape [n, 3], with held components where they belong.
    tolerance : Converged when a whole Newton step moves nothing by more than this share of the body's size, and leaves
        no force above this share of the terms of which the forces are sums.
    linear : Sparse factorisation, or conjugate gradients with algebraic multigrid.

    Raises
    ------
    ArithmeticError
        Newton's method has not converged.
    """
    x, at, steps = start.copy(), np.flatnonzero(free.ravel()), []
    size = float(np.ptp(start, axis=0).max())

    def residual(y: Floats) -> Floats:
        return (elasticity.gradient(y) - load).ravel()[at]

    for _ in range(iterations):
        g, H = residual(x), elasticity.hessian(x)
        d = np.zeros(x.size)
        d[at] = -_SOLVERS[linear](H[at][:, at].tocsr(), g, x.reshape(-1, 3), at)
        steps.append(float(np.abs(d).max()))
        ends = steps[-1] <= tolerance * size
        x = x + (1.0 if ends else _length(residual, x, d, g, at)) * d.reshape(-1, 3)
        if ends and np.abs(residual(x)).max() <= tolerance * _terms(H, x, load):
            return Equilibrium(x, tuple(steps))
    shown = ", ".join(f"{step:.2g}" for step in steps[-3:])
    raise ArithmeticError(f"Newton's method has not converged in {iterations} steps, the last ones of {shown} m")


def _length(residual: Callable[[Floats], Floats], x: Floats, d: Floats, g: Floats, at: NDArray[np.int64]) -> float:
    """Largest of 1, 1/2, 1/4, ... after which forces along d do not push back harder than they pulled."""
    pull, t = abs(float(g @ d[at])), 1.0
    while t > _SHORTEST and float(residual(x + t * d.reshape(-1, 3)) @ d[at]) > pull:
        t *= 0.5
    return t


def _terms(H: sp.csr_matrix, x: Floats, load: Floats) -> float:
    """Largest sum of the absolute terms of a force [N]: stiffness times distances from the middle, and the load."""
    return float((abs(H) @ np.abs(x - x.mean(axis=0)).ravel()).max() + np.abs(load).max())


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
