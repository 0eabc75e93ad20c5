# SPDX-License-Identifier: BSD-3-Clause
"""The incremental potential assembled at one state, and its Galerkin products with the layers of a hierarchy.

With g and A the gradient and exact Hessian of phi = |x - xhat|^2_M / (2 h^2) + E(x), assembled by scikit-fem, a layer
with the prolongation P has the gradient P^T g and the 3x3 diagonal blocks of P^T A P. Nothing is filtered: A is
indefinite where the energy is, its blocks never are (Lu et al. 2025, Eq. 11 to 16).

Rounding is judged by the size of a single term: of what one vertex of one element adds to a node's sum, before the
terms of many elements cancel, and before those of one element do: the large gradients of a sliver may sum to a small u.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.hierarchy.layer import Layer
from meshes.types import TetMesh
from verify.problems.bodies import mean_edge, positions, rng
from verify.reference.elasticity import AssembledElasticity, cofactor, cofactor_derivative
from verify.reference.transfer import diagonal_blocks, galerkin, mass_matrix, prolongation
from verify.suite.case import Skip

Floats = NDArray[np.float64]

HIERARCHIES = ("clusters-8", "clusters-32", "lattice")

# A million entries of the Hessian per 35,000 tetrahedra, and a second of CPU time per 20,000.
MOST_TETS = 150_000


@dataclass(frozen=True, eq=False)
class Assembled:
    """phi of one body at one state; n vertices, m tetrahedra, k nodes of a layer.

    Parameters
    ----------
    disc : The discretised body.
    x, xhat : Positions and their prediction [m], shape [n, 3].
    inverse_h2 : Factor of the mass [1/s^2].
    g : Gradient of phi at all vertices [N], shape [n, 3].
    A : Hessian of phi [N/m], shape [3n, 3n].
    """

    disc: Discretisation
    x: Floats
    xhat: Floats
    inverse_h2: float
    g: Floats
    A: sp.csr_matrix

    def gradient(self, layer: Layer) -> Floats:
        """P^T g [N], shape [k, 3]."""
        return (prolongation(layer).T @ self.g.ravel()).reshape(-1, 3)

    def blocks(self, layer: Layer) -> Floats:
        """Diagonal blocks of P^T A P [N/m], shape [k, 3, 3]."""
        return diagonal_blocks(galerkin(prolongation(layer), self.A))

    def product(self, layer: Layer, d: Floats) -> Floats:
        """P^T A d [N], shape [k, 3]."""
        return (prolongation(layer).T @ (self.A @ d.ravel())).reshape(-1, 3)

    def gradient_terms(self, layer: Layer) -> Floats:
        """Largest term V (mu |F| + |c C|) |w grad N| or w m |x - xhat| / h^2 of each node's gradient [N], shape [k]."""
        F, C, c = self._deformation
        size = self.disc.mu * _norm(F) + np.abs(c) * _norm(C)
        return self._largest(layer, size, self.x - self.xhat)

    def block_terms(self, layer: Layer) -> Floats:
        """Largest term V (mu + lam |C|^2) |w grad N|^2 or w^2 m / h^2 of each node's block [N/m], shape [k]."""
        stiffness = self.disc.mu + self.disc.lam * _norm(self._deformation[1]) ** 2
        return self._largest(layer, stiffness, np.full(self.x.shape, 1.0 / np.sqrt(3.0)), power=2)

    def product_terms(self, layer: Layer, d: Floats) -> Floats:
        """Largest term V |dP/dF| |grad d| |w grad N| or w m |d| / h^2 of each node's product [N], shape [k]."""
        F, C, c = self._deformation
        stiffness = self.disc.mu + self.disc.lam * _norm(C) ** 2 + np.abs(c) * _norm(F)
        return self._largest(layer, stiffness * _norm(deformation(self.disc, d)), d)

    def of_elements(self, chosen: NDArray[np.bool_]) -> Assembled:
        """Elastic gradient and Hessian of some of the elements alone, without inertia."""
        mesh = self.disc.mesh
        used, cells = np.unique(mesh.cells[chosen], return_inverse=True)
        own = TetMesh(mesh.points[used], cells.reshape(-1, 4).astype(np.int32))
        elasticity = AssembledElasticity(own, self.disc.mu[chosen], self.disc.lam[chosen])
        place = sp.kron(sp.eye(len(self.x)).tocsr()[:, used], sp.eye(3)).tocsr()
        g = (place @ elasticity.gradient(self.x[used]).ravel()).reshape(-1, 3)
        A = (place @ elasticity.hessian(self.x[used]) @ place.T).tocsr()
        return replace(self, inverse_h2=0.0, g=g, A=A)

    def value(self, x: Floats) -> float:
        """phi(x) [J]."""
        elasticity = AssembledElasticity(self.disc.mesh, self.disc.mu, self.disc.lam)
        return 0.5 * self.inverse_h2 * float(self.disc.mass @ ((x - self.xhat) ** 2).sum(axis=1)) + elasticity.energy(x)

    def gradient_at(self, x: Floats) -> Floats:
        """grad phi(x) [N] at all vertices, shape [n, 3]."""
        elasticity = AssembledElasticity(self.disc.mesh, self.disc.mu, self.disc.lam)
        return self.inverse_h2 * self.disc.mass[:, None] * (x - self.xhat) + elasticity.gradient(x)

    def energy_terms(self, x: Floats) -> float:
        """Sum of V (mu/2 |F|^2 + mu |J| + lam/2 (J - 1)^2) over the elements and of m |x - xhat|^2 / (2 h^2) [J]."""
        F = deformation(self.disc, x)
        J = np.linalg.det(np.moveaxis(F, -1, 0))
        density = self.disc.mu * (0.5 * _norm(F) ** 2 + np.abs(J)) + 0.5 * self.disc.lam * (J - 1.0) ** 2
        moved = ((x - self.xhat) ** 2).sum(axis=1)
        return float(self.disc.V @ density + 0.5 * self.inverse_h2 * self.disc.mass @ moved)

    def definite_product(self, d: Floats) -> Floats:
        """Product of d with the sum of the positive semi-definite parts of V dP/dF of all elements [N], shape [n, 3].

        By eigenvalues of 9x9 matrices, where the passes know them in closed form (Smith et al. 2019).
        """
        H = self._tangents()
        values, vectors = np.linalg.eigh(H)
        G = np.moveaxis(deformation(self.disc, d), -1, 0).reshape(-1, 9, 1)
        parts = np.maximum(values, 0.0)[:, :, None] * (vectors.transpose(0, 2, 1) @ G)
        dP = self.disc.V[:, None, None] * (vectors @ parts).reshape(-1, 3, 3)
        out = np.zeros_like(d)
        np.add.at(out, self.disc.mesh.cells, np.einsum("eij,ekj->eki", dP, shape_gradients(self.disc)))
        return out

    def _tangents(self) -> Floats:
        """dP/dF of each tetrahedron [Pa], shape [m, 9, 9]: column by column, for the nine unit changes of F."""
        F, C, c = self._deformation
        columns = []
        for unit in np.eye(9).reshape(9, 3, 3, 1):
            G = np.broadcast_to(unit, F.shape)
            along = self.disc.mu * G + self.disc.lam * (C * G).sum(axis=(0, 1)) * C + c * cofactor_derivative(F, G)
            columns.append(along.reshape(9, -1).T)
        return np.stack(columns, axis=2)

    @cached_property
    def _deformation(self) -> tuple[Floats, Floats, Floats]:
        """F and cof F, shape [3, 3, m], and c = lam (J - 1) - mu [Pa], shape [m]."""
        F = deformation(self.disc, self.x)
        J = np.linalg.det(np.moveaxis(F, -1, 0))
        return F, cofactor(F), self.disc.lam * (J - 1.0) - self.disc.mu

    def _largest(self, layer: Layer, stress: Floats, d: Floats, power: int = 1) -> Floats:
        """Largest of V stress |w grad N|^power over a node's elements, and w^power m |d| / h^2 over its vertices."""
        elastic = sp.diags(self.disc.V * stress) @ shares(self.disc, layer).power(power)
        momentum = self.inverse_h2 * self.disc.mass * np.linalg.norm(d, axis=1)
        inertia = sp.diags(momentum) @ weights(layer).power(power)
        return np.maximum(_largest_column(elastic), _largest_column(inertia))


