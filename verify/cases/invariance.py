# SPDX-License-Identifier: BSD-3-Clause
"""What rotations, translations, numbering and units must not change."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.backend import Precision
from meshes.generators import box
from meshes.types import TetMesh
from verify.problems.bodies import OWN, body, positions, released, uniform
from verify.problems.scales import EPSILON, at_vertices, product_terms, terms
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare, vanishes
from verify.suite.use import SEED, Use

Floats = NDArray[np.float64]

_TURN = Rotation.from_rotvec(np.array([0.7, -1.1, 1.9])).as_matrix()
_APART = {"1m": 1.0, "10m": 10.0}
_OVER = {"precision": PRECISIONS, "mesh": ("rabbit", "slivers")}
_QUICK = {"mesh": ("rabbit", OWN)}
_OBJECTIVITY = "Psi depends on F^T F and det F alone"
_REASON = "machine epsilon: the sum of the terms bounds what rounding does"


def moved(x: Floats) -> Floats:
    """Q x + d: turned by 134 degrees about a skew axis, and moved by some body lengths [m]."""
    return x @ _TURN.T + float(np.ptp(x, axis=0).max()) * np.array([3.0, -5.0, 2.0])


@case(
    "invariance/energy",
    title="A body that is turned and moved has the same energy in every element",
    quantity="largest difference of an element's energy, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="E(Q x + d) = E(x) for any rotation Q",
    source=_OBJECTIVITY,
    tolerance=EPSILON,
    reason=_REASON,
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def energy(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Energies at a random state and at that state moved."""
    disc = body(mesh)
    x = positions(disc.mesh, "random")
    backend, scale = use.backend(disc, precision), terms(disc, moved(x), precision).energy
    return compare(backend.energies(moved(x))[0] / scale, backend.energies(x)[0] / scale, 1.0)


@case(
    "invariance/forces",
    title="Forces turn with the body and do not see translations",
    quantity="largest difference of a vertex force, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="f(Q x + d) = Q f(x) for any rotation Q",
    source=_OBJECTIVITY,
    tolerance=EPSILON,
    reason=_REASON,
    over={**_OVER, "state": ("rest", "random")},
    quick=_QUICK,
    own_mesh=True,
)
def forces(use: Use, *, precision: Precision, mesh: str, state: str) -> Measurement:
    """Gradients at a state and at that state moved."""
    disc = released(body(mesh))
    x, backend = positions(disc.mesh, state), use.backend(disc, precision)
    scale = at_vertices(disc, terms(disc, moved(x), precision).force)
    return compare(backend.gradient(moved(x)) / scale, backend.gradient(x) @ _TURN.T / scale, 1.0)


@case(
    "invariance/hessian",
    title="Hessian products turn with the body and do not see translations",
    quantity="largest difference of a product at a vertex, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="H(Q x + d) Q d = Q H(x) d, for the exact Hessian and for its definite part",
    source=_OBJECTIVITY,
    tolerance=EPSILON,
    reason=_REASON,
    over={**_OVER, "part": ("exact", "definite")},
    quick=_QUICK,
    own_mesh=True,
)
def hessian(use: Use, *, precision: Precision, mesh: str, part: str) -> Measurement:
    """Products with a random direction at a random state and at that state moved."""
    disc = released(body(mesh))
    x, backend = positions(disc.mesh, "random"), use.backend(disc, precision)
    d, definite = use.rng(611).standard_normal(x.shape), part == "definite"
    scale = product_terms(disc, moved(x), d, precision)
    computed = backend.hessian_product(moved(x), d @ _TURN.T, definite=definite)
    return compare(computed / scale, backend.hessian_product(x, d, definite=definite) @ _TURN.T / scale, 1.0)


