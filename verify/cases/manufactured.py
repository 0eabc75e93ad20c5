# SPDX-License-Identifier: BSD-3-Clause
"""Manufactured solutions: the rates at which linear tetrahedra converge at finite strain, and how large the error is.

Newton's method looks for the zero of production's forces less the manufactured load, with scikit-fem's matrix; the
boundary is held at the exact displacement. The material is uniform, or ten times as stiff beyond the plane x = 1/2,
with a kink of the displacement and an interface load there (the traction is not continuous; the load balances it).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.backend import Precision
from meshes.generators import box
from meshes.surface import boundary
from verify.reference.loads import body_load, error_norms, surface_load
from verify.reference.manufactured import ManufacturedField, kinked_field, smooth_field
from verify.reference.statics import ProductionElasticity, equilibrium
from verify.suite.case import PRECISIONS, Curve, Kind, Measurement, case
from verify.suite.measure import at_most, compare, order
from verify.suite.use import Use

Floats = NDArray[np.float64]

MATERIALS = ("uniform", "jump")
FINEST = (8, 16)
NORMS = ("l2", "h1")

_INTERFACE = 0.5
_FORMULA = "u given, b = -Div P = -(mu lap u + lam C grad J), jump of the traction as a load on the interface"
_SOURCE = "method of manufactured solutions, finite strain: Aycock, Rebelo and Craven 2019; rates: Strang and Fix 1973"


@dataclass(frozen=True)
class Errors:
    """Errors of the solution and of the exact displacement's interpolant; relative to norms of the displacement."""

    l2: float
    h1: float
    l2_interpolated: float
    h1_interpolated: float


@case(
    "manufactured/l2-order",
    title="Displacements converge with order 2 in the L2 norm",
    quantity="order between the two finest meshes",
    unit="1",
    kind=Kind.MANUFACTURED,
    formula=_FORMULA,
    source=_SOURCE,
    tolerance=0.1,
    reason="the next term of the error: 0.05 at 8 cells, 0.02 at 16",
    over={"material": MATERIALS, "finest": (16,)},
    quick=False,
)
def l2_order(use: Use, *, material: str, finest: int) -> Measurement:
    """Three meshes, each with twice the cells of the one before."""
    return _order(use, "l2", 2.0, material, finest)


@case(
    "manufactured/l2-order-coarse",
    title="So they do on coarse meshes, where the material is uniform",
    quantity="order between the two finest meshes",
    unit="1",
    kind=Kind.MANUFACTURED,
    formula=_FORMULA,
    source=_SOURCE,
    tolerance=0.1,
    reason="the next term of the error: 0.05 at 8 cells (with the jump of material 0.13, which is no order yet)",
    over={"material": ("uniform",), "finest": (8,)},
)
def l2_order_coarse(use: Use, *, material: str, finest: int) -> Measurement:
    """Three meshes, each with twice the cells of the one before."""
    return _order(use, "l2", 2.0, material, finest)


@case(
    "manufactured/h1-order",
    title="Deformation gradients converge with order 1: the H1 semi-norm",
    quantity="order between the two finest meshes",
    unit="1",
    kind=Kind.MANUFACTURED,
    formula=_FORMULA,
    source=_SOURCE,
    tolerance=0.05,
    reason="the next term of the error: 0.015 at 8 cells",
    over={"material": MATERIALS, "finest": FINEST},
    quick={"finest": (8,)},
)
def h1_order(use: Use, *, material: str, finest: int) -> Measurement:
    """Three meshes, each with twice the cells of the one before."""
    return _order(use, "h1", 1.0, material, finest)


@case(
    "manufactured/error",
    title="The error is not above that of the exact displacement's interpolant by more than theory allows",
    quantity="error over that of the interpolant",
    unit="1",
    kind=Kind.MANUFACTURED,
    formula=_FORMULA,
    source=_SOURCE,
    tolerance=0.0,
    reason="the bounds: 1.02 in H1, where Galerkin's solution is nearly the best there is; 1.5 in L2, where it is not",
    over={"norm": NORMS, "material": MATERIALS, "finest": FINEST},
    quick={"finest": (8,)},
)
def error(use: Use, *, norm: str, material: str, finest: int) -> Measurement:
    """The finest mesh."""
    found = solve(use, material, finest)
    value = getattr(found, norm)
    ratio = value / getattr(found, f"{norm}_interpolated")
    return at_most(ratio, {"l2": 1.5, "h1": 1.02}[norm], f"relative error {value:.3g}")


