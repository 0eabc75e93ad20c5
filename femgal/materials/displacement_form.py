# SPDX-License-Identifier: BSD-3-Clause
"""Stable neo-Hookean material of the displacement gradient G = F - I: the same physics with less rounding.

Near rest F is the identity and a little more, so stress and J - 1 of F are small differences of large terms. Written
in G they are not, which makes single precision usable: without rotation the noise of a stress at small strain falls by
more than a decade; with rotation G is no longer small and the gain is lost. With
K = cof F - I = tr(G) I - G^T + cof G and j = J - 1 = tr G + tr(cof G) + det G,

    Psi = mu (G:G / 2 - tr(cof G) - det G) + lam/2 j^2
    P   = mu (G - K) + lam j C,   C = I + K,   G - K = G + G^T - tr(G) I - cof G
    dP  = mu dG + lam (C : dG) C + (lam j - mu) dC[dG]

As in `femgal.materials.stable_neo_hookean`, mu and lam may carry the rest volume as a factor.
"""

from __future__ import annotations

from typing import Any

from femgal.materials.tensor import (
    Tensor,
    Vector,
    apply,
    cofactor,
    cofactor_increment,
    combine,
    contract,
    determinant,
    like,
)
from meshes.jit import scalar


@scalar
def trace(A: Tensor) -> Any:
    """tr A."""
    return A[0] + A[4] + A[8]


@scalar
def add_identity(A: Tensor) -> Tensor:
    """I + A."""
    one = like(A[0], 1)
    return (A[0] + one, A[1], A[2], A[3], A[4] + one, A[5], A[6], A[7], A[8] + one)


@scalar
def volume_terms(G: Tensor) -> tuple[Tensor, Any]:
    """K = cof(I + G) - I and j = det(I + G) - 1."""
    D, t = cofactor(G), trace(G)
    K = (
        t - G[0] + D[0],
        D[1] - G[3],
        D[2] - G[6],
        D[3] - G[1],
        t - G[4] + D[4],
        D[5] - G[7],
        D[6] - G[2],
        D[7] - G[5],
        t - G[8] + D[8],
    )
    return K, t + trace(D) + determinant(G, D)


@scalar
def stress_and_cofactor(G: Tensor, mu: Any, lam: Any) -> tuple[Tensor, Tensor]:
    """First Piola-Kirchhoff stress P and C = cof F."""
    K, j = volume_terms(G)
    C = add_identity(K)
    s = lam * j
    P = (
        mu * (G[0] - K[0]) + s * C[0],
        mu * (G[1] - K[1]) + s * C[1],
        mu * (G[2] - K[2]) + s * C[2],
        mu * (G[3] - K[3]) + s * C[3],
        mu * (G[4] - K[4]) + s * C[4],
        mu * (G[5] - K[5]) + s * C[5],
        mu * (G[6] - K[6]) + s * C[6],
        mu * (G[7] - K[7]) + s * C[7],
        mu * (G[8] - K[8]) + s * C[8],
    )
    return P, C


@scalar
def energy_and_volume(G: Tensor, mu: Any, lam: Any) -> tuple[Any, Any]:
    """Psi and J - 1."""
    D, t = cofactor(G), trace(G)
    m, det = trace(D), determinant(G, D)
    j = t + m + det
    return mu * (like(mu, 0.5) * contract(G, G) - m - det) + like(mu, 0.5) * lam * j * j, j


@scalar
def stress_increment(G: Tensor, dG: Tensor, mu: Any, lam: Any) -> Tensor:
    """Hessian action dP[dG] at F = I + G."""
    K, j = volume_terms(G)
    C = add_identity(K)
    P = combine(mu, dG, lam * contract(C, dG), C)
    return combine(like(mu, 1), P, lam * j - mu, cofactor_increment(add_identity(G), dG))


@scalar
def energy_along(G: Tensor, dG: Tensor, mu: Any, lam: Any) -> Vector:
    """Coefficients of t, t^2, ..., t^6 in Psi(G + t dG) - Psi(G); J(G + t dG) = J + j1 t + j2 t^2 + j3 t^3."""
    P, C = stress_and_cofactor(G, mu, lam)
    D = cofactor(dG)
    _, j0 = volume_terms(G)
    j1, j2, j3 = contract(C, dG), trace(D) + contract(D, G), determinant(dG, D)
    half = like(mu, 0.5)
    return (
        contract(P, dG),
        mu * (half * contract(dG, dG) - j2) + lam * (half * j1 * j1 + j0 * j2),
        lam * (j1 * j2 + j0 * j3) - mu * j3,
        lam * (half * j2 * j2 + j1 * j3),
        lam * j2 * j3,
        half * lam * j3 * j3,
    )


@scalar
def node_terms(P: Tensor, C: Tensor, mu: Any, lam: Any, u: Vector) -> Vector:
    """Gradient P u and block mu |u|^2 I + lam z z^T, z = C u, of one node (Lu et al. 2025, Eq. 15 and 16)."""
    g, z = apply(P, u), apply(C, u)
    d = mu * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    y = (lam * z[0], lam * z[1], lam * z[2])
    return (
        g[0],
        g[1],
        g[2],
        d + y[0] * z[0],
        y[0] * z[1],
        y[0] * z[2],
        d + y[1] * z[1],
        y[1] * z[2],
        d + y[2] * z[2],
    )