@case(
    "invariance/rigid-motion",
    title="A rigid motion of the body at rest costs no energy",
    quantity="largest energy of an element, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="Psi(Q) = 0 for any rotation Q",
    source=_OBJECTIVITY,
    tolerance=EPSILON,
    reason=_REASON,
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def rigid_motion(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Energies of the body at rest, moved."""
    disc = body(mesh)
    x = moved(disc.mesh.points)
    return vanishes(use.backend(disc, precision).energies(x)[0] / terms(disc, x, precision).energy, 1.0)


@case(
    "invariance/far-away",
    title="Forces of a strained body a thousand lengths away are those of the body here",
    quantity="largest difference of a vertex force, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="f(x + d) = f(x); positions stay in float64, so float32 loses nothing to the distance",
    source="differences of positions are formed before anything is rounded to float32",
    tolerance=EPSILON,
    reason=_REASON + ", that of positions included",
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def far_away(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Gradients at a random state here and there."""
    disc = released(body(mesh))
    x, backend = positions(disc.mesh, "random"), use.backend(disc, precision)
    there = x + 1000.0 * float(np.ptp(x, axis=0).max()) * np.array([1.0, -0.3, 0.02])
    scale = at_vertices(disc, terms(disc, there, precision).force)
    return compare(backend.gradient(there) / scale, backend.gradient(x) / scale, 1.0)


@case(
    "invariance/turned-noise",
    title="A body turned by 45 degrees at a strain of one in ten thousand still has its stress to a part in a thousand",
    quantity="largest error of a vertex force, over the force of the strain: mu 1e-4 times the area at the vertex",
    unit="1",
    kind=Kind.IDENTITY,
    formula="f(Q x) = Q f(x)",
    source=_OBJECTIVITY,
    tolerance={"float64": 5e-10, "float32": 1e-3},
    reason="6e-8 / 1e-4 of what a block's affine part leaves, measured 5.4e-4 of float32; in float64 that of positions",
    over={"precision": PRECISIONS},
)
def turned_noise(use: Use, *, precision: Precision) -> Measurement:
    """Forces of a stretched rabbit, turned, against those of the float64 passes before it is turned."""
    disc = body("rabbit", "uniform", held=False)
    x = disc.mesh.points * (1.0 + 1e-4 * np.array([1.0, -0.3, -0.3]))
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 4.0]).as_matrix()
    exact = use.backend(disc, "float64").gradient(x) @ turn.T
    scale = 1e-4 * at_vertices(disc, disc.Vmu * np.linalg.norm(disc.B, axis=1))
    return compare(use.backend(disc, precision).gradient(x @ turn.T) / scale, exact / scale, 1.0)


@case(
    "invariance/parted-bodies",
    title="Two bodies that have parted feel nothing but the rounding of their distance, in one block of elements",
    quantity="largest error of a vertex force, over the largest stiffness of an element times the distance",
    unit="1",
    kind=Kind.IDENTITY,
    formula="f(x_1, x_2 + d) = f(x_1, x_2) for bodies that share no vertex",
    source="differences within a block are rounded to float32 after its affine part, which fits one body at best",
    tolerance={"float64": 1e-15, "float32": EPSILON["float32"]},
    reason="machine epsilon of the distance; in float64 positions are rounded too; the note has the share of forces",
    over={"precision": PRECISIONS, "apart": tuple(_APART)},
)
def parted_bodies(use: Use, *, precision: Precision, apart: str) -> Measurement:
    """Boxes of 1 m and 288 elements each, strained by a hundredth, against float64 passes before they part."""
    disc, right, distance = two_boxes(), two_boxes().mesh.points[:, 0] > 1.25, _APART[apart]
    x = disc.mesh.points * (1.0 + 1e-2 * np.array([1.0, -0.3, -0.3]))
    parted = x + distance * right[:, None] * [1.0, 0.0, 0.0]
    f, exact = use.backend(disc, precision).gradient(parted), use.backend(disc).gradient(x)
    share = np.abs(f - exact).max() / np.abs(exact).max()
    stiffness = float(((disc.Vmu + disc.Vlam) * (disc.B**2).sum(axis=1)).max())
    return compare(f, exact, distance * stiffness, f"{share:.2g} of the largest force")


@cache
def two_boxes() -> Discretisation:
    """Two bodies in one mesh, few enough elements for one block."""
    one = box((1.0, 1.0, 1.0), (4, 4, 3), jitter=0.12, seed=SEED)
    X = np.concatenate([one.points, one.points + np.array([1.5, 0.0, 0.0])])
    return uniform(TetMesh(X, np.concatenate([one.cells, one.cells + len(one.points)]).astype(np.int32)))


