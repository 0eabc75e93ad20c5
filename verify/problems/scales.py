# SPDX-License-Identifier: BSD-3-Clause
"""How large single terms are: what the rounding of energies, forces and stiffnesses is relative to, on any mesh.

A deformation gradient F = D Dm^-1 = I + (D - Dm) Dm^-1 is a sum of products of positions or displacements and of
inverse rest edges, so it carries an error of u f, with u the unit roundoff and f = (|D| + |Dm| + r) |Dm^-1|; in a
sliver f is much larger than |F|. Positions are given in float64, so r is the largest coordinate in float64 and 2^-29 of
it in float32. To first order such an error changes the energy by |P| u f, the stress by |H| u f and the Hessian by
|dH/dF| u f. Where |F| or |C| stands below, 1 is added for the identity: passes that take it off round it as well. Sums
over the elements of a vertex add these up. A difference of two results over the sum of these terms is about u for any
element shape, material and deformation; a wrong formula makes it of the order of one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.kernels.backend import Precision

Floats = NDArray[np.float64]

# Twice the unit roundoff of each precision.
EPSILON = {name: float(np.finfo(name).eps) for name in ("float64", "float32")}


@dataclass(frozen=True, eq=False)
class Terms:
    """Sizes of the terms of each element, shape [m] each; Frobenius norms throughout.

    Parameters
    ----------
    stress : V |Dm^-1| |P| with |P| = mu |F| + |c| |C| [N], of forces whose F has no error.
    curvature : V |Dm^-1|^2 |H| with |H| = mu + lam |C|^2 + |c| |F| [N/m], of a Hessian whose F has no error.
    energy : V (mu/2 |F|^2 + mu |J - 1| + lam/2 (J - 1)^2 + |P| f) [J].
    force : V |Dm^-1| f |H| [N].
    stiffness : V |Dm^-1|^2 (|H| + f (lam |C| |F| + |c|)) [N/m].
    """

    stress: Floats
    curvature: Floats
    energy: Floats
    force: Floats
    stiffness: Floats


def terms(disc: Discretisation, x: Floats, precision: Precision = "float64") -> Terms:
    """Sizes of the terms at positions x [m], shape [n, 3]."""
    reach = float(np.abs(x).max()) * EPSILON["float64"] / EPSILON[precision]
    D, rest = _edges(disc, x), _edges(disc, disc.mesh.points)
    B = disc.B.reshape(-1, 3, 3)
    F = D @ B
    # The cofactor's columns are cross products of F's; at F of rank 2 and less too.
    C = np.stack([np.cross(F[:, :, i - 2], F[:, :, i - 1]) for i in range(3)], axis=2)
    j = np.einsum("ei,ei->e", F[:, :, 0], C[:, :, 0]) - 1.0
    c = np.abs(disc.lam * j - disc.mu)
    f = (_norm(D) + _norm(rest) + reach) * _norm(B)
    p, q = 1.0 + _norm(F), 1.0 + _norm(C)
    stress = disc.mu * p + c * q
    curvature = disc.mu + disc.lam * q**2 + c * p
    energy = 0.5 * disc.mu * p**2 + disc.mu * np.abs(j) + 0.5 * disc.lam * j**2 + stress * f
    stiffness = curvature + f * (disc.lam * q * p + c)
    return Terms(
        disc.V * _norm(B) * stress,
        disc.V * _norm(B) ** 2 * curvature,
        disc.V * energy,
        disc.V * _norm(B) * f * curvature,
        disc.V * _norm(B) ** 2 * stiffness,
    )


def at_vertices(disc: Discretisation, values: Floats) -> Floats:
    """Sum over the elements of each vertex of one value per element, shape [n, 1], to divide vectors by."""
    out = np.zeros((disc.n_vertices, 1))
    np.add.at(out[:, 0], disc.mesh.cells.ravel(), np.repeat(values, 4))
    return out


def product_terms(disc: Discretisation, x: Floats, d: Floats, precision: Precision = "float64") -> Floats:
    """Sizes of the terms of a Hessian product with d [m], stiffness times |d| summed over elements, shape [n, 1]."""
    size = np.linalg.norm(d[disc.mesh.cells], axis=(1, 2))
    return at_vertices(disc, terms(disc, x, precision).stiffness * size)


def _edges(disc: Discretisation, x: Floats) -> Floats:
    """Columns x1 - x0, x2 - x0, x3 - x0 of each element, shape [m, 3, 3]."""
    return (x[disc.mesh.cells[:, 1:]] - x[disc.mesh.cells[:, :1]]).transpose(0, 2, 1)


def _norm(A: Floats) -> Floats:
    return np.linalg.norm(A, axis=(1, 2))
