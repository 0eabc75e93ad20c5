# SPDX-License-Identifier: BSD-3-Clause
"""A bound of the stable step of explicit integration, element by element and without any iteration.

K = sum_e K_e with 0 <= K_e <= lambda_e on the vertices of element e, lambda_e its largest eigenvalue. So K lies below
the diagonal matrix with k_i = sum of lambda_e over the elements of vertex i, and

    omega_max^2 <= max_i k_i / m_i <= max_e 4 lambda_e / (rho_e V_e).

The right-hand side, the fastest element on its own, is the bound of Irons and Treharne (1971) that explicit codes
step by. The middle one is never above it, because k_i / m_i is a weighted mean over the elements of a vertex. The
difference matters where elements are bad: the vertices of a sliver are held by the mass of its good neighbours.
On good meshes the roots of both are a small multiple of omega_max, on meshes with slivers only that of the middle one
(tests/femgal/test_stable_step.py).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.kernels.cpu.threads import Workers
from femgal.materials.tensor import Tensor, Vector, like
from meshes.jit import kernel, scalar

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def element_stiffness(disc: Discretisation, workers: Workers) -> Floats:
    """lambda_e [N/m]: largest eigenvalue at rest of the stiffness of each element at its free vertices, shape [m]."""
    out = np.empty(disc.n_tets)
    workers.run(_largest_eigenvalues, len(out), disc.mesh.cells, disc.B, disc.Vmu, disc.Vlam, disc.free, out)
    return out


def vertex_stiffness(disc: Discretisation, stiffness: Floats) -> Floats:
    """k_i [N/m]: sum of lambda_e over the elements of each free vertex, shape [n]; zero at constrained ones."""
    out = np.zeros(disc.n_vertices)
    _add_to_vertices(disc.mesh.cells, stiffness, out)
    out[~disc.free] = 0.0
    return out


def guaranteed_step(k: Floats, mass: Floats) -> float:
    """2 / max_i sqrt(k_i / m_i) [s]: explicit steps up to this one are stable at rest; infinite where nothing moves."""
    fastest = float((k / mass).max())
    return 2.0 / math.sqrt(fastest) if fastest > 0.0 else math.inf


@scalar
def largest_eigenvalue(A: Tensor, mu: Any, lam: Any) -> Any:
    """Largest eigenvalue of the 12x12 stiffness of one element, for parameters that carry its volume.

    With A = sum_k grad N_k grad N_k^T the forces sigma grad N_k have the same eigenvalues as
    sigma -> mu (sigma A + A sigma) + l tr(sigma A) I, l = lam - mu, on symmetric matrices. In the axes of A, with
    eigenvalues a_1 >= a_2 >= a_3, these are mu (a_i + a_j) for shear and those of
    S = 2 mu diag(a) + l sqrt(a) sqrt(a)^T for stretch, whose invariants follow from the invariants of A. Shear is never
    the fastest: l >= -2 mu / 3, so that already the first two rows and columns of S have an eigenvalue of
    mu (a_1 + a_2) or more.
    """
    e = _invariants(A)
    two_mu, l = like(mu, 2) * mu, lam - mu  # noqa: E741
    return _largest_root(
        (two_mu + l) * e[0], like(mu, 2) * two_mu * lam * e[1], two_mu * two_mu * (two_mu + like(mu, 3) * l) * e[2]
    )


@scalar
def _invariants(A: Tensor) -> Vector:
    """Trace, sum of principal minors and determinant of a symmetric matrix."""
    m0, m1, m2 = A[4] * A[8] - A[5] * A[5], A[0] * A[8] - A[2] * A[2], A[0] * A[4] - A[1] * A[1]
    c1, c2 = A[1] * A[8] - A[2] * A[5], A[1] * A[5] - A[2] * A[4]
    return (A[0] + A[4] + A[8], m0 + m1 + m2, A[0] * m0 - A[1] * c1 + A[2] * c2)


@scalar
def _largest_root(t1: Any, t2: Any, t3: Any) -> Any:
    """Largest root of x^3 - t1 x^2 + t2 x - t3, all of whose roots are real (Viete)."""
    mean = t1 / like(t1, 3)
    p = max(mean * mean - t2 / like(t1, 3), like(t1, 0))
    q = mean * mean * mean - like(t1, 0.5) * (mean * t2 - t3)
    root = np.sqrt(p)
    cube = p * root
    # Equal roots leave rounding errors only: any angle will do.
    cosine = q / cube if cube > like(t1, 0) else like(t1, 1)
    angle = np.arccos(min(max(cosine, like(t1, -1)), like(t1, 1)))
    return mean + like(t1, 2) * root * np.cos(angle / like(t1, 3))


@kernel
def _largest_eigenvalues(
    start: int, stop: int, tets: Ints, B: Floats, Vmu: Floats, Vlam: Floats, free: NDArray[np.bool_], out: Floats
) -> None:
    for e in range(start, stop):
        a00 = a01 = a02 = a11 = a12 = a22 = 0.0
        for k in range(4):
            if not free[tets[e, k]]:
                continue
            if k == 0:
                g0 = -(B[e, 0] + B[e, 3] + B[e, 6])
                g1 = -(B[e, 1] + B[e, 4] + B[e, 7])
                g2 = -(B[e, 2] + B[e, 5] + B[e, 8])
            else:
                g0, g1, g2 = B[e, 3 * k - 3], B[e, 3 * k - 2], B[e, 3 * k - 1]
            a00 += g0 * g0
            a01 += g0 * g1
            a02 += g0 * g2
            a11 += g1 * g1
            a12 += g1 * g2
            a22 += g2 * g2
        A = (a00, a01, a02, a01, a11, a12, a02, a12, a22)
        out[e] = largest_eigenvalue(A, Vmu[e], Vlam[e])


@kernel
def _add_to_vertices(tets: Ints, values: Floats, out: Floats) -> None:
    """Add the value of each element to each of its vertices."""
    for e in range(len(tets)):
        for k in range(4):
            out[tets[e, k]] += values[e]
