# SPDX-License-Identifier: BSD-3-Clause
"""Assembled Hessians against scikit-fem's and against eigenvalues of every element."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from femgal.assembly.hessian import assemble
from femgal.kernels.backend import Precision
from verify.problems.bodies import STATES, body, rng
from verify.reference.galerkin import assembled
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare, worst
from verify.suite.use import Use

Floats = NDArray[np.float64]

_MESHES = ("box", "rabbit", "bunny")
_QUICK = {"mesh": ("box",), "precision": ("float64",)}


@case(
    "assembly/hessian",
    title="The assembled matrix is the Hessian of the incremental potential over the free vertices",
    quantity="largest entry of the difference over the largest entry of the block row, worst of all states",
    unit="N/m",
    kind=Kind.CROSS_CODE,
    formula="M / h^2 + d2 E(x), exact",
    source="scikit-fem's Hessian and lumped mass, rows and columns of the free vertices",
    tolerance={"float64": 1e-12, "float32": 2e-5},
    reason="rounding of sums over elements whose shares cancel",
    over={"mesh": _MESHES, "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem; the bunny's surface for its rows",
    own_mesh=True,
)
def hessian(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """At rest, and at states that are random, stretched and turned inside out."""
    disc, found = body(mesh), {}
    at = np.repeat(disc.free, 3)
    for state in STATES:
        one = assembled(disc, state)
        expected = one.A[at][:, at]
        made = assemble(disc, one.x, one.inverse_h2, definite=False, precision=precision).to_scipy()
        found[state] = compare(*_scaled(made, expected))
    return worst(found)


@case(
    "assembly/definite",
    title="The assembled matrix without negative parts is the sum of the positive semi-definite parts of the elements",
    quantity="largest error of a force over the largest force, worst of all states",
    unit="N",
    kind=Kind.CROSS_CODE,
    formula="A d = M d / h^2 + sum over elements of the projection of V dP/dF on its positive eigenvalues",
    source="eigenvalues of the 9x9 matrices by LAPACK (Smith et al. 2019 give them in closed form)",
    tolerance={"float64": 1e-11, "float32": 2e-5},
    reason="rounding of the singular values of F, and of sums over elements",
    over={"mesh": _MESHES, "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem; the bunny's surface for its rows",
    own_mesh=True,
)
def definite(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Times a random displacement, at rest, and at states that are random, stretched and turned inside out."""
    disc, found = body(mesh), {}
    d = rng(62).standard_normal(disc.mesh.points.shape) * disc.free[:, None]
    for state in STATES:
        one = assembled(disc, state)
        made = assemble(disc, one.x, one.inverse_h2, precision=precision).product(d[disc.free].astype(precision))
        expected = one.definite_product(d) + one.inverse_h2 * disc.mass[:, None] * d
        found[state] = compare(made, expected[disc.free])
    return worst(found)


def _scaled(made: sp.spmatrix, expected: sp.csr_matrix) -> tuple[Floats, Floats]:
    """Both matrices, dense, every block row over its largest entry in the second one."""
    largest = abs(expected).max(axis=1).toarray().reshape(-1, 3).max(axis=1)
    scale = np.repeat(1.0 / largest, 3)[:, None]
    return scale * made.toarray(), scale * expected.toarray()
