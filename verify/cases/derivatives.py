# SPDX-License-Identifier: BSD-3-Clause
"""Gradient and Hessian as derivatives of the energy, and the Hessian's symmetry, null space and eigenvalues."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend, Precision
from meshes.generators import box
from verify.problems.bodies import OWN, body, mean_edge, positions, released, uniform
from verify.problems.scales import EPSILON, at_vertices, product_terms, terms
from verify.reference.elasticity import AssembledElasticity
from verify.suite.case import PRECISIONS, Kind, Measurement, Skip, case
from verify.suite.measure import compare, order, vanishes
from verify.suite.use import SEED, Use

Floats = NDArray[np.float64]

_MESHES = ("rabbit", "slivers")
_QUICK = {"mesh": ("rabbit", OWN)}
_STEPS = [2.0**-k for k in range(1, 11)]
_TAYLOR = {
    "unit": "1",
    "kind": Kind.IDENTITY,
    "source": "Taylor's theorem",
    "tolerance": 0.02,
    "reason": "what the next term of the series and rounding leave at the two smallest steps",
    "over": {"mesh": _MESHES, "state": ("random", "inverted")},
    "quick": _QUICK,
    "own_mesh": True,
}


def wave(use: Use, X: Floats) -> Floats:
    """A smooth direction [m]: strains of a few tenths in every element, slivers included; shape of X."""
    random, size = use.rng(621), float(np.ptp(X, axis=0).max())
    return 0.05 * size * np.sin(2.0 * np.pi * X @ random.uniform(-1.0, 1.0, (3, 3)) / size + random.random(3))


def energy_change(backend: Backend, x: Floats, d: Floats) -> float:
    """E(x + d) - E(x) [J], element by element, so that large energies do not cancel."""
    return math.fsum(backend.energies(x + d)[0] - backend.energies(x)[0])


@case(
    "derivatives/taylor-energy",
    title="The energy minus its linear part falls with the second power of the step",
    quantity="order of |E(x + h d) - E(x) - h f . d|",
    formula="2",
    **_TAYLOR,
)
def taylor_energy(use: Use, *, mesh: str, state: str) -> Measurement:
    """Energy against gradient."""
    disc = released(body(mesh))
    x, d, backend = positions(disc.mesh, state), wave(use, disc.mesh.points), use.backend(disc)
    slope = math.fsum((backend.gradient(x) * d).ravel())
    errors = [abs(energy_change(backend, x, h * d) - h * slope) for h in _STEPS]
    return _order(mesh, errors, _energy_noise(disc, x), 2.0, "remainder [J]", "Energy minus its linear part")


@case(
    "derivatives/taylor-energy-hessian",
    title="The energy minus its linear and quadratic parts falls with the third power of the step",
    quantity="order of |E(x + h d) - E(x) - h f . d - h^2 d . H d / 2|",
    formula="3",
    **_TAYLOR,
)
def taylor_energy_hessian(use: Use, *, mesh: str, state: str) -> Measurement:
    """Energy against gradient and Hessian product."""
    disc = released(body(mesh))
    x, d, backend = positions(disc.mesh, state), wave(use, disc.mesh.points), use.backend(disc)
    slope = math.fsum((backend.gradient(x) * d).ravel())
    curvature = math.fsum((backend.hessian_product(x, d) * d).ravel())
    errors = [abs(energy_change(backend, x, h * d) - h * slope - 0.5 * h * h * curvature) for h in _STEPS]
    title = "Energy minus its linear and quadratic parts"
    return _order(mesh, errors, _energy_noise(disc, x), 3.0, "remainder [J]", title)


@case(
    "derivatives/taylor-forces",
    title="Forces minus their linear part fall with the second power of the step",
    quantity="order of |f(x + h d) - f(x) - h H d|",
    formula="2",
    **_TAYLOR,
)
def taylor_forces(use: Use, *, mesh: str, state: str) -> Measurement:
    """Gradient against Hessian product."""
    disc = released(body(mesh))
    x, d, backend = positions(disc.mesh, state), wave(use, disc.mesh.points), use.backend(disc)
    f, product = backend.gradient(x), backend.hessian_product(x, d)
    errors = [float(np.linalg.norm(backend.gradient(x + h * d) - f - h * product)) for h in _STEPS]
    noise = EPSILON["float64"] * float(np.linalg.norm(at_vertices(disc, terms(disc, x).force)))
    return _order(mesh, errors, noise, 2.0, "remainder [N]", "Forces minus their linear part")


def _energy_noise(disc: Discretisation, x: Floats) -> float:
    return EPSILON["float64"] * float(np.linalg.norm(terms(disc, x).energy))


def _order(mesh: str, errors: list[float], noise: float, expected: float, y: str, title: str) -> Measurement:
    """Order at the two smallest steps before a remainder falls below ten times what rounding may do.

    Raises
    ------
    Skip
        No three remainders stand out on a mesh of the user's own, which may lie far from the origin.
    """
    n = next((k for k, error in enumerate(errors) if error < 10.0 * noise), len(errors))
    if n < 3 and mesh == OWN:
        raise Skip("remainders drown in the rounding of positions far from the origin")
    if n < 3:
        raise AssertionError(f"only {n} remainders are larger than rounding: energy or forces do not change")
    return order(_STEPS[:n], errors[:n], expected, x="step h", y=y, title=title)


def exact_derivative(function: Callable[[float], Floats]) -> Floats:
    """Derivative at 0 of a polynomial of degree six or less, from its values at -3, -2, -1, 1, 2 and 3."""
    one, two, three = (function(k) - function(-k) for k in (1.0, 2.0, 3.0))
    return (45.0 * one - 9.0 * two + three) / 60.0


_EXACT = {
    "unit": "1",
    "kind": Kind.IDENTITY,
    "source": "J is a polynomial of degree three along a line; central differences of order six",
    "over": {"precision": PRECISIONS, "state": ("random", "inverted")},
}


@case(
    "derivatives/exact-slope",
    title="The slope of the energy along a line is the work of the forces, without any truncation error",
    quantity="difference of the slope, over the root of the sum of squares of its terms",
    formula="f . d = (45 (E_1 - E_-1) - 9 (E_2 - E_-2) + E_3 - E_-3) / 60, E_k = E(x + k d): E has degree six",
    tolerance=EPSILON,
    reason="machine epsilon: roundings of the elements are independent",
    **_EXACT,
)
def exact_slope(use: Use, *, precision: Precision, state: str) -> Measurement:
    """Energies at seven points against the gradient."""
    disc, x, d = _line(use, state)
    backend = use.backend(disc, precision)
    slope = math.fsum(exact_derivative(lambda t: backend.energies(x + t * d)[0]))
    scale = 2.0 * float(np.linalg.norm(terms(disc, x, precision).energy))
    return compare(slope, math.fsum((backend.gradient(x) * d).ravel()), scale)


@case(
    "derivatives/exact-product",
    title="The Hessian product is the slope of the forces along a line, without any truncation error",
    quantity="largest difference at a vertex, over the sum of its terms",
    formula="H d = (45 (f_1 - f_-1) - 9 (f_2 - f_-2) + f_3 - f_-3) / 60, f_k = f(x + k d): f has degree five",
    tolerance=EPSILON,
    reason="machine epsilon: the sum of the terms bounds what rounding does",
    **_EXACT,
)
def exact_product(use: Use, *, precision: Precision, state: str) -> Measurement:
    """Gradients at six points against the Hessian product."""
    disc, x, d = _line(use, state)
    backend = use.backend(disc, precision)
    scale = 2.0 * at_vertices(disc, terms(disc, x, precision).force)
    computed = backend.hessian_product(x, d)
    return compare(computed / scale, exact_derivative(lambda t: backend.gradient(x + t * d)) / scale, 1.0)


def _line(use: Use, state: str) -> tuple[Discretisation, Floats, Floats]:
    disc = released(body("rabbit"))
    d = 0.05 * mean_edge(disc.mesh) * use.rng(622).standard_normal(disc.mesh.points.shape)
    return disc, positions(disc.mesh, state), d


@case(
    "derivatives/energy-along",
    title="The polynomial of the energy along a correction of a layer is that of the assembled energies",
    quantity="largest difference of an energy change at five points, over the root of the sum of squares of its terms",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="c_1 t + ... + c_6 t^6 = E(x + t P dx) - E(x)",
    source="scikit-fem; J is a polynomial of degree three along a line",
    tolerance=EPSILON,
    reason="machine epsilon: roundings of the elements are independent",
    over={"precision": PRECISIONS, "layer": ("vertices", "clusters", "lattice")},
    requires="scikit-fem",
)
def energy_along(use: Use, *, precision: Precision, layer: str) -> Measurement:
    """Coefficients for a random correction of a held rabbit."""
    disc = body("rabbit")
    backend, x = use.backend(disc, precision), positions(disc.mesh, "random")
    nodes, d = _layer(disc, backend, layer), np.zeros_like(x)
    backend.prolong(nodes, 0.1 * mean_edge(disc.mesh) * use.rng(623).standard_normal((nodes.n_nodes, 3)), d)
    coefficients = backend.energies_along(nodes, x, d)
    assembled, t = AssembledElasticity(disc.mesh, disc.mu, disc.lam), np.array([-1.0, -0.5, 0.5, 1.0, 2.0])
    expected = [assembled.energy(x + one * d) - assembled.energy(x) for one in t]
    scale = np.array([np.linalg.norm(terms(disc, x + one * d, precision).energy) for one in t])
    computed = (t[:, None] ** np.arange(1, 7)) @ coefficients
    return compare(computed / scale, expected / scale, 1.0)


def _layer(disc: Discretisation, backend: Backend, name: str) -> Layer:
    if name == "vertices":
        return backend.vertices
    return (build_constant_hierarchy(disc, 8) if name == "clusters" else build_linear_hierarchy(disc)).layers[1]


@case(
    "derivatives/symmetry",
    title="The Hessian is symmetric",
    quantity="a . H b - b . H a with random a and b, over the root of the sum of squares of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="a . H b = b . H a, for the exact Hessian and for its definite part",
    source="second derivatives commute",
    tolerance=EPSILON,
    reason="machine epsilon: whatever F is, the Hessian is symmetric up to the rounding of its own terms",
    over={"precision": PRECISIONS, "mesh": _MESHES, "part": ("exact", "definite")},
    quick=_QUICK,
    own_mesh=True,
)
def symmetry(use: Use, *, precision: Precision, mesh: str, part: str) -> Measurement:
    """Products with two random directions at a random state."""
    disc = released(body(mesh))
    backend, x = use.backend(disc, precision), positions(disc.mesh, "random")
    a, b = use.rng(624).standard_normal((2, *x.shape))
    one, two = (backend.hessian_product(x, d, definite=part == "definite") for d in (b, a))
    difference = math.fsum((a * one - b * two).ravel())
    sizes = _at_elements(disc, a) * _at_elements(disc, b)
    return vanishes(difference, float(np.linalg.norm(terms(disc, x, precision).curvature * sizes)))


def _at_elements(disc: Discretisation, d: Floats) -> Floats:
    """Norm of a vertex field over the corners of each element, shape [m]."""
    return np.linalg.norm(d[disc.mesh.cells], axis=(1, 2))


@case(
    "derivatives/definite-part",
    title="The definite part of the Hessian is never negative and never below the Hessian",
    quantity="largest shortfall of d . H+ d below 0 and d . H d, over the root of the sum of squares of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="d . H+ d >= max(0, d . H d): negative eigenvalues of elements are left out, positive ones kept",
    source="Smith, de Goes, Kim 2019",
    tolerance=EPSILON,
    reason="machine epsilon: roundings of the elements are independent",
    over={"precision": PRECISIONS, "mesh": _MESHES},
    quick=_QUICK,
    own_mesh=True,
)
def definite_part(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Random directions, smooth ones, and that of the forces."""
    disc = released(body(mesh))
    backend, x = use.backend(disc, precision), positions(disc.mesh, "random")
    directions = [*use.rng(625).standard_normal((3, *x.shape)), wave(use, disc.mesh.points), backend.gradient(x)]
    stiffness, shortfalls = terms(disc, x, precision).stiffness, []
    for d in directions:
        exact, definite = (float((d * backend.hessian_product(x, d, definite=one)).sum()) for one in (False, True))
        scale = float(np.linalg.norm(stiffness * _at_elements(disc, d) ** 2))
        # Unlike max, np.maximum of a number and NaN is NaN.
        shortfalls.append(np.maximum(0.0, np.maximum(0.0, exact) - definite) / scale)
    return vanishes(shortfalls, 1.0)


