# SPDX-License-Identifier: BSD-3-Clause
"""Energy, stress and stiffness of uniform deformations against closed forms."""

from __future__ import annotations

import numpy as np

from femgal.kernels.backend import Precision
from verify.case import PRECISIONS, Kind, Measurement, case
from verify.measure import compare
from verify.problems import body, force_scale
from verify.use import Use


@case(
    "material/simple-shear",
    title="Simple shear: the vertex forces are those of the closed-form stress",
    quantity="largest difference of a vertex force over the largest term of one element",
    unit="N",
    kind=Kind.CLOSED_FORM,
    formula="P = mu g (e1 (x) e2 + e2 (x) e1) at F = I + g e1 (x) e2, where J = 1",
    source="from P = mu F + (lam (J - 1) - mu) cof F, Smith et al. 2018, Eq. 13",
    tolerance={"float64": 1e-12, "float32": 2e-5},
    reason="rounding of a sum over some twenty elements",
    over={"precision": PRECISIONS, "mesh": ("box", "rabbit")},
)
def simple_shear(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Forces of a sheared body."""
    disc, g = body(mesh, "uniform", held=False), 0.4
    F = np.eye(3)
    F[0, 1] = g
    x = disc.mesh.points @ F.T
    mu = float(disc.mu[0])
    P = mu * np.array([[0.0, g, 0.0], [g, 0.0, 0.0], [0.0, 0.0, 0.0]])
    grad = disc.B.reshape(-1, 3, 3)
    corners = np.concatenate([-grad.sum(axis=1, keepdims=True), grad], axis=1)
    expected = np.zeros_like(x)
    np.add.at(expected, disc.mesh.cells, np.einsum("e,ij,ekj->eki", disc.V, P, corners))
    return compare(use.backend(disc, precision).gradient(x), expected, force_scale(disc, x))
