# SPDX-License-Identifier: BSD-3-Clause
"""Bending: Cook's membrane and a cantilever against quadratic elements, and what linear tetrahedra lose by locking.

Production's forces, Newton's method to find their zero; the problems and the committed answers of quadratic elements
are `verify.reference.bending`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.backend import Precision
from femgal.timestep.backward_euler import BackwardEuler
from verify.problems.bodies import Moving
from verify.problems.waves import SOLVERS, build_solver, motion
from verify.reference.bending import PROBLEMS, Bending, answers, bend, quadratic, refined
from verify.reference.elasticity import AssembledElasticity, material_parameters
from verify.reference.richardson import Extrapolation, extrapolate
from verify.reference.statics import Elasticity, ProductionElasticity, rigid_body_modes, solve_by_multigrid
from verify.suite.case import PRECISIONS, Curve, Kind, Measurement, Plot, case
from verify.suite.measure import at_most, compare
from verify.suite.use import Use

Floats = NDArray[np.float64]

BODIES = ("cook", "cantilever")

# Cells along the body.
_SEQUENCES = {"cook": (12, 24, 48), "cantilever": (8, 16, 32)}
_PLANE_STRESS = (16, 32, 64)

_COOK = "48/44/16 m, 12 m thick, both faces free, nu = 0.3, shear load 0.0375 E, deflection 11 m"
_CANTILEVER = "1 x 1/2 x 1/2 m, nu = 0.3, own weight rho g = 0.05 E / m, deflection 0.35 m"
_ANSWER = "quadratic tetrahedra, scikit-fem; Cook: " + _COOK + "; cantilever: " + _CANTILEVER
_COMMITTED = "verify/reference/data/bending.json, made by python -m verify.reference.bending"


@case(
    "bending/same-elements",
    title="On the same linear elements production's forces balance where scikit-fem's do",
    quantity="largest difference of a position over the deflection",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="grad E(x) = f; " + _ANSWER.replace("quadratic", "linear"),
    source="scikit-fem, assembled at the same mesh",
    tolerance={"float64": 1e-11, "float32": 1e-5},
    reason="rounding of the forces, which bending multiplies by (length / cell)^2 and more",
    over={"body": BODIES, "precision": PRECISIONS},
)
def same_elements(use: Use, *, body: str, precision: Precision) -> Measurement:
    """Eight cells along the body."""
    problem = _problem(body)
    disc = _disc(problem, 8)
    expected = _reference(problem, 8)
    forces = ProductionElasticity.of(use.backend(disc, precision))
    u = bend(problem, forces, disc.mesh.points, 1, disc.mesh, expected, _STOP[precision])
    return compare(u, expected, abs(problem.deflection(disc.mesh.points, expected)))


@case(
    "bending/linear-solvers",
    title="Algebraic multigrid solves a Newton step of the reference as a direct solver does, bent or at rest",
    quantity="largest difference of a displacement over the largest displacement of the step",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="H(x) d = f - grad E(x), conjugate gradients with smoothed aggregation against a sparse factorisation",
    source="pyamg 5 (Vanek, Mandel and Brezina 1996) and SuperLU, through SciPy; H by scikit-fem",
    tolerance=1e-9,
    reason="residuals fall by 1e-10, and what is left of them moves a body like its load, along the softest modes",
    over={"body": BODIES, "state": ("rest", "bent")},
    requires="scikit-fem and pyamg",
)
def linear_solvers(use: Use, *, body: str, state: str) -> Measurement:
    """Eight cells along the body; the reference of the finest meshes, and its answers, are solved by multigrid."""
    problem = _problem(body)
    mesh = _disc(problem, 8).mesh
    x = mesh.points + (0.7 * _reference(problem, 8) if state == "bent" else 0.0)
    elasticity = AssembledElasticity(mesh, *material_parameters(problem.young, problem.nu))
    at = np.flatnonzero(problem.free(mesh.points).ravel())
    A = elasticity.hessian(x)[at][:, at].tocsr()
    b = (problem.forces(mesh, 1) - elasticity.gradient(x)).ravel()[at]
    return compare(solve_by_multigrid(A, b, rigid_body_modes(x)[at]), spla.spsolve(A.tocsc(), b))


@case(
    "bending/comes-to-rest",
    title="A cantilever that production's time stepping lets down comes to rest where scikit-fem's forces balance",
    quantity="largest difference of a position over the deflection",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="grad E(x) = M g; " + _CANTILEVER,
    source="scikit-fem, assembled at the same mesh",
    tolerance=1e-6,
    reason="each long step leaves a fifth of the motion or less, and nine are made",
    over={"solver": SOLVERS},
    quick=False,
)
def comes_to_rest(use: Use, *, solver: str) -> Measurement:
    """Backward Euler with steps of a second, most of a period long, on four cells along the body."""
    problem = _problem("cantilever")
    disc = _disc(problem, 4)
    backend, X = use.backend(disc), disc.mesh.points
    held = np.flatnonzero(~disc.free)
    gravity = np.array([0.0, 0.0, -10.0])
    stepper = BackwardEuler(backend, build_solver(solver, backend, 1e-9), 1, gravity, 0.0, (Moving(held, X[held]),))
    end, expected = motion(stepper, X, 1.0, 9)[-1], _reference(problem, 4)
    return compare(end.x - X, expected, abs(problem.deflection(X, expected)))


@case(
    "bending/extrapolated",
    title="Linear elements, extrapolated, bend as far as quadratic ones",
    quantity="deflection in the limit; its relative error",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula=_ANSWER,
    source=_COMMITTED,
    tolerance=0.01,
    reason="of Richardson's extrapolation where the order, disturbed by the clamped edges, is not yet constant",
    over={"body": BODIES},
    quick=False,
)
def extrapolated(use: Use, *, body: str) -> Measurement:
    """Three meshes."""
    values, limit = _sequence(use, body)
    reference = answers()[_problem(body).key]
    h = tuple(1.0 / n for n in _SEQUENCES[body])
    errors = tuple(abs(value / reference["value"] - 1.0) for value in values)
    plot = Plot(f"Deflection: {body}", "cell over length", "relative error", (Curve("linear", h, errors),), (2.0,))
    note = f"order {limit.order:.2f}, GCI {100 * limit.gci:.2g} %, deflections " + ", ".join(f"{v:.5g}" for v in values)
    return compare(limit.value, reference["value"], note=note, plots=(plot,))


@case(
    "bending/convergence-index",
    title="The grid convergence index of linear elements covers their error",
    quantity="relative error of the finest mesh",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="GCI = 1.25 |f - f3| / |f3|; " + _ANSWER,
    source="Roache 1994; " + _COMMITTED,
    tolerance=0.0,
    reason="the index is an upper bound; its factor of 1.25 is the margin",
    over={"body": BODIES},
    quick=False,
)
def convergence_index(use: Use, *, body: str) -> Measurement:
    """The same three meshes."""
    values, limit = _sequence(use, body)
    reference = answers()[_problem(body).key]["value"]
    return at_most(abs(values[-1] - reference) / abs(values[-1]), limit.gci)


@case(
    "bending/cook-literature",
    title="Cook's membrane in plane stress, quadratic reference elements: the deflection of the literature",
    quantity="vertical displacement of the middle of the loaded end for E = 1, F = 1, thickness 1",
    unit="1",
    kind=Kind.LITERATURE,
    formula="23.96 at nu = 1/3; small strain, lam = lam_Lame + mu_Lame",
    source="Cook 1974; Cook, Malkus and Plesha 1989: 23.9 to 23.96 on the finest meshes",
    tolerance=0.005,
    reason="the published value is good to a few tenths of a per cent",
)
def cook_literature(use: Use) -> Measurement:
    """The committed limit; `bending/committed` shows that the code still gives it."""
    problem = _plane_stress()
    return compare(answers()[problem.key]["value"] / _UNITS, 23.96, note="load 1e-6 of that of the large deflection")


@case(
    "bending/cook-literature-linear",
    title="Cook's membrane in plane stress, production's forces, extrapolated: the deflection of the literature",
    quantity="vertical displacement of the middle of the loaded end for E = 1, F = 1, thickness 1",
    unit="1",
    kind=Kind.LITERATURE,
    formula="23.96 at nu = 1/3; small strain, lam = lam_Lame + mu_Lame",
    source="Cook 1974; Cook, Malkus and Plesha 1989: 23.9 to 23.96 on the finest meshes",
    tolerance=0.01,
    reason="of Richardson's extrapolation, and of the published value",
    quick=False,
)
def cook_literature_linear(use: Use) -> Measurement:
    """Linear elements, 16, 32 and 64 cells along and across."""
    values = _deflections(use, _plane_stress(), _PLANE_STRESS)
    limit = extrapolate(values)
    shown = ", ".join(f"{value / _UNITS:.4g}" for value in values)
    return compare(limit.value / _UNITS, 23.96, note=f"order {limit.order:.2f}, deflections {shown}")


@case(
    "bending/committed",
    title="The reference code still gives the committed answers",
    quantity="deflection of the coarsest mesh of quadratic elements; its relative error",
    unit="m",
    kind=Kind.REGRESSION,
    formula="grad E(x) = f on 4 cells along the body",
    source=_COMMITTED,
    tolerance=1e-7,
    reason="Newton's method stops at steps of 1e-9 of the size",
    over={"problem": tuple(range(len(PROBLEMS)))},
    quick={"problem": (1,)},
)
def committed(use: Use, *, problem: int) -> Measurement:
    """The first mesh of each sequence."""
    one = PROBLEMS[problem]
    first = answers()[one.key]["sequence"][0]
    return compare(quadratic(one, first["cells"][0]), first["deflection_m"], note=one.key)


@case(
    "bending/locking",
    title="Share of the deflection that linear elements reach, by Poisson's ratio and mesh",
    quantity="deflection; relative error",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula=_ANSWER + ", here with nu as in the row",
    source=_COMMITTED,
    tolerance=None,
    reason="linear tetrahedra lock where bending or the volume asks for more than constant strain: no verdict",
    over={"nu": (0.3, 0.49, 0.499), "cells": (8, 16)},
    quick={"cells": (8,)},
)
def locking(use: Use, *, nu: float, cells: int) -> Measurement:
    """Cantilever."""
    problem = next(one for one in PROBLEMS if one.name == "cantilever" and one.nu == nu)
    reference = answers()[problem.key]
    value = _deflections(use, problem, (cells,))[0]
    share = 100.0 * (value / reference["value"] - 1.0)
    note = f"{share:+.1f} % of the deflection of quadratic elements, which is good to {100 * reference['gci']:.2g} %"
    return compare(value, reference["value"], note=note)


# Newton steps [share of the size] below which nothing is left to gain.
_STOP: dict[str, float] = {"float64": 1e-11, "float32": 1e-6}

# Deflection [m] of the membrane for F / (E thickness) = 0.0375 * 16, in the units of the literature.
_UNITS = 0.0375 * 16.0


def _problem(body: str) -> Bending:
    return next(one for one in PROBLEMS if one.name == body)


def _plane_stress() -> Bending:
    return next(one for one in PROBLEMS if one.slides)


@cache
def _disc(problem: Bending, n: int) -> Discretisation:
    mesh = problem.mesh(n)
    held = () if problem.slides else np.flatnonzero(mesh.points[:, 0] < 1e-9)
    return discretise(mesh, problem.young, problem.nu, 1000.0, held)


@cache
def _reference(problem: Bending, n: int) -> Floats:
    """Displacements by scikit-fem on linear elements [m], shape [n, 3]."""
    disc = _disc(problem, n)
    elasticity: Elasticity = AssembledElasticity(disc.mesh, disc.mu, disc.lam)
    return bend(problem, elasticity, disc.mesh.points, 1, disc.mesh, np.zeros((disc.n_vertices, 3)), 1e-12)


@cache
def _sequence(use: Use, body: str) -> tuple[tuple[float, ...], Extrapolation]:
    values = _deflections(use, _problem(body), _SEQUENCES[body])
    return values, extrapolate(values)


@cache
def _deflections(use: Use, problem: Bending, cells: tuple[int, ...]) -> tuple[float, ...]:
    """Deflections [m] by production's forces, each mesh started from the one before."""
    values: list[float] = []
    u = X = np.zeros((0, 3))
    for number, n in enumerate(cells):
        disc = _disc(problem, n)
        nodes = disc.mesh.points
        start = refined(problem, u, X, nodes, cells[number - 1]) if number else np.zeros_like(nodes)
        u, X = bend(problem, ProductionElasticity.of(use.backend(disc)), nodes, 1, disc.mesh, start), nodes
        values.append(problem.deflection(X, u))
    return tuple(values)