@case(
    "derivatives/rigid-products",
    title="Translations are in the null space of the Hessian, and rotations turn the forces",
    quantity="largest difference of a product at a vertex, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="H t = 0 and H (w x (x - c)) = w x f: derivatives of f(Q x + d) = Q f(x); at rest the six null vectors",
    source="energy of rigid motions",
    tolerance=EPSILON,
    reason="machine epsilon: the sum of the terms bounds what rounding does",
    over={"precision": PRECISIONS, "mesh": _MESHES, "state": ("rest", "random")},
    quick=_QUICK,
    own_mesh=True,
)
def rigid_products(use: Use, *, precision: Precision, mesh: str, state: str) -> Measurement:
    """Three translations and three rotations about the centre."""
    disc = released(body(mesh))
    backend, x = use.backend(disc, precision), positions(disc.mesh, state)
    arm, f = x - 0.5 * (x.min(axis=0) + x.max(axis=0)), backend.gradient(x)
    differences = []
    for axis in np.eye(3):
        for d, expected in (
            (np.broadcast_to(axis, x.shape).copy(), np.zeros_like(x)),
            (np.cross(axis, arm), np.cross(axis, f)),
        ):
            difference = backend.hessian_product(x, d) - expected
            differences.append(difference / product_terms(disc, x, d, precision))
    return vanishes(differences, 1.0)


