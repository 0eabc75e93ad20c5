# SPDX-License-Identifier: BSD-3-Clause
"""Solvers and multigrid cycles against Newton's minimiser, dense matrices and dense eigenvalues.

Hierarchies: "clusters" of 3, 9 and 27 vertices, a "pair" of grids with clusters of 8, "eights" (clusters of 8, 64, ...)
and "lattice". The body is held at one end and thrown, bent enough to need Newton's method; quadratic statements are
made of small displacements around rest, or close to the minimiser.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend, Precision
from femgal.solvers.chebyshev import Chebyshev
from femgal.solvers.cycle import Cycle
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi, ScalarJacobi
from femgal.solvers.smoother import LU2025_STEPS, Relaxation, StepRule
from femgal.solvers.solver import Solver, SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.generators import box
from meshes.ordering import reorder
from verify.problems.bodies import body, left_end, mean_edge, rng, uniform
from verify.reference.corrections import SEQUENCES, Corrections, corrections_at
from verify.reference.elasticity import lumped_mass
from verify.reference.galerkin import layers
from verify.reference.newton import StepMinimiser
from verify.suite.case import PRECISIONS, Curve, Kind, Measurement, case
from verify.suite.measure import compare, order, vanishes, worst
from verify.suite.use import Use

Floats = NDArray[np.float64]

H = 1.0 / 60.0
# Of `verify.problems.bodies.uniform` [kg/m^3].
_DENSITY = 1000.0
SINGLE = {"jacobi": Jacobi, "scalar-jacobi": ScalarJacobi}
CYCLES = {"fas": Cycle(), "v": Cycle("V", 1, 1), "f": Cycle("F", 1, 1), "w": Cycle("W", 1, 1)}
HIERARCHIES = {"clusters": "clusters-3", "pair": "clusters-8", "eights": "clusters-8", "lattice": "lattice"}
# On three layers, as of the lattices here, F and W are the same.
MULTIGRID = (*(f"{cycle}-clusters" for cycle in CYCLES), "fas-lattice", "v-lattice", "w-lattice")
_RULES: tuple[StepRule, ...] = ("spectral", "exact", "backtracking", LU2025_STEPS)
_RHO = 0.9
_ITERATIONS = 400

# A step so long that elasticity outweighs inertia by far, and cells along the edge of a cube. Sweeps on the finest one
# would need a thousand passes to tell their factor from one.
_LONG = 1.0 / 15.0
_CELLS = {"jacobi": (4, 8, 16), "fas-eights": (4, 8, 16, 24), "fas-lattice": (4, 8, 16, 24)}


@case(
    "cycles/fixed-point",
    title="The exact solution of a step is a fixed point of every solver, cycle and kind of step length",
    quantity="largest move of a vertex in two iterations over the mean edge",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="grad phi(x) = 0, so every correction -w H^-1 P^T grad phi is zero",
    source="minimiser by Newton's method, scikit-fem's Hessian and masses, a direct solver; mu and lam are shared",
    tolerance={"float64": 1e-13, "float32": 1e-7},
    reason="rounding of forces that cancel: 1e-15 or 1e-6 of the largest of a vertex, at strains of some hundredths",
    over={"solver": (*SINGLE, *MULTIGRID, "chebyshev"), "precision": PRECISIONS},
    requires="scikit-fem",
)
def fixed_point(use: Use, *, solver: str, precision: Precision) -> Measurement:
    """Two iterations from the minimiser, so that Chebyshev extrapolates once."""
    disc = body("beam", "uniform")
    x, backend, found = minimiser(disc), use.backend(disc, precision), {}
    for rule in _RULES:
        phi = IncrementalPotential(backend, thrown(disc), H)
        one = make(backend, solver, rule)
        state = started(one, phi, x)
        for _ in range(2):
            state = one.step(phi, state)
        found[f"steps {rule}"] = vanishes(state.x - x, mean_edge(disc.mesh))
    return worst(found)


@case(
    "cycles/product-of-corrections",
    title="On a quadratic potential an iteration is the product of its layers' dense corrections",
    quantity="largest difference over the largest displacement that the iteration makes",
    unit="1",
    kind=Kind.IDENTITY,
    formula="u -= w P D^-1 P^T (A u - b) for each layer of the sequence; w of the solver, or r . d / d . A d",
    source="Lu et al. 2025, Algorithm 4; textbook V, F and W cycles; A by scikit-fem, dense",
    tolerance=1e-8,
    reason="odd part of what displacements of +-1e-5 edges become: third order in a strain of 3e-5, and its rounding",
    over={"solver": (*SINGLE, *MULTIGRID)},
    requires="scikit-fem",
)
def product_of_corrections(use: Use, *, solver: str) -> Measurement:
    """With spectral steps and with exact ones."""
    disc = body("beam", "uniform")
    X, free, found = disc.mesh.points, disc.free, {}
    d = 1e-5 * mean_edge(disc.mesh) * rng(30).standard_normal(X.shape) * free[:, None]
    backend = use.backend(disc)
    for rule in ("spectral", "exact"):
        one = make(backend, solver, rule)
        after = []
        for sign in (1.0, -1.0):
            phi = IncrementalPotential(backend, X + sign * d, H)
            after.append(one.step(phi, started(one, phi, phi.xhat)).x)
        odd = 0.5 * (after[0] - after[1])[free].ravel()
        b = (disc.mass[:, None] * d / H**2)[free].ravel()
        exact, u = _corrections(disc, solver, "rest"), d[free].ravel()
        expected = exact.run(sequence(disc, solver), step_lengths(one, phi) if rule == "spectral" else None, b, u)
        found[f"{rule} steps"] = compare(odd, expected, float(np.abs(expected - u).max()))
    return worst(found)


@case(
    "cycles/chebyshev-polynomial",
    title="On a quadratic potential k extrapolated iterations leave T_k(E / rho) / T_k(1 / rho) of the error",
    quantity="largest difference over the largest displacement from the prediction",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="e_k = T_k(E / rho) / T_k(1 / rho) e_0, T_k the Chebyshev polynomial, E the dense error propagation",
    source="Golub and Varga 1961; Wang 2015",
    tolerance=1e-8,
    reason="odd part of what displacements of +-1e-5 edges become: third order in a strain of 3e-5, and its rounding",
    over={"iterations": (2, 3, 6)},
    quick={"iterations": (3,)},
    requires="scikit-fem",
)
def chebyshev_polynomial(use: Use, *, iterations: int) -> Measurement:
    """Symmetric V-cycles on lattices, rho = 0.9."""
    disc = body("beam", "uniform")
    X, free, after = disc.mesh.points, disc.free, []
    d = 1e-5 * mean_edge(disc.mesh) * rng(31).standard_normal(X.shape) * free[:, None]
    backend = use.backend(disc)
    one = make(backend, "chebyshev", "spectral")
    for sign in (1.0, -1.0):
        phi = IncrementalPotential(backend, X + sign * d, H)
        state = started(one, phi, phi.xhat)
        for _ in range(iterations):
            state = one.step(phi, state)
        after.append(state.x)
    odd = 0.5 * (after[0] - after[1])[free].ravel()
    exact = _corrections(disc, "v-lattice", "rest")
    E = exact.propagation(sequence(disc, "v-lattice"), step_lengths(one, phi))
    solution = exact.solution((disc.mass[:, None] * d / H**2)[free].ravel())
    T = np.polynomial.chebyshev.Chebyshev.basis(iterations)
    error = np.zeros_like(solution)
    for c in np.polynomial.chebyshev.cheb2poly(T.coef)[::-1]:
        error = E @ error / _RHO + c * (d[free].ravel() - solution)
    expected = solution + error / T(1.0 / _RHO)
    return compare(odd, expected, float(np.abs(expected - d[free].ravel()).max()))


@case(
    "cycles/observed-factor",
    title="Close to the solution every iteration shrinks the error by the spectral radius of its dense propagation",
    quantity="logarithm of the mean factor of the last ten iterations over that of the spectral radius, less 1",
    unit="1",
    kind=Kind.IDENTITY,
    formula="rho(prod_l (I - w_l P D^-1 P^T A)), A and D at the minimiser, eigenvalues by LAPACK",
    source="textbook analysis of multigrid; minimiser by Newton's method",
    tolerance=0.02,
    reason="what is left of other eigenvectors after so many iterations",
    over={"solver": (*SINGLE, "v-pair", *MULTIGRID[:-1])},
    quick={"solver": ("v-pair",)},
    requires="scikit-fem",
)
def observed_factor(use: Use, *, solver: str) -> Measurement:
    """From the prediction to 1e-8 of its distance from the minimiser, then again and again from 1e-4 of it."""
    disc = body("box", "uniform")
    x, backend = minimiser(disc), use.backend(disc)
    phi = IncrementalPotential(backend, thrown(disc), H)
    one = make(backend, solver, "spectral")
    exact = _corrections(disc, solver, "minimiser")
    radius = float(np.abs(np.linalg.eigvals(exact.propagation(sequence(disc, solver), step_lengths(one, phi)))).max())
    state = started(one, phi, phi.xhat)
    factors: list[float] = []
    first = before = exact.norm((state.x - x)[disc.free])
    while len(factors) < _ITERATIONS:
        if before < 1e-8 * first:
            state.x = x + 1e4 * (state.x - x)
            before *= 1e4
        state = one.step(phi, state)
        after = exact.norm((state.x - x)[disc.free])
        factors.append(after / before)
        before = after
    factor = float(np.exp(np.log(factors[-10:]).mean()))
    note = (
        f"{len(exact.C)} layers, {_ITERATIONS} iterations; the first ten left {np.prod(factors[:10]):.2g} of the error"
    )
    return Measurement(factor, radius, abs(np.log(factor) / np.log(radius) - 1.0), note)


@case(
    "cycles/factor-of-jacobi",
    title="What one Jacobi sweep leaves of the slowest error comes closer to one with the square of the edge",
    quantity="order of 1 - factor in the edge, less 2",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="1 - rho = w lambda_min(D^-1 A) ~ (edge / size)^2",
    source="textbook: the smoothest mode of an elliptic problem of second order",
    tolerance=0.1,
    reason="inertia, and the surface of coarse meshes",
    quick=False,
)
def factor_of_jacobi(use: Use) -> Measurement:
    """Cubes with 4, 8 and 16 cells along an edge."""
    return _order_of_gain(use, "jacobi", 2.0)


@case(
    "cycles/factor-of-clusters",
    title="One cycle over clusters gains less the finer the mesh: the factor is not bounded away from one",
    quantity="order of 1 - factor in the edge, less 1",
    unit="1",
    kind=Kind.REGRESSION,
    formula="between 0 (independent of the mesh) and 2 (as one sweep); 1 is what was measured, no published number",
    source="earlier runs; Lu et al. 2025, section 5.1, says of constant and linear transfer which converges faster",
    tolerance=None,
    reason="reported as what it is",
    quick=False,
)
def factor_of_clusters(use: Use) -> Measurement:
    """Clusters of 8, 64, ... vertices, coarse to fine."""
    return _order_of_gain(use, "fas-eights", 1.0)


@case(
    "cycles/factor-of-lattices",
    title="One cycle over lattices gains nearly the same on every mesh",
    quantity="order of 1 - factor in the edge, less 0",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="1 - rho does not depend on the edge",
    source="textbook: multigrid with linear interpolation",
    tolerance=0.25,
    reason="lattices do not end at the surface of the body; far below the orders 1 of clusters and 2 of a sweep",
    quick=False,
)
def factor_of_lattices(use: Use) -> Measurement:
    """Lattices each twice as wide, coarse to fine."""
    return _order_of_gain(use, "fas-lattice", 0.0)


def make(backend: Backend, name: str, rule: StepRule) -> Solver:
    """A solver by the name of a row."""
    if name == "chebyshev":
        inner = make(backend, "v-lattice", rule)
        assert isinstance(inner, Relaxation)
        return Chebyshev(inner, _RHO)
    if name in SINGLE:
        return SINGLE[name](backend, (backend.vertices,), rule)
    return FAS(backend, stack(backend.disc, name), rule, cycle=CYCLES[name.split("-")[0]])


def stack(disc: Discretisation, name: str) -> tuple[Layer, ...]:
    """Layers of a solver, finest first."""
    return layers(disc, HIERARCHIES["clusters" if name in SINGLE else name.split("-")[1]])


def sequence(disc: Discretisation, name: str) -> tuple[int, ...]:
    """Layers that one iteration smooths."""
    return (0,) if name in SINGLE else SEQUENCES[name.split("-")[0], len(stack(disc, name))]


def step_lengths(solver: Solver, phi: IncrementalPotential) -> Floats:
    """Step lengths that a solver has estimated for a potential, finest layer first."""
    X = phi.backend.disc.mesh.points
    return solver.prepare(MotionState(0.0, X, np.zeros_like(X)), phi).memory["step_lengths"]


def started(solver: Solver, phi: IncrementalPotential, x: Floats) -> SolverState:
    """A solver's state at x, its step lengths estimated."""
    X = phi.backend.disc.mesh.points
    state = solver.init(phi, solver.prepare(MotionState(0.0, X, np.zeros_like(X)), phi).memory)
    state.x = x.copy()
    return state


