# SPDX-License-Identifier: BSD-3-Clause
"""Element phase: one result per tetrahedron, written in place; elements start to stop - 1.

Every kernel writes only the rows of its own range, so any partition over threads gives the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.materials.stable_neo_hookean import energy_density, stress, stress_increment
from femgal.materials.tensor import Tensor, cofactor, combine, determinant, like, multiply
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@scalar
def edge_matrix(x: Floats, tets: Ints, e: int) -> Tensor:
    """Ds, columns x1 - x0, x2 - x0, x3 - x0 of element e."""
    a, b, c, d = tets[e, 0], tets[e, 1], tets[e, 2], tets[e, 3]
    return (
        x[b, 0] - x[a, 0],
        x[c, 0] - x[a, 0],
        x[d, 0] - x[a, 0],
        x[b, 1] - x[a, 1],
        x[c, 1] - x[a, 1],
        x[d, 1] - x[a, 1],
        x[b, 2] - x[a, 2],
        x[c, 2] - x[a, 2],
        x[d, 2] - x[a, 2],
    )


@scalar
def load(A: Floats, k: int) -> Tensor:
    """Row k of an (n, 9) array as a tensor."""
    return (A[k, 0], A[k, 1], A[k, 2], A[k, 3], A[k, 4], A[k, 5], A[k, 6], A[k, 7], A[k, 8])


@scalar
def store(A: Floats, k: int, T: Tensor) -> None:
    """Write a tensor to row k of an (n, 9) array."""
    A[k, 0], A[k, 1], A[k, 2] = T[0], T[1], T[2]
    A[k, 3], A[k, 4], A[k, 5] = T[3], T[4], T[5]
    A[k, 6], A[k, 7], A[k, 8] = T[6], T[7], T[8]


@scalar
def deformation_gradient(x: Floats, tets: Ints, B: Floats, e: int) -> Tensor:
    """F = Ds B with B = Dm^-1."""
    return multiply(edge_matrix(x, tets, e), load(B, e))


@kernel
def deformation_gradients(start: int, stop: int, x: Floats, tets: Ints, B: Floats, active: Ints, F: Floats) -> None:
    """F[k] = deformation gradient of element active[k]."""
    for k in range(start, stop):
        store(F, k, deformation_gradient(x, tets, B, active[k]))


@kernel
def stresses(start: int, stop: int, x: Floats, tets: Ints, B: Floats, Vmu: Floats, Vlam: Floats, P: Floats) -> None:
    """P[e] = V times the first Piola-Kirchhoff stress of element e."""
    for e in range(start, stop):
        store(P, e, stress(deformation_gradient(x, tets, B, e), Vmu[e], Vlam[e]))


@kernel
def stress_increments(
    start: int, stop: int, x: Floats, d: Floats, tets: Ints, B: Floats, Vmu: Floats, Vlam: Floats, P: Floats
) -> None:
    """P[e] = V times the stress increment of element e when the vertices move along d."""
    for e in range(start, stop):
        F = deformation_gradient(x, tets, B, e)
        store(P, e, stress_increment(F, deformation_gradient(d, tets, B, e), Vmu[e], Vlam[e]))


@kernel
def energies(
    start: int,
    stop: int,
    x: Floats,
    tets: Ints,
    B: Floats,
    Vmu: Floats,
    Vlam: Floats,
    energy: Floats,
    J: Floats,
) -> None:
    """Elastic energy [J] and volume ratio J of each element."""
    for e in range(start, stop):
        F = deformation_gradient(x, tets, B, e)
        energy[e] = energy_density(F, Vmu[e], Vlam[e])
        J[e] = determinant(F, cofactor(F))


@scalar
def von_mises(F: Tensor, mu: Any, lam: Any) -> Any:
    """Von Mises norm of the Cauchy stress sigma = P F^T / J; infinite where the element has no volume."""
    C = cofactor(F)
    J = determinant(F, C)
    # C F^T = J I, so sigma = mu F F^T / J + c I: only the first term has a deviator.
    Ft = (F[0], F[3], F[6], F[1], F[4], F[7], F[2], F[5], F[8])
    s = multiply(F, Ft)
    s = combine(mu / J, s, like(mu, 0), s)
    a, b, c = s[0] - s[4], s[4] - s[8], s[8] - s[0]
    shear = s[1] * s[1] + s[2] * s[2] + s[5] * s[5]
    return np.sqrt(like(mu, 0.5) * (a * a + b * b + c * c) + like(mu, 3) * shear)


@kernel
def von_mises_stresses(
    start: int, stop: int, x: Floats, tets: Ints, B: Floats, mu: Floats, lam: Floats, out: Floats
) -> None:
    """Von Mises Cauchy stress [Pa] of each element."""
    for e in range(start, stop):
        out[e] = von_mises(deformation_gradient(x, tets, B, e), mu[e], lam[e])
