# SPDX-License-Identifier: BSD-3-Clause
"""Stable neo-Hookean material without the logarithmic term (Smith et al. 2018; Lu et al. 2025, Eq. 13).

    Psi = mu/2 (I_C - 3) - mu (J - 1) + lam/2 (J - 1)^2
    P   = mu F + c C,   c = lam (J - 1) - mu,   C = cof F
    dP  = mu dF + lam (C : dF) C + c dC[dF]

F is the deformation gradient, a tuple of nine scalars in row-major order. mu and lam may carry the rest volume as a
factor; then energies are joules per element and stresses are forces per unit of gradient.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femgal.materials.svd import eigenvectors, singular_values
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
    multiply,
    transpose,
)
from meshes.jit import scalar


def parameters(E: ArrayLike, nu: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Material parameters that give Young's modulus E and Poisson's ratio nu at small strain.

    Parameters
    ----------
    E : Young's modulus [Pa], any shape.
    nu : Poisson's ratio [-], -1 < nu < 0.5, a shape that broadcasts with E.

    Returns
    -------
    mu, lam : [Pa]. mu = mu_Lame and lam = lam_Lame + mu_Lame (Smith et al. 2018, section 3.4): with lam_Lame put in
        directly the linearised body would have other moduli than the ones asked for.
    """
    E, nu = np.broadcast_arrays(np.asarray(E, np.float64), np.asarray(nu, np.float64))
    mu_lame = E / (2.0 * (1.0 + nu))
    lam_lame = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return mu_lame, lam_lame + mu_lame


@scalar
def energy_density(F: Tensor, mu: Any, lam: Any) -> Any:
    """Psi(F), zero at rest."""
    J1 = determinant(F, cofactor(F)) - like(mu, 1)
    return like(mu, 0.5) * mu * (contract(F, F) - like(mu, 3)) - mu * J1 + like(mu, 0.5) * lam * J1 * J1


@scalar
def stress(F: Tensor, mu: Any, lam: Any) -> Tensor:
    """First Piola-Kirchhoff stress P = mu F + c C."""
    C = cofactor(F)
    c = lam * (determinant(F, C) - like(mu, 1)) - mu
    return combine(mu, F, c, C)


@scalar
def stress_increment(F: Tensor, dF: Tensor, mu: Any, lam: Any) -> Tensor:
    """Hessian action dP[dF] = mu dF + lam (C : dF) C + c dC[dF]."""
    C = cofactor(F)
    c = lam * (determinant(F, C) - like(mu, 1)) - mu
    P = combine(mu, dF, lam * contract(C, dF), C)
    return combine(like(mu, 1), P, c, cofactor_increment(F, dF))


@scalar
def stress_increment_definite(F: Tensor, dF: Tensor, mu: Any, lam: Any) -> Tensor:
    """Action on dF of the Hessian with its negative eigenvalues set to zero; finite for every finite F.

    Where the Hessian is positive semi-definite it is `stress_increment`. An element without material (mu = lam = 0)
    gives zero.
    """
    return spectral_action(definite_spectrum(F, mu, lam), dF)


@scalar
def definite_spectrum(F: Tensor, mu: Any, lam: Any) -> tuple[Tensor, Tensor, Vector, Vector, Vector]:
    """The Hessian without its negative part, in the frame of F = U diag(s) V^T (Smith, de Goes, Kim 2019).

    With dG = U^T dF V the Hessian falls into a block of the three stretches, mu I + lam z z^T + c M with
    z = (s1 s2, s2 s0, s0 s1) and M_ij = s_k for i, j, k all different, and for each pair i < j the flip
    (dG_ij + dG_ji) / 2 with eigenvalue mu - c s_k and the twist (dG_ij - dG_ji) / 2 with eigenvalue mu + c s_k.

    Returns
    -------
    U, V : the rotations.
    block : of the stretches, without its negative eigenvalues, as xx xy xz yy yz zz.
    flip, twist : eigenvalues, none negative, of the pairs yz, zx, xy.
    """
    U, s, V = singular_values(F)
    c = lam * (s[0] * s[1] * s[2] - like(mu, 1)) - mu
    x, y, z = c * s[0], c * s[1], c * s[2]
    flip, twist = _above_zero((mu - x, mu - y, mu - z)), _above_zero((mu + x, mu + y, mu + z))
    return U, V, _stretch_block(s, c, mu, lam), flip, twist


