# SPDX-License-Identifier: BSD-3-Clause
"""A body crushed to a point: F = 0, where this energy has a local minimum of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.kernels.backend import Precision
from verify.problems.bodies import OWN, body, released
from verify.problems.scales import EPSILON, at_vertices, product_terms, terms
from verify.reference.elasticity import node_dofs, scalar_basis
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare, vanishes
from verify.suite.use import Use

Floats = NDArray[np.float64]

_OVER = {"precision": PRECISIONS, "mesh": ("rabbit", "slivers")}
_QUICK = {"mesh": ("rabbit", OWN)}
_REASON = "machine epsilon: the sum of the terms bounds what rounding does"


def crushed(disc: Discretisation) -> Floats:
    """All vertices at the middle of the body [m]."""
    X = disc.mesh.points
    return np.broadcast_to(0.5 * (X.min(axis=0) + X.max(axis=0)), X.shape).copy()


@case(
    "collapse/energy",
    title="An element crushed to a point has the energy V (lam - mu) / 2",
    quantity="largest difference of an element's energy, over the sum of its terms",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="Psi(0) = (lam - mu) / 2 = mu nu / (1 - 2 nu): less than at rest for nu < 0",
    source="Psi = mu/2 (I_C - 3) - mu (J - 1) + lam/2 (J - 1)^2 at F = 0",
    tolerance=EPSILON,
    reason=_REASON,
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def energy(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Energies of all elements."""
    disc = body(mesh)
    x = crushed(disc)
    scale = terms(disc, x, precision).energy
    return compare(use.backend(disc, precision).energies(x)[0] / scale, 0.5 * (disc.Vlam - disc.Vmu) / scale, 1.0)


@case(
    "collapse/forces",
    title="A body crushed to a point feels no force: it stays there",
    quantity="largest vertex force, over the sum of its terms",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="P(0) = 0",
    source="P = mu F + (lam (J - 1) - mu) cof F at F = 0",
    tolerance=EPSILON,
    reason=_REASON,
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def forces(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Gradient of the whole body."""
    disc = released(body(mesh))
    x = crushed(disc)
    return vanishes(use.backend(disc, precision).gradient(x) / at_vertices(disc, terms(disc, x, precision).force), 1.0)


@case(
    "collapse/hessian",
    title="The Hessian of a body crushed to a point is that of three independent Laplacians with weight mu",
    quantity="largest difference of a product at a vertex, over the sum of its terms",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="H = mu I at F = 0, exact and definite part alike",
    source="scikit-fem assembles the integral of mu grad u . grad v",
    tolerance=EPSILON,
    reason=_REASON,
    over={**_OVER, "part": ("exact", "definite")},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def hessian(use: Use, *, precision: Precision, mesh: str, part: str) -> Measurement:
    """A product with a random direction."""
    disc = released(body(mesh))
    x, d = crushed(disc), use.rng(641).standard_normal(disc.mesh.points.shape)
    scale = product_terms(disc, x, d, precision)
    computed = use.backend(disc, precision).hessian_product(x, d, definite=part == "definite")
    return compare(computed / scale, laplacian(disc) @ d / scale, 1.0)


def laplacian(disc: Discretisation) -> sp.csr_matrix:
    """Matrix of the integral of mu grad u . grad v for scalar u and v [N/m], shape [n, n]."""
    from skfem import BilinearForm

    basis = scalar_basis(disc.mesh, 1, 0)

    def work(u: Any, v: Any, w: Any) -> Any:
        return w.mu * np.einsum("i...,i...->...", u.grad, v.grad)

    order = node_dofs(basis)
    return BilinearForm(work).assemble(basis, mu=disc.mu[:, None]).tocsr()[order][:, order]
