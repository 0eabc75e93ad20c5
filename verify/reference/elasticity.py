# SPDX-License-Identifier: BSD-3-Clause
"""Stable neo-Hookean elasticity on linear tetrahedra, assembled by scikit-fem: slow on purpose.

    Psi    = mu/2 (I_C - 3) - mu (J - 1) + lam/2 (J - 1)^2             (Smith et al. 2018; Lu et al. 2025, Eq. 13)
    P      = mu F + c C,   c = lam (J - 1) - mu,   C = cof F
    dP[G]  = mu G + lam (C : G) C + c dC[G]

Nothing here shares code with the solver: cofactors come from the Levi-Civita symbol, gradients of the shape functions
and the summation over elements from scikit-fem. The Hessian is the exact one, indefinite where the energy is.
"""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from meshes.types import TetMesh

Floats = NDArray[np.float64]

_EPSILON = np.zeros((3, 3, 3))
for _path in permutations(range(3)):
    _EPSILON[_path] = np.linalg.det(np.eye(3)[list(_path)])


class AssembledElasticity:
    """Energy, gradient and Hessian of one mesh at any positions; n vertices, m tetrahedra.

    Parameters
    ----------
    mesh : Rest configuration.
    mu, lam : Material parameters [Pa] of the energy above, scalars or shape [m]; lam = lam_Lame + mu_Lame.
    """

    def __init__(self, mesh: TetMesh, mu: ArrayLike, lam: ArrayLike) -> None:
        self.mesh = mesh
        self._basis = _basis(mesh)
        self._vertex_dofs = self._basis.nodal_dofs.T  # scikit-fem's number of component c of vertex v at [v, c]
        self._mu = np.broadcast_to(np.asarray(mu, np.float64), len(mesh.cells))[:, None]
        self._lam = np.broadcast_to(np.asarray(lam, np.float64), len(mesh.cells))[:, None]

    def energy(self, x: Floats) -> float:
        """Elastic energy [J] at positions x [m], shape [n, 3]."""
        from skfem import Functional

        def density(w: Any) -> Any:
            F = _deformation_gradient(w)
            J1 = _determinant(F) - 1.0
            return 0.5 * w.mu * (_contract(F, F) - 3.0) - w.mu * J1 + 0.5 * w.lam * J1**2

        return float(Functional(density).assemble(self._basis, **self._fields(x)))

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the energy [N] at all vertices, constrained ones included, shape [n, 3]."""
        from skfem import LinearForm

        def work(v: Any, w: Any) -> Any:
            F = _deformation_gradient(w)
            c = w.lam * (_determinant(F) - 1.0) - w.mu
            return _contract(w.mu * F + c * cofactor(F), v.grad)

        return LinearForm(work).assemble(self._basis, **self._fields(x))[self._vertex_dofs]

    def hessian(self, x: Floats) -> sp.csr_matrix:
        """Exact Hessian [N/m], shape [3n, 3n]; component c of vertex v is row 3 v + c."""
        from skfem import BilinearForm

        def work(u: Any, v: Any, w: Any) -> Any:
            F = _deformation_gradient(w)
            C = cofactor(F)
            c = w.lam * (_determinant(F) - 1.0) - w.mu
            dP = w.mu * u.grad + w.lam * _contract(C, u.grad) * C + c * cofactor_derivative(F, u.grad)
            return _contract(dP, v.grad)

        order = self._vertex_dofs.ravel()
        return BilinearForm(work).assemble(self._basis, **self._fields(x)).tocsr()[order][:, order]

    def _fields(self, x: Floats) -> dict[str, Any]:
        displacement = np.empty(self._basis.N)
        displacement[self._vertex_dofs] = x - self.mesh.points
        return {"u": self._basis.interpolate(displacement), "mu": self._mu, "lam": self._lam}


def lumped_mass(mesh: TetMesh, rho: ArrayLike) -> Floats:
    """Row sums of the consistent mass matrix [kg], shape [n]; rho [kg/m^3] is a scalar or one per tetrahedron."""
    from skfem import Basis, BilinearForm, ElementTetP1, MeshTet

    basis = Basis(MeshTet(mesh.points.T.copy(), mesh.cells.T.astype(np.int64)), ElementTetP1(), intorder=2)
    density = np.broadcast_to(np.asarray(rho, np.float64), len(mesh.cells))[:, None]
    matrix = BilinearForm(lambda u, v, w: w.rho * u * v).assemble(basis, rho=density)
    return np.asarray(matrix.sum(axis=1)).ravel()[basis.nodal_dofs[0]]


def cofactor(F: Floats) -> Floats:
    """cof F = dJ/dF = 1/2 eps eps F F, of tensors of shape [3, 3, ...]."""
    return 0.5 * cofactor_derivative(F, F)


def cofactor_derivative(F: Floats, G: Floats) -> Floats:
    """dC[G]_ij = eps_imn eps_jpq F_mp G_nq, of tensors of shape [3, 3, ...]."""
    return np.einsum("imn,jpq,mp...,nq...->ij...", _EPSILON, _EPSILON, F, G, optimize=True)


def _basis(mesh: TetMesh) -> Any:
    from skfem import Basis, ElementTetP1, ElementVector, MeshTet

    # P1 gradients are constant in an element: one quadrature point is exact.
    return Basis(
        MeshTet(mesh.points.T.copy(), mesh.cells.T.astype(np.int64)), ElementVector(ElementTetP1()), intorder=0
    )


def _deformation_gradient(w: Any) -> Any:
    return np.eye(3)[:, :, None, None] + w.u.grad


def _determinant(F: Floats) -> Floats:
    return np.einsum("ijk,i...,j...,k...->...", _EPSILON, F[0], F[1], F[2], optimize=True)


def _contract(A: Floats, B: Floats) -> Floats:
    return np.einsum("ij...,ij...->...", A, B)
