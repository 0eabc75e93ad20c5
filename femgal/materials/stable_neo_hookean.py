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