@case(
    "derivatives/null-space",
    title="At rest a free body has exactly six motions that cost no energy",
    quantity="eigenvalues of the dense Hessian below a millionth of the largest",
    unit="1",
    kind=Kind.IDENTITY,
    formula="three translations and three rotations",
    source="linear elasticity",
    tolerance=0.0,
    reason="a count",
    over={"precision": PRECISIONS, "part": ("exact", "definite")},
)
def null_space(use: Use, *, precision: Precision, part: str) -> Measurement:
    """All eigenvalues of a small distorted box."""
    disc = uniform(box((0.3, 0.2, 0.2), (3, 2, 2), jitter=0.12, seed=SEED))
    backend, X = use.backend(disc, precision), disc.mesh.points
    units = np.eye(X.size).reshape(-1, *X.shape)
    H = np.stack([backend.hessian_product(X, d, definite=part == "definite").ravel() for d in units], axis=1)
    values = np.linalg.eigvalsh(0.5 * (H + H.T)) / np.linalg.eigvalsh(0.5 * (H + H.T))[-1]
    sixth = np.sort(np.abs(values))[5]
    note = f"the sixth is {sixth:.1e} and the seventh {values[6]:.1e} of the largest"
    return compare(int((values < 1e-6).sum()), 6, 1.0, note)
