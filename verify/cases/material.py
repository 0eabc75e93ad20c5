# SPDX-License-Identifier: BSD-3-Clause
"""Energy, stress and stiffness of uniform deformations against closed forms."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.backend import Backend, Precision
from meshes.generators import box
from meshes.surface import boundary
from verify.problems.bodies import body
from verify.problems.scales import EPSILON, at_vertices, terms
from verify.reference.elasticity import AssembledElasticity
from verify.reference.uniform_states import UNIFORM_STATES, UniformState, uniaxial, uniform_state
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare, worst
from verify.suite.use import SEED, Use

Floats = NDArray[np.float64]

_SMITH = "Smith, de Goes, Kim 2018, section 3.4 and Eq. 13; worked out in verify/reference/uniform_states.py"
_MESH = "rabbit"


@case(
    "material/youngs-modulus",
    title="A bar that is stretched by one millionth with free sides shows the Young's modulus that was given",
    quantity="(R(1 + e) - R(1 - e)) / (2 e A) over the E given, with R the force on the end and e = 1e-6",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="mu = E / (2 (1 + nu)), lam = lam_Lame + mu_Lame = mu / (1 - 2 nu)",
    source="Smith, de Goes, Kim 2018, section 3.4: with lam_Lame in place of lam the body has other moduli",
    tolerance={"float64": 1e-8, "float32": 1e-5},
    reason="unit roundoff over e in float64, unit roundoff in float32, both times lam / mu = 50",
    over={"precision": PRECISIONS, "poisson": (-0.2, 0.3, 0.49)},
)
def youngs_modulus(use: Use, *, precision: Precision, poisson: float) -> Measurement:
    """E of a bar between rollers."""
    pulled, pushed = (pulled_bar(use, precision, poisson, 1.0 + e) for e in (1e-6, -1e-6))
    return compare((pulled[0] - pushed[0]) / 2e-6, 1.0)


@case(
    "material/poissons-ratio",
    title="A bar that is stretched by one millionth with free sides shows the Poisson's ratio that was given",
    quantity="change of width over change of length",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="mu = E / (2 (1 + nu)), lam = lam_Lame + mu_Lame = mu / (1 - 2 nu)",
    source="Smith, de Goes, Kim 2018, section 3.4: with lam_Lame in place of lam the body has other moduli",
    tolerance={"float64": 1e-8, "float32": 1e-5},
    reason="unit roundoff over e in float64, unit roundoff in float32, both times lam / mu = 50",
    over={"precision": PRECISIONS, "poisson": (-0.2, 0.3, 0.49)},
)
def poissons_ratio(use: Use, *, precision: Precision, poisson: float) -> Measurement:
    """nu of a bar between rollers."""
    pulled, pushed = (pulled_bar(use, precision, poisson, 1.0 + e) for e in (1e-6, -1e-6))
    return compare(-(pulled[1] - pushed[1]) / 2e-6, poisson, 1.0)


@case(
    "material/pulled-bar",
    title="A bar pulled or pushed far finds the closed-form force and width",
    quantity="force on the end face over E A, and width over rest width",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="P11 = mu (s - J / s^2), t^2 = J / s, J = 1 + mu / lam (1 - 1 / s)",
    source=_SMITH,
    tolerance={"float64": 1e-12, "float32": 2e-6},
    reason="Newton's method converged to the rounding of the forces",
    over={"precision": PRECISIONS, "stretch": (0.6, 2.0)},
)
def far_pulled_bar(use: Use, *, precision: Precision, stretch: float) -> Measurement:
    """Force and width at finite stretch; the equilibrium is searched for, not assumed."""
    disc = bar(0.3)
    state = uniaxial(stretch, float(disc.mu[0]), float(disc.lam[0]))
    return compare(pulled_bar(use, precision, 0.3, stretch), (state.P[0, 0] / _E, state.F[1, 1]), 1.0)


@case(
    "material/uniform-forces",
    title="Forces of a uniform deformation are those of the closed-form stress on the surface, and none inside",
    quantity="difference of a vertex force, over the sum of its terms",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="dE/dx_v = P (sum of area normals of the boundary triangles at v) / 3, P in closed form",
    source=_SMITH + "; divergence theorem",
    tolerance=EPSILON,
    reason="machine epsilon: the sum of the terms bounds what rounding does",
    over={"precision": PRECISIONS, "state": UNIFORM_STATES},
)
def uniform_forces(use: Use, *, precision: Precision, state: str) -> Measurement:
    """Gradient of the whole body."""
    disc, closed = _uniform(state)
    x = disc.mesh.points @ closed.F.T
    return _compare_forces(disc, x, use.backend(disc, precision).gradient(x), closed, precision)


@case(
    "material/uniform-energy",
    title="Every element of a uniform deformation has the closed-form energy",
    quantity="difference of an element's energy, over the sum of its terms",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="V Psi, such as V mu g^2 / 2 in shear and V (lam + mu) (s - 1)^2 / 2 when confined",
    source=_SMITH,
    tolerance=EPSILON,
    reason="machine epsilon: the sum of the terms bounds what rounding does",
    over={"precision": PRECISIONS, "state": UNIFORM_STATES},
)
def uniform_energy(use: Use, *, precision: Precision, state: str) -> Measurement:
    """Energies of all elements."""
    disc, closed = _uniform(state)
    x = disc.mesh.points @ closed.F.T
    scale = terms(disc, x, precision).energy
    energy, _ = use.backend(disc, precision).energies(x)
    return compare(energy / scale, disc.V * closed.energy / scale, 1.0)


@case(
    "material/volume-ratio",
    title="Every element has the volume ratio of the affine map, inverted ones a negative one",
    quantity="largest difference of J",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="J = det F for x = F X",
    source="definition of J",
    tolerance={"float64": 2e-14, "float32": 2e-6},
    reason="unit roundoff times the share of the longest in the shortest edge",
    over={"precision": PRECISIONS, "state": ("uniaxial", "everted")},
)
def volume_ratio(use: Use, *, precision: Precision, state: str) -> Measurement:
    """J of all elements."""
    disc, closed = _uniform(state)
    _, J = use.backend(disc, precision).energies(disc.mesh.points @ closed.F.T)
    return compare(J, np.full(disc.n_tets, closed.J), 1.0)


@case(
    "material/von-mises",
    title="Every element of a uniform deformation has the closed-form von Mises stress",
    quantity="largest difference, over mu",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="|P11| / t^2 uniaxial, mu |s^2 - 1| / |s| confined, mu g sqrt(3 + g^2) in shear, 0 of a dilation",
    source=_SMITH + "; Cauchy stress P F^T / J",
    tolerance=1e-13,
    reason="unit roundoff times the share of the longest in the shortest edge; always in float64",
    over={"state": UNIFORM_STATES},
)
def von_mises(use: Use, *, state: str) -> Measurement:
    """Von Mises stresses of all elements."""
    disc, closed = _uniform(state)
    computed = use.backend(disc).von_mises(disc.mesh.points @ closed.F.T)
    return compare(computed, np.full(disc.n_tets, closed.von_mises), float(disc.mu[0]))


@case(
    "material/energy-along-dilation",
    title="The energy along a growing dilation is the closed-form polynomial of degree six",
    quantity="largest difference of a coefficient, over the largest of them",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="V (3 mu / 2 (u^2 - 1) - mu (u^3 - 1) + lam / 2 (u^3 - 1)^2) at F = u I, u = 1.2 + t",
    source=_SMITH,
    tolerance={"float64": 1e-13, "float32": 2e-6},
    reason="rounding of a sum of 2570 energies of one sign",
    over={"precision": PRECISIONS},
)
def energy_along_dilation(use: Use, *, precision: Precision) -> Measurement:
    """Coefficients of t to t^6."""
    disc, closed = _uniform("dilation")
    mu, lam, X = float(disc.mu[0]), float(disc.lam[0]), disc.mesh.points
    u = np.polynomial.Polynomial([closed.F[0, 0], 1.0])
    psi = 1.5 * mu * (u**2 - 1.0) - mu * (u**3 - 1.0) + 0.5 * lam * (u**3 - 1.0) ** 2
    backend = use.backend(disc, precision)
    computed = backend.energies_along(backend.vertices, X @ closed.F.T, X)
    return compare(computed, float(disc.V.sum()) * np.asarray(psi.coef[1:], np.float64))


@case(
    "material/assembled-reference",
    title="The assembled reference has the closed-form forces and energy of a uniform deformation",
    quantity="difference of a vertex force over the sum of its terms, or of the energy over that of its terms",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="as for material/uniform-forces and material/uniform-energy",
    source=_SMITH + "; divergence theorem",
    tolerance=EPSILON["float64"],
    reason="machine epsilon; what other cases call the assembled reference is itself checked here",
    over={"state": UNIFORM_STATES},
    requires="scikit-fem",
)
def assembled_reference(use: Use, *, state: str) -> Measurement:
    """Gradient and energy by scikit-fem."""
    disc, closed = _uniform(state)
    x = disc.mesh.points @ closed.F.T
    assembled = AssembledElasticity(disc.mesh, disc.mu, disc.lam)
    scale = float(terms(disc, x).energy.sum())
    energy = compare(assembled.energy(x) / scale, float(disc.V.sum()) * closed.energy / scale, 1.0)
    forces = _compare_forces(disc, x, assembled.gradient(x), closed, "float64")
    return worst({"forces": forces, "energy": energy})


def _uniform(state: str) -> tuple[Discretisation, UniformState]:
    disc = body(_MESH, "uniform", held=False)
    return disc, uniform_state(state, float(disc.mu[0]), float(disc.lam[0]))


def _compare_forces(
    disc: Discretisation, x: Floats, computed: Floats, closed: UniformState, precision: Precision
) -> Measurement:
    """Forces against the closed-form stress times the area that each vertex has on the surface."""
    expected = surface_areas(disc) @ closed.P.T
    scale = at_vertices(disc, terms(disc, x, precision).force)
    return compare(computed / scale, expected / scale, 1.0)


def surface_areas(disc: Discretisation) -> Floats:
    """A third of the area normals of the boundary triangles at each vertex [m^2], shape [n, 3], zero inside."""
    X, triangles = disc.mesh.points, boundary(disc.mesh.cells)
    a, b, c = (X[triangles[:, k]] for k in range(3))
    out = np.zeros_like(X)
    np.add.at(out, triangles.ravel(), np.repeat(np.cross(b - a, c - a) / 6.0, 3, axis=0))
    return out


# The bar: Young's modulus [Pa], and length, width and height [m].
_E = 1e5
_SIZE = (0.4, 0.25, 0.2)


@cache
def bar(nu: float) -> Discretisation:
    """A small bar along x with a displaced inner vertex."""
    return discretise(box(_SIZE, (2, 2, 2), jitter=0.12, seed=SEED), _E, nu, 1000.0)


@cache
def pulled_bar(use: Use, precision: Precision, nu: float, stretch: float) -> tuple[float, float]:
    """Engineering stress on the end of a bar over E, and stretch of its width; both ends stay in their planes.

    Newton's method on the forces and Hessian products of production, with a dense matrix; only the coordinates that the
    supports hold are given.
    """
    disc = bar(nu)
    backend, X = use.backend(disc, precision), disc.mesh.points
    free = ~held_coordinates(X).ravel()
    x, largest = X * [stretch, 1.0, 1.0], np.inf
    for _ in range(20):
        step = np.zeros(x.size)
        step[free] = np.linalg.solve(dense_hessian(backend, x)[np.ix_(free, free)], -backend.gradient(x).ravel()[free])
        x += step.reshape(-1, 3)
        before, largest = largest, float(np.abs(step).max())
        # Quadratic convergence ends in steps that are rounding and no longer shrink.
        if before < 1e-3 * _SIZE[2] and largest > 0.1 * before:
            break
    end, near, far = X[:, 0] == _SIZE[0], X[:, 1] == 0.0, X[:, 1] == _SIZE[1]
    force = backend.gradient(x)[end, 0].sum()
    width = x[far, 1].mean() - x[near, 1].mean()
    return float(force) / (_SIZE[1] * _SIZE[2] * _E), float(width) / _SIZE[1]


def held_coordinates(X: Floats) -> NDArray[np.bool_]:
    """Coordinates held by the supports, shape [n, 3]: x at both ends, and three more against rigid motions."""
    held = np.zeros(X.shape, bool)
    held[:, 0] = (X[:, 0] == 0.0) | (X[:, 0] == _SIZE[0])
    held[(X == 0.0).all(axis=1)] = True
    held[(np.array([0.0, _SIZE[1], 0.0]) == X).all(axis=1), 2] = True
    return held


def dense_hessian(backend: Backend, x: Floats, *, definite: bool = False) -> Floats:
    """Matrix of all Hessian products [N/m], shape [3n, 3n]."""
    units = np.eye(x.size).reshape(-1, *x.shape)
    return np.stack([backend.hessian_product(x, d, definite=definite).ravel() for d in units], axis=1)