@cache
def thrown(disc: Discretisation) -> Floats:
    """Prediction of a body that is held at its low end of x and thrown down, bent enough to need Newton's method."""
    X = disc.mesh.points
    velocity = np.zeros_like(X)
    velocity[:, 2] = -12.0 * (X[:, 0] - X[:, 0].min())
    noise = 0.1 * mean_edge(disc.mesh) * rng(32).standard_normal(X.shape)
    return np.where(disc.free[:, None], X + H * velocity + noise, X)


@cache
def minimiser(disc: Discretisation) -> Floats:
    """Exact solution of the step of a body of `uniform` material, whose mu and lam it takes from the disc."""
    newton = StepMinimiser(disc.mesh, disc.mu, disc.lam, lumped_mass(disc.mesh, _DENSITY), disc.free)
    return newton(thrown(disc), H)


@cache
def _corrections(disc: Discretisation, solver: str, state: str) -> Corrections:
    x = disc.mesh.points if state == "rest" else minimiser(disc)
    chosen = stack(disc, solver)[: 1 if solver in SINGLE else None]
    return corrections_at(disc, chosen, x, H**-2, scalar=solver == "scalar-jacobi")


@cache
def _gains(use: Use, solver: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Edges [m] of cubes of 1 m, and 1 - factor of an iteration there: Arnoldi's method on the production cycle."""
    gains = []
    for cells in _CELLS[solver]:
        disc = uniform(whole := reorder(box((1.0, 1.0, 1.0), (cells, cells, cells)))[0], left_end(whole))
        gains.append(1.0 - asymptotic_factor(use.backend(disc), solver))
    return tuple(1.0 / cells for cells in _CELLS[solver]), tuple(gains)


def _order_of_gain(use: Use, solver: str, expected: float) -> Measurement:
    edges, gains = _gains(use, solver)
    more = [Curve(other, *_gains(use, other)) for other in _CELLS if other != solver]
    x, y, title = "edge [m]", "1 - factor of the error in one iteration", f"Gain of an iteration: {solver}"
    return order(edges, gains, expected, x=x, y=y, title=title, more=more)


def asymptotic_factor(backend: Backend, solver: str) -> float:
    """Largest |eigenvalue| of what an iteration makes of a small error around rest."""
    disc = backend.disc
    X, free = disc.mesh.points, np.repeat(disc.free, 3)
    phi = IncrementalPotential(backend, X.copy(), _LONG)
    one = make(backend, solver, "spectral")
    started(one, phi, X)

    def iterate(y: Floats) -> Floats:
        d = np.zeros(X.size)
        d[free] = y
        t = 1e-6 * mean_edge(disc.mesh) / np.abs(d).max()
        return ((one.step(phi, SolverState(X + t * d.reshape(-1, 3))).x - X) / t).ravel()[free]

    n = int(free.sum())
    smooth = np.sin(X.sum(axis=1, keepdims=True) * np.ones((1, 3))).ravel()[free]
    operator = spla.LinearOperator((n, n), iterate, dtype=np.float64)
    found = spla.eigs(operator, 1, ncv=20, v0=smooth, tol=1e-5, maxiter=100, return_eigenvectors=False)
    return float(abs(found[0]))