@scalar
def spectral_action(spectrum: tuple[Tensor, Tensor, Vector, Vector, Vector], dF: Tensor) -> Tensor:
    """dP = U dQ V^T, with dQ the Hessian of `definite_spectrum` applied to U^T dF V."""
    U, V, B, flip, twist = spectrum
    G = multiply(multiply(transpose(U), dF), V)
    yz, zy = _flip_and_twist(G[5], G[7], flip[0], twist[0])
    zx, xz = _flip_and_twist(G[6], G[2], flip[1], twist[1])
    xy, yx = _flip_and_twist(G[1], G[3], flip[2], twist[2])
    xx = B[0] * G[0] + B[1] * G[4] + B[2] * G[8]
    yy = B[1] * G[0] + B[3] * G[4] + B[4] * G[8]
    zz = B[2] * G[0] + B[4] * G[4] + B[5] * G[8]
    return multiply(multiply(U, (xx, xy, xz, yx, yy, yz, zx, zy, zz)), transpose(V))


@scalar
def _flip_and_twist(a: Any, b: Any, flip: Any, twist: Any) -> Vector:
    """Both off-diagonal entries of a pair: flip (a + b) / 2 plus and minus twist (a - b) / 2."""
    p, q = like(a, 0.5) * flip * (a + b), like(a, 0.5) * twist * (a - b)
    return p + q, p - q


@scalar
def _stretch_block(s: Vector, c: Any, mu: Any, lam: Any) -> Vector:
    """The block mu I + lam z z^T + c M without its negative eigenvalues, xx xy xz yy yz zz."""
    x, y, z = s[1] * s[2], s[2] * s[0], s[0] * s[1]
    # No entry is larger than this sum; zero only without material.
    size = mu + lam * (x * x + y * y + z * z) + abs(c) * (abs(s[0]) + abs(s[1]) + abs(s[2]))
    a = like(mu, 1) / (size + like(mu, 1e-30))
    b, d, e = a * lam, a * mu, a * c
    values, (p, q, r) = eigenvectors(
        (
            d + b * x * x,
            b * x * y + e * s[2],
            b * x * z + e * s[1],
            d + b * y * y,
            b * y * z + e * s[0],
            d + b * z * z,
        )
    )
    a, b, c = _above_zero((size * values[0], size * values[1], size * values[2]))
    return (
        a * p[0] * p[0] + b * q[0] * q[0] + c * r[0] * r[0],
        a * p[0] * p[1] + b * q[0] * q[1] + c * r[0] * r[1],
        a * p[0] * p[2] + b * q[0] * q[2] + c * r[0] * r[2],
        a * p[1] * p[1] + b * q[1] * q[1] + c * r[1] * r[1],
        a * p[1] * p[2] + b * q[1] * q[2] + c * r[1] * r[2],
        a * p[2] * p[2] + b * q[2] * q[2] + c * r[2] * r[2],
    )


@scalar
def _above_zero(values: Vector) -> Vector:
    zero = like(values[0], 0)
    return (
        values[0] if values[0] > zero else zero,
        values[1] if values[1] > zero else zero,
        values[2] if values[2] > zero else zero,
    )


@scalar
def energy_along(F: Tensor, G: Tensor, mu: Any, lam: Any) -> Vector:
    """Coefficients of t, t^2, ..., t^6 in Psi(F + t G) - Psi(F).

    J(F + t G) = J + t (C : G) + t^2 (cof G : F) + t^3 det G, so the energy along a line is a polynomial; leaving out
    the constant spares the cancellation of two large energies.
    """
    C, D = cofactor(F), cofactor(G)
    j0, j1, j2, j3 = determinant(F, C) - like(mu, 1), contract(C, G), contract(D, F), determinant(G, D)
    c = lam * j0 - mu
    return (
        mu * contract(F, G) + c * j1,
        like(mu, 0.5) * (mu * contract(G, G) + lam * j1 * j1) + c * j2,
        lam * j1 * j2 + c * j3,
        lam * (like(mu, 0.5) * j2 * j2 + j1 * j3),
        lam * j2 * j3,
        like(mu, 0.5) * lam * j3 * j3,
    )


@scalar
def node_gradient(F: Tensor, C: Tensor, mu: Any, lam: Any, u: Vector) -> Vector:
    """Gradient of the energy of one element with respect to one node, mu F u + c z with z = C u (Lu et al. Eq. 16).

    u = sum_k w_k grad N_k for a node that moves vertex k by w_k.
    """
    c = lam * (determinant(F, C) - like(mu, 1)) - mu
    a, z = apply(F, u), apply(C, u)
    return (mu * a[0] + c * z[0], mu * a[1] + c * z[1], mu * a[2] + c * z[2])


@scalar
def node_block(C: Tensor, mu: Any, lam: Any, u: Vector) -> Vector:
    """Diagonal block of the Hessian at one node, mu |u|^2 I + lam z z^T (Lu et al. Eq. 15), as xx xy xz yy yz zz.

    Exact and positive definite at any F: the second derivative of J vanishes because J is linear along F + t a u^T.
    """
    z = apply(C, u)
    d = mu * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    return (
        d + lam * z[0] * z[0],
        lam * z[0] * z[1],
        lam * z[0] * z[2],
        d + lam * z[1] * z[1],
        lam * z[1] * z[2],
        d + lam * z[2] * z[2],
    )
