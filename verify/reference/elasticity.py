# SPDX-License-Identifier: BSD-3-Clause
"""Stable neo-Hookean elasticity on linear or quadratic tetrahedra, assembled by scikit-fem: slow on purpose.

    Psi    = mu/2 (I_C - 3) - mu (J - 1) + lam/2 (J - 1)^2             (Smith et al. 2018; Lu et al. 2025, Eq. 13)
    P      = mu F + c C,   c = lam (J - 1) - mu,   C = cof F
    dP[G]  = mu G + lam (C : G) C + c dC[G]

Nothing here shares code with the solver: cofactors come from the Levi-Civita symbol, gradients of the shape functions
and the summation over elements from scikit-fem. The Hessian is the exact one, indefinite where the energy is.
"""

from __future__ import annotations

from itertools import permutations, product
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
    """Energy, gradient and Hessian of one mesh at any positions; n nodes, m tetrahedra.

    Parameters
    ----------
    mesh : Rest configuration.
    mu, lam : Material parameters [Pa] of the energy above, scalars or shape [m]; lam = lam_Lame + mu_Lame.
    degree : Of the shape functions: 1, whose nodes are the vertices, or 2, with the midpoints of edges after them.

    Attributes
    ----------
    nodes : Rest positions of the nodes [m], shape [n, 3].
    """

    def __init__(self, mesh: TetMesh, mu: ArrayLike, lam: ArrayLike, degree: int = 1) -> None:
        self.mesh = mesh
        # The energy is of degree 6 in the gradients: constants on P1, linear on P2. The quadrature is exact.
        self._basis = scalar_basis(mesh, degree, intorder=0 if degree == 1 else 6)
        self._dofs = node_dofs(self._basis)
        self.nodes = np.ascontiguousarray(self._basis.doflocs[:, self._dofs].T)
        self._mu = np.broadcast_to(np.asarray(mu, np.float64), len(mesh.cells))[:, None]
        self._lam = np.broadcast_to(np.asarray(lam, np.float64), len(mesh.cells))[:, None]

    def energy(self, x: Floats) -> float:
        """Elastic energy [J] at positions x [m], shape [n, 3]."""
        F = self._deformation_gradient(x)
        J1 = _determinant(F) - 1.0
        density = 0.5 * self._mu * (_contract(F, F) - 3.0) - self._mu * J1 + 0.5 * self._lam * J1**2
        return float((density * self._basis.dx).sum())

    @property
    def rounding(self) -> float:
        """What rounding makes of the energy of a body near rest [J], where terms of 3 mu / 2 cancel."""
        return 8.0 * float(np.finfo(float).eps * (1.5 * self._mu * self._basis.dx).sum())

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the energy [N] at all nodes, constrained ones included, shape [n, 3]."""
        from skfem import LinearForm

        F = self._deformation_gradient(x)
        P = self._mu * F + self._c(F) * cofactor(F)
        work = LinearForm(lambda v, w: np.einsum("j...,j...", w.stress, v.grad))
        return np.stack([work.assemble(self._basis, stress=P[i])[self._dofs] for i in range(3)], axis=1)

    def hessian(self, x: Floats) -> sp.csr_matrix:
        """Exact Hessian [N/m], shape [3n, 3n]; component c of node v is row 3 v + c."""
        from skfem import BilinearForm

        F = self._deformation_gradient(x)
        C, c = cofactor(F), self._c(F)
        work = BilinearForm(lambda u, v, w: np.einsum("jl...,j...,l...", w.modulus, v.grad, u.grad))
        A = sp.csr_matrix((3 * len(self.nodes), 3 * len(self.nodes)))
        for i, k in product(range(3), range(3)):
            modulus = self._lam * C[i, :, None] * C[k, None, :] + c * _cofactor_slope(F, i, k)
            if i == k:
                modulus = modulus + self._mu * np.eye(3)[:, :, None, None]
            block = work.assemble(self._basis, modulus=modulus).tocsr()[self._dofs][:, self._dofs]
            A = A + sp.kron(block, sp.csr_matrix(([1.0], ([i], [k])), shape=(3, 3)), format="csr")
        return A

    def _c(self, F: Floats) -> Floats:
        return self._lam * (_determinant(F) - 1.0) - self._mu

    def _deformation_gradient(self, x: Floats) -> Floats:
        """F at the quadrature points, shape [3, 3, m, points]."""
        values = np.empty((3, self._basis.N))
        values[:, self._dofs] = (x - self.nodes).T
        return np.eye(3)[:, :, None, None] + np.stack([self._basis.interpolate(one).grad for one in values])


def material_parameters(E: ArrayLike, nu: ArrayLike) -> tuple[Floats, Floats]:
    """mu and lam [Pa] of the energy above, whose small strains are those of Young's modulus E [Pa] and Poisson's nu."""
    bulk, shear = np.asarray(E) / (3.0 - 6.0 * np.asarray(nu)), np.asarray(E) / (2.0 + 2.0 * np.asarray(nu))
    # lam_Lame is bulk - 2/3 shear.
    return shear, bulk + shear / 3.0


def lumped_mass(mesh: TetMesh, rho: ArrayLike) -> Floats:
    """Row sums of the consistent mass matrix [kg], shape [n]; rho [kg/m^3] is a scalar or one per tetrahedron."""
    return np.asarray(consistent_mass(mesh, rho).sum(axis=1)).ravel()


def consistent_mass(mesh: TetMesh, rho: ArrayLike, degree: int = 1) -> sp.csr_matrix:
    """M_ab = integral of rho N_a N_b [kg], shape [n, n] for the n nodes of `AssembledElasticity`."""
    from skfem import BilinearForm

    basis = scalar_basis(mesh, degree, intorder=2 * degree)
    density = np.broadcast_to(np.asarray(rho, np.float64), len(mesh.cells))[:, None]
    matrix = BilinearForm(lambda u, v, w: w.rho * u * v).assemble(basis, rho=density).tocsr()
    return matrix[node_dofs(basis)][:, node_dofs(basis)]


def scalar_basis(mesh: TetMesh, degree: int, intorder: int) -> Any:
    """scikit-fem's Basis of Lagrange shape functions of degree 1 or 2 on the tetrahedra."""
    from skfem import Basis, ElementTetP1, ElementTetP2, MeshTet

    element = {1: ElementTetP1, 2: ElementTetP2}[degree]()
    cells = np.ascontiguousarray(mesh.cells.T, np.int64)
    return Basis(MeshTet(np.ascontiguousarray(mesh.points.T), cells), element, intorder=intorder)


