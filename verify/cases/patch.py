# SPDX-License-Identifier: BSD-3-Clause
"""The patch test: where the boundary follows an affine map, linear elements of one material must follow it inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.backend import Backend, Precision
from femgal.solvers.chebyshev import Chebyshev
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi
from femgal.solvers.solver import Budget, Outcome, Solver
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.surface import boundary
from verify.problems import bodies
from verify.problems.bodies import mean_edge, rng, uniform
from verify.problems.scales import at_vertices, terms
from verify.reference.statics import ProductionElasticity, equilibrium
from verify.suite.case import PRECISIONS, Kind, Measurement, Skip, case
from verify.suite.measure import compare, vanishes
from verify.suite.use import Use

Floats = NDArray[np.float64]

# Deformation gradients: 67 % stretch with shear, an inside-out body, and one rolled out to five times its length.
# det F is 1.32, -1.11 and 0.99.
MAPS: dict[str, Floats] = {
    "sheared": np.array([[1.6, 0.4, -0.2], [-0.3, 0.9, 0.3], [0.1, -0.2, 0.77]]),
    "inverted": np.array([[-1.2, 0.3, 0.1], [0.2, 0.9, -0.4], [0.1, 0.3, 0.83]]),
    "rolled": np.array([[5.0, 1.0, 0.0], [0.0, 0.6, 0.2], [0.3, 0.0, 0.31]]),
}

_PATCH = "x = F X on the boundary gives x = F X inside: Div P = 0 for a constant P"
_SOURCE = "Irons, in Bazeley et al. 1965; Strang and Fix 1973, section 4.2"


@case(
    "patch/interior-forces",
    title="No force is left at the inner vertices of an affinely deformed body, inside out or not",
    quantity="largest resultant over the sum of the terms at its vertex",
    unit="1",
    kind=Kind.IDENTITY,
    formula=_PATCH,
    source=_SOURCE,
    tolerance={"float64": 2e-16, "float32": 1e-7},
    reason="a unit in the last place of the terms of the elements at the vertex, which bound what rounding can do",
    over={"precision": PRECISIONS, "map": tuple(MAPS), "mesh": ("box", "rabbit", "slivers")},
    own_mesh=True,
)
def interior_forces(use: Use, *, precision: Precision, map: str, mesh: str) -> Measurement:
    """Gradient pass of a body of one material on the mesh."""
    disc = patch(mesh)
    x = affine(disc, map)
    resultant = use.backend(disc, precision).gradient(x)
    scale = at_vertices(disc, terms(disc, x, precision).force)
    return vanishes((resultant / scale)[disc.free], 1.0)


@case(
    "patch/solved",
    title="Production solvers bring displaced inner vertices back to the affine map",
    quantity="largest error of a position over the mean edge",
    unit="1",
    kind=Kind.IDENTITY,
    formula=_PATCH + "; the only minimum, as mu I + lam (C n)(C n)^T is definite for all n",
    source=_SOURCE,
    tolerance=1e-10,
    reason="the solver stops at 1e-13 m, and inertia keeps the error below that times sqrt(N), the edge is 0.1 m",
    over={"solver": ("fas", "chebyshev"), "map": ("sheared", "inverted"), "mesh": ("box",)},
)
def solved(use: Use, *, solver: str, map: str, mesh: str) -> Measurement:
    """A long step of backward Euler from displaced positions, with the affine state as its only minimum."""
    return _solved(use, solver, map, mesh, "float64", 1e-13)


@case(
    "patch/solved-single",
    title="So they do in single precision",
    quantity="largest error of a position over the mean edge",
    unit="1",
    kind=Kind.IDENTITY,
    formula=_PATCH,
    source=_SOURCE,
    tolerance=1e-3,
    reason="the solver stops at 5e-6 m, and inertia keeps the error below that times sqrt(N), the edge is 0.1 m",
    over={"solver": ("fas",), "map": ("sheared", "inverted"), "mesh": ("box",)},
)
def solved_single(use: Use, *, solver: str, map: str, mesh: str) -> Measurement:
    """As `solved` with float32 passes."""
    return _solved(use, solver, map, mesh, "float32", 5e-6)


@case(
    "patch/newton",
    title="Newton's method on production's forces brings displaced inner vertices back to the affine map",
    quantity="largest error of a position over the mean edge",
    unit="1",
    kind=Kind.IDENTITY,
    formula=_PATCH,
    source=_SOURCE,
    tolerance=1e-10,
    reason="forces are rounded, and the softest mode of the direct solve multiplies that",
    over={"map": tuple(MAPS), "mesh": ("box", "rabbit")},
    quick={"mesh": ("box",)},
)
def newton(use: Use, *, map: str, mesh: str) -> Measurement:
    """Static equilibrium without load."""
    disc = patch(mesh)
    free = np.repeat(disc.free[:, None], 3, axis=1)
    elasticity = ProductionElasticity.of(use.backend(disc))
    result = equilibrium(elasticity, np.zeros((disc.n_vertices, 3)), free, displaced(disc, map, 0.05))
    return compare(result.x, affine(disc, map), mean_edge(disc.mesh), f"{len(result.steps)} steps")


def patch(mesh: str) -> Discretisation:
    """A body of one material with its surface held.

    Raises
    ------
    Skip
        All vertices are on the surface.
    """
    one = bodies.mesh(mesh)
    surface = np.unique(boundary(one.cells))
    if len(surface) == len(one.points):
        raise Skip("all vertices of the mesh are on its surface")
    return uniform(one, surface)


def affine(disc: Discretisation, map: str) -> Floats:
    """F X [m], shape [n, 3], about the middle of the body."""
    X = disc.mesh.points
    return X.mean(axis=0) + (X - X.mean(axis=0)) @ MAPS[map].T


def displaced(disc: Discretisation, map: str, share: float) -> Floats:
    """The affine state with inner vertices moved at random by a share of the mean edge [m], shape [n, 3]."""
    noise = share * mean_edge(disc.mesh) * rng(431).standard_normal((disc.n_vertices, 3))
    return affine(disc, map) + noise * disc.free[:, None]


def _solved(use: Use, name: str, map: str, mesh: str, precision: Precision, stop: float) -> Measurement:
    disc = patch(mesh)
    backend = use.backend(disc, precision)
    # Ten cells of travel of a wave: inertia is next to nothing against stiffness.
    h = 10.0 * mean_edge(disc.mesh) / float(np.sqrt((disc.lam[0] + disc.mu[0]) / 1000.0))
    target = affine(disc, map)
    potential = IncrementalPotential(backend, target, h)
    solver = _solver(name, backend, Budget(4000, stop))
    state = solver.init(potential, solver.prepare(MotionState(0.0, target, np.zeros_like(target)), potential).memory)
    state.x[:] = displaced(disc, map, 0.2)
    while (outcome := solver.finished(potential, state)) is None:
        state = solver.step(potential, state)
    note = f"{state.iteration} iterations" + ("" if outcome is Outcome.CONVERGED else f": {outcome.value}")
    return compare(state.x, target, mean_edge(disc.mesh), note)


def _solver(name: str, backend: Backend, budget: Budget) -> Solver:
    if name == "fas":
        return FAS(backend, build_constant_hierarchy(backend.disc, 8).layers, "exact", budget)
    return Chebyshev(Jacobi(backend, (backend.vertices,), "exact", budget))