@cache
def assembled(disc: Discretisation, state: str) -> Assembled:
    """phi of a body at a named state, predicted near it, with inertia as heavy as elasticity.

    Raises
    ------
    Skip
        The mesh is too large to assemble.
    """
    if disc.n_tets > MOST_TETS:
        raise Skip(f"{disc.n_tets} tetrahedra: the reference assembles up to {MOST_TETS}")
    x = positions(disc.mesh, state)
    xhat = x + 0.1 * mean_edge(disc.mesh) * rng(20).standard_normal(x.shape)
    elasticity = AssembledElasticity(disc.mesh, disc.mu, disc.lam)
    inverse_h2 = balanced(disc)
    g = elasticity.gradient(x) + inverse_h2 * disc.mass[:, None] * (x - xhat)
    return Assembled(
        disc, x, xhat, inverse_h2, g, (elasticity.hessian(x) + inverse_h2 * mass_matrix(disc.mass)).tocsr()
    )


@cache
def balanced(disc: Discretisation) -> float:
    """1 / h^2 [1/s^2] of the step at which inertia and elasticity weigh the same at a typical vertex."""
    stiffness = np.zeros(disc.n_vertices)
    squares = (shape_gradients(disc) ** 2).sum(axis=2)
    np.add.at(stiffness, disc.mesh.cells, (disc.V * (disc.mu + disc.lam / 3.0))[:, None] * squares)
    return float(np.median(stiffness / disc.mass))


