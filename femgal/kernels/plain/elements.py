# SPDX-License-Identifier: BSD-3-Clause
"""Element phase: one result per tetrahedron, written in place; elements start to stop - 1.

Every kernel writes only the rows of its own range, so any partition over threads gives the same bits.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.materials.stable_neo_hookean import (
    energy_along,
    energy_density,
    stress,
    stress_increment,
    stress_increment_definite,
)
from femgal.materials.tensor import Tensor, cofactor, determinant, like, multiply
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

# Elements per partial sum.
CHUNK = 1024


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
def stresses(
    start: int, stop: int, x: Floats, tets: Ints, B: Floats, Vmu: Floats, Vlam: Floats, active: Ints, P: Floats
) -> None:
    """P[k] = V times the first Piola-Kirchhoff stress of element active[k]."""
    for k in range(start, stop):
        e = active[k]
        store(P, k, stress(deformation_gradient(x, tets, B, e), Vmu[e], Vlam[e]))


@kernel
def stress_increments(
    start: int,
    stop: int,
    x: Floats,
    d: Floats,
    tets: Ints,
    B: Floats,
    Vmu: Floats,
    Vlam: Floats,
    active: Ints,
    P: Floats,
) -> None:
    """P[k] = V times the stress increment of element active[k] when the vertices move along d."""
    for k in range(start, stop):
        e = active[k]
        F = deformation_gradient(x, tets, B, e)
        store(P, k, stress_increment(F, deformation_gradient(d, tets, B, e), Vmu[e], Vlam[e]))


@kernel
def definite_stress_increments(
    start: int,
    stop: int,
    x: Floats,
    d: Floats,
    tets: Ints,
    B: Floats,
    Vmu: Floats,
    Vlam: Floats,
    active: Ints,
    P: Floats,
) -> None:
    """The same with the positive semi-definite part of the Hessian of each element."""
    for k in range(start, stop):
        e = active[k]
        F = deformation_gradient(x, tets, B, e)
        store(P, k, stress_increment_definite(F, deformation_gradient(d, tets, B, e), Vmu[e], Vlam[e]))


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


@kernel
def energies_along(
    start: int,
    stop: int,
    x: Floats,
    d: Floats,
    tets: Ints,
    B: Floats,
    Vmu: Floats,
    Vlam: Floats,
    active: Ints,
    coefficients: Floats,
) -> None:
    """Row c of the result: coefficients of t to t^6 in E(x + t d), summed over chunk c of the active elements.

    The chunks have a fixed size and their sums a fixed order, so the number of threads changes no bit.
    """
    for c in range(start, stop):
        s1 = s2 = s3 = s4 = s5 = s6 = 0.0
        for k in range(c * CHUNK, min(len(active), (c + 1) * CHUNK)):
            e = active[k]
            F, G = deformation_gradient(x, tets, B, e), deformation_gradient(d, tets, B, e)
            p = energy_along(F, G, Vmu[e], Vlam[e])
            s1 += p[0]
            s2 += p[1]
            s3 += p[2]
            s4 += p[3]
            s5 += p[4]
            s6 += p[5]
        coefficients[c, 0], coefficients[c, 1], coefficients[c, 2] = s1, s2, s3
        coefficients[c, 3], coefficients[c, 4], coefficients[c, 5] = s4, s5, s6


@scalar
def von_mises(F: Tensor, mu: Any) -> Any:
    """Von Mises norm of the Cauchy stress sigma = P F^T / J; infinite where the element has no volume.

    C F^T = J I, so sigma = mu F F^T / J + c I, and only the first term has a deviator.
    """
    s = multiply(F, (F[0], F[3], F[6], F[1], F[4], F[7], F[2], F[5], F[8]))
    a, b, c = s[0] - s[4], s[4] - s[8], s[8] - s[0]
    shear = s[1] * s[1] + s[2] * s[2] + s[5] * s[5]
    norm = sqrt(like(mu, 0.5) * (a * a + b * b + c * c) + like(mu, 3) * shear)
    return abs(mu / determinant(F, cofactor(F))) * norm


@kernel
def von_mises_stresses(start: int, stop: int, x: Floats, tets: Ints, B: Floats, mu: Floats, out: Floats) -> None:
    """Von Mises Cauchy stress [Pa] of each element."""
    for e in range(start, stop):
        out[e] = von_mises(deformation_gradient(x, tets, B, e), mu[e])