@case(
    "manufactured/single-precision",
    title="Forces in single precision lead to the same error as in double precision",
    quantity="L2 error over that in double precision",
    unit="1",
    kind=Kind.REGRESSION,
    formula=_FORMULA,
    source="the same computation with production's float64 passes, which the other rows judge",
    tolerance=1e-3,
    reason="forces are right to 1e-6 of their terms, the error is some hundredths of the displacement",
    over={"material": MATERIALS},
)
def single_precision(use: Use, *, material: str) -> Measurement:
    """Four cells."""
    single, double = (solve(use, material, 4, precision).l2 for precision in reversed(PRECISIONS))
    return compare(single / double, 1.0)


def _order(use: Use, norm: str, expected: float, material: str, finest: int) -> Measurement:
    cells = (finest // 4, finest // 2, finest)
    found = [solve(use, material, n) for n in cells]
    h = tuple(1.0 / n for n in cells)
    interpolant = Curve("interpolant", h, tuple(getattr(one, f"{norm}_interpolated") for one in found))
    return order(
        h,
        [getattr(one, norm) for one in found],
        expected,
        x="cell [m]",
        y=f"relative error, {norm.upper()}",
        title=f"Manufactured solution, {material} material",
        more=(interpolant,),
    )


@cache
def solve(use: Use, material: str, cells: int, precision: Precision = "float64") -> Errors:
    """Errors on a cube of n^3 cells."""
    disc, field = _body(material, cells), _field(material)
    X = disc.mesh.points
    exact = field.displacement(X.T).T
    elasticity = ProductionElasticity.of(use.backend(disc, precision))
    free = np.repeat(disc.free[:, None], 3, axis=1)
    tolerance = {"float64": 1e-10, "float32": 1e-6}[precision]
    result = equilibrium(elasticity, load(disc, material), free, X + exact, tolerance=tolerance, iterations=12)
    norms = error_norms(disc.mesh, np.zeros_like(X), field.displacement, field.gradient)
    found = error_norms(disc.mesh, result.x - X, field.displacement, field.gradient)
    interpolated = error_norms(disc.mesh, exact, field.displacement, field.gradient)
    return Errors(found[0] / norms[0], found[1] / norms[1], interpolated[0] / norms[0], interpolated[1] / norms[1])


def load(disc: Discretisation, material: str) -> Floats:
    """Manufactured load at the vertices [N], shape [n, 3]."""
    field, mu, lam = _field(material), disc.mu[:, None], disc.lam[:, None]
    total = body_load(disc.mesh, lambda X, elements: field.body_force(X, mu, lam))
    if material == "jump":
        sides = [(float(disc.mu[e]), float(disc.lam[e])) for e in (int(disc.mu.argmin()), int(disc.mu.argmax()))]
        total += surface_load(
            disc.mesh,
            lambda X: np.isclose(X[0], _INTERFACE),
            lambda X: field.interface_load(X, sides[0], sides[1]),
        )
    return total


def _field(material: str) -> ManufacturedField:
    return smooth_field() if material == "uniform" else kinked_field(_INTERFACE)


@cache
def _body(material: str, cells: int) -> Discretisation:
    """Unit cube, held all round; E = 0.1 MPa, or 1 MPa beyond the interface."""
    mesh = box(cells=(cells, cells, cells))
    beyond = mesh.points[mesh.cells].mean(axis=1)[:, 0] > _INTERFACE
    stiff = beyond & (material == "jump")
    surface = np.unique(boundary(mesh.cells))
    return discretise(mesh, np.where(stiff, 1e6, 1e5), np.where(stiff, 0.4, 0.3), 1000.0, surface)