@cache
def layers(disc: Discretisation, hierarchy: str) -> tuple[Layer, ...]:
    """Layers of a hierarchy by name, finest first."""
    if hierarchy == "lattice":
        return build_linear_hierarchy(disc).layers
    return build_constant_hierarchy(disc, int(hierarchy.removeprefix("clusters-"))).layers


def shape_gradients(disc: Discretisation) -> Floats:
    """grad N of the four corners of each tetrahedron [1/m], shape [m, 4, 3]."""
    X = disc.mesh.points[disc.mesh.cells]
    inner = np.linalg.inv(np.moveaxis(X[:, 1:] - X[:, :1], 1, 2))
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)


def deformation(disc: Discretisation, x: Floats) -> Floats:
    """sum_k x_k (x) grad N_k of each tetrahedron, shape [3, 3, m]."""
    return np.einsum("eki,ekj->ije", x[disc.mesh.cells], shape_gradients(disc))


def strains(disc: Discretisation, layer: Layer) -> sp.csr_matrix:
    """|u| of each element and node, u = sum_k w_k grad N_k [1/m] (Lu et al. 2025, Eq. 12), shape [m, k]."""
    parts = [_at_corners(disc, gradient) @ weights(layer) for gradient in np.moveaxis(shape_gradients(disc), 2, 0)]
    return sum(u.multiply(u) for u in parts).sqrt().tocsr()


def shares(disc: Discretisation, layer: Layer) -> sp.csr_matrix:
    """sum_k w_k |grad N_k| of each element and node [1/m]: the size of the terms of u, shape [m, k]."""
    return (_at_corners(disc, np.linalg.norm(shape_gradients(disc), axis=2)) @ weights(layer)).tocsr()


def weights(layer: Layer) -> sp.csr_matrix:
    """Weight of each vertex and node, shape [n, k]."""
    return prolongation(layer)[::3, ::3]


def _at_corners(disc: Discretisation, values: Floats) -> sp.csr_matrix:
    """Matrix of shape [m, n] of one value per corner of each element, shape [m, 4]."""
    elements = np.repeat(np.arange(disc.n_tets), 4)
    shape = (disc.n_tets, disc.n_vertices)
    return sp.csr_matrix((values.ravel(), (elements, disc.mesh.cells.ravel())), shape)


def _largest_column(matrix: sp.spmatrix) -> Floats:
    return matrix.tocsc().max(axis=0).toarray().ravel()


def _norm(A: Floats) -> Floats:
    return np.sqrt((A * A).sum(axis=(0, 1)))