@case(
    "invariance/sum-of-forces",
    title="Elastic forces of a free body add up to zero",
    quantity="sum of all vertex forces, over the root of the sum of squares of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="sum_v f_v = 0",
    source="translations cost no energy: Newton's third law",
    tolerance=EPSILON,
    reason="machine epsilon: whatever an element's stress is, its forces cancel up to their own rounding",
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def sum_of_forces(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Resultant at a random state."""
    disc = released(body(mesh))
    x = positions(disc.mesh, "random")
    scale = float(np.linalg.norm(terms(disc, x, precision).stress))
    return vanishes(_exact_sum(use.backend(disc, precision).gradient(x)), scale)


@case(
    "invariance/sum-of-moments",
    title="Moments of the elastic forces of a free body add up to zero",
    quantity="sum of all moments about the centre, over the root of the sum of squares of forces times the longest arm",
    unit="1",
    kind=Kind.IDENTITY,
    formula="sum_v x_v cross f_v = 0",
    source="rotations cost no energy",
    tolerance=EPSILON,
    reason="machine epsilon: P F^T is symmetric up to the rounding of its terms",
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def sum_of_moments(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Resultant moment at a random state."""
    disc = released(body(mesh))
    x = positions(disc.mesh, "random")
    arm = x - 0.5 * (x.min(axis=0) + x.max(axis=0))
    moment = _exact_sum(np.cross(arm, use.backend(disc, precision).gradient(x)))
    scale = float(np.linalg.norm(terms(disc, x, precision).stress) * np.abs(arm).max())
    return vanishes(moment, scale)


def _exact_sum(vectors: Floats) -> Floats:
    """Sum of the rows, rounded once."""
    return np.array([math.fsum(column) for column in vectors.T])


@case(
    "invariance/numbering",
    title="Forces and energies do not depend on the numbering of vertices, elements and corners",
    quantity="largest difference of a vertex force, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="the same sums in another order",
    source="definition of the energy as a sum over elements",
    tolerance=EPSILON,
    reason=_REASON,
    over={"precision": PRECISIONS, "what": ("vertices", "elements", "corners")},
)
def numbering(use: Use, *, precision: Precision, what: str) -> Measurement:
    """Gradient of a renumbered rabbit, with the low end of x held."""
    disc, random = body("rabbit"), use.rng(612)
    X, cells, x = disc.mesh.points, disc.mesh.cells, positions(disc.mesh, "random")
    vertex = random.permutation(len(X)) if what == "vertices" else np.arange(len(X))
    element = random.permutation(len(cells)) if what == "elements" else np.arange(len(cells))
    # Even permutations keep the orientation.
    corner = [3, 2, 1, 0] if what == "corners" else [0, 1, 2, 3]
    renumbered = np.argsort(vertex)[cells[element]][:, corner]
    other = _renewed(disc, TetMesh(X[vertex], renumbered.astype(np.int32)), element, vertex)
    scale = at_vertices(disc, terms(disc, x, precision).force)
    forces = np.empty_like(x)
    forces[vertex] = use.backend(other, precision).gradient(x[vertex])
    return compare(forces / scale, use.backend(disc, precision).gradient(x) / scale, 1.0)


@case(
    "invariance/turned-rest-shape",
    title="The material is isotropic: a body whose rest shape was turned has the same forces",
    quantity="largest difference of a vertex force, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="f(x; Q X) = f(x; X): Psi(F Q^T) = Psi(F)",
    source="Psi depends on the invariants of F^T F alone",
    tolerance=EPSILON,
    reason=_REASON,
    over={"precision": PRECISIONS},
)
def turned_rest_shape(use: Use, *, precision: Precision) -> Measurement:
    """Gradients of one deformed shape with two rest shapes."""
    disc = released(body("rabbit"))
    x = positions(disc.mesh, "random")
    other = _renewed(disc, disc.mesh.moved(disc.mesh.points @ _TURN.T))
    scale = at_vertices(disc, terms(other, x, precision).force)
    return compare(
        use.backend(other, precision).gradient(x) / scale, use.backend(disc, precision).gradient(x) / scale, 1
    )


_UNITS = {"millimetres": 1e3, "micrometres": 1e6}


@case(
    "invariance/units",
    title="In other units of length the forces are the same",
    quantity="largest difference of a force or Hessian product at a vertex, over the sum of its terms",
    unit="1",
    kind=Kind.IDENTITY,
    formula="lengths times s and pressures over s^2: forces in newtons stay, stiffnesses fall by s",
    source="dimensional analysis",
    tolerance=EPSILON,
    reason=_REASON + "; no threshold in the code has a unit",
    over={"precision": PRECISIONS, "unit": tuple(_UNITS)},
)
def units(use: Use, *, precision: Precision, unit: str) -> Measurement:
    """Gradient and definite product of a rabbit in metres and pascals, and in other units."""
    disc, s = released(body("rabbit")), _UNITS[unit]
    x, d = positions(disc.mesh, "random"), use.rng(613).standard_normal(disc.mesh.points.shape)
    other = _renewed(disc, disc.mesh.moved(s * disc.mesh.points), pressure=s**-2)
    force, product = at_vertices(disc, terms(disc, x, precision).force), product_terms(disc, x, d, precision)
    one, two = use.backend(disc, precision), use.backend(other, precision)
    computed = two.gradient(s * x) / force, s * two.hessian_product(s * x, d, definite=True) / product
    return compare(computed, (one.gradient(x) / force, one.hessian_product(x, d, definite=True) / product), 1.0)


def _renewed(
    disc: Discretisation,
    mesh: TetMesh,
    element: NDArray | slice = slice(None),
    vertex: NDArray | slice = slice(None),
    pressure: float = 1.0,
) -> Discretisation:
    """The same material on another mesh, whose elements and vertices are those named; pressures times a factor."""
    rest = discretise(mesh, 1.0, 0.0, 1.0)
    mu, lam = pressure * disc.mu[element], pressure * disc.lam[element]
    return replace(rest, mu=mu, lam=lam, Vmu=rest.V * mu, Vlam=rest.V * lam, free=disc.free[vertex])