def node_dofs(basis: Any) -> NDArray[np.int64]:
    """scikit-fem's number of each node: vertices first, then the midpoints of edges."""
    return np.concatenate([basis.nodal_dofs.ravel(), basis.edge_dofs.ravel()]).astype(np.int64)


def cofactor(F: Floats) -> Floats:
    """cof F = dJ/dF = 1/2 eps eps F F, of tensors of shape [3, 3, ...]."""
    return 0.5 * cofactor_derivative(F, F)


def cofactor_derivative(F: Floats, G: Floats) -> Floats:
    """dC[G]_ij = eps_imn eps_jpq F_mp G_nq, of tensors of shape [3, 3, ...]."""
    return np.einsum("imn,jpq,mp...,nq...->ij...", _EPSILON, _EPSILON, F, G, optimize=True)


def _cofactor_slope(F: Floats, i: int, k: int) -> Floats:
    """dC_ij / dF_kl = eps_ikn eps_jlq F_nq, shape [3, 3, ...] of j and l; F is [3, 3, ...]."""
    return np.einsum("n,jlq,nq...->jl...", _EPSILON[i, k], _EPSILON, F, optimize=True)


def _determinant(F: Floats) -> Floats:
    return np.einsum("ijk,i...,j...,k...->...", _EPSILON, F[0], F[1], F[2], optimize=True)


def _contract(A: Floats, B: Floats) -> Floats:
    return np.einsum("ij...,ij...->...", A, B)
