# SPDX-License-Identifier: BSD-3-Clause
"""Nodal loads of body forces and tractions, and norms of errors, by scikit-fem's quadrature."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.types import TetMesh
from verify.reference.elasticity import node_dofs, scalar_basis

Floats = NDArray[np.float64]

# Values at points of shape [3, ...]; the result has the components in front too.
Field = Callable[[Floats], Floats]

# Polynomials up to this degree are integrated exactly; beyond it the fields are smooth.
_ORDER = 4


def body_load(mesh: TetMesh, force: Callable[[Floats, NDArray[np.int64]], Floats], degree: int = 1) -> Floats:
    """Integral of N_a b [N], shape [n, 3], of b(points [3, m, q], elements [m]) [N/m^3]."""
    basis = scalar_basis(mesh, degree, _ORDER + degree)
    return _assembled(basis, force(_points(basis), np.arange(len(mesh.cells))))


def surface_load(mesh: TetMesh, on: Callable[[Floats], NDArray[np.bool_]], traction: Field, degree: int = 1) -> Floats:
    """Integral of N_a t [N], shape [n, 3], over the facets, inner ones too, whose midpoints [3, k] satisfy `on`.

    Raises
    ------
    ValueError
        No facet does.
    """
    from skfem import FacetBasis

    inside = scalar_basis(mesh, degree, _ORDER)
    facets = inside.mesh.facets_satisfying(on)
    if len(facets) == 0:
        raise ValueError("no facet of the mesh lies there")
    basis = FacetBasis(inside.mesh, inside.elem, facets=facets, intorder=_ORDER + degree)
    return _assembled(basis, traction(_points(basis)))


def error_norms(mesh: TetMesh, u: Floats, field: Field, gradient: Field) -> tuple[float, float]:
    """L2 norm [m^2.5] and H1 semi-norm [m^1.5] of the error of linear elements.

    Parameters
    ----------
    u : Displacements at the vertices [m], shape [n, 3].
    field, gradient : Exact displacement, and its gradient of shape [3, 3, ...].
    """
    basis = scalar_basis(mesh, 1, _ORDER)
    X = _points(basis)
    parts = [basis.interpolate(np.ascontiguousarray(component)) for component in u.T]
    values = np.stack([np.asarray(part) for part in parts]) - field(X)
    slopes = np.stack([part.grad for part in parts]) - gradient(X)
    weight = basis.dx
    return float(np.sqrt((values**2 * weight).sum())), float(np.sqrt((slopes**2 * weight).sum()))


def _points(basis: Any) -> Floats:
    """Quadrature points [m], shape [3, elements, points]."""
    return np.asarray(basis.global_coordinates())


def _assembled(basis: Any, values: Floats) -> Floats:
    from skfem import LinearForm

    work = LinearForm(lambda v, w: w.density * v)
    return np.stack([work.assemble(basis, density=one)[node_dofs(basis)] for one in values], axis=1)
