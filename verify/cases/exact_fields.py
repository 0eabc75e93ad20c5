# SPDX-License-Identifier: BSD-3-Clause
"""Fields that are exact at finite strain: forces of straight motions, bars under their own weight, frequencies.

All of them move along one direction, and such motion is linear at any amplitude (`verify.reference.straight_motion`).
Rollers hold the other two directions (`verify.problems.rollers`); passes, solvers and time stepping are production's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.kernels.backend import Precision
from femgal.timestep.backward_euler import BackwardEuler
from meshes.generators import box
from verify.problems.bodies import Moving, body, rng, uniform
from verify.problems.rollers import on_rollers
from verify.problems.scales import at_vertices, terms
from verify.problems.waves import (
    AMPLITUDE,
    SOLVERS,
    STOP,
    WAVES,
    build_solver,
    motion,
    standing_wave,
    straight_line_state,
)
from verify.reference.statics import ProductionElasticity, equilibrium
from verify.reference.straight_motion import straight_stiffness
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import at_most, compare, order
from verify.suite.use import SEED, Use

Floats = NDArray[np.float64]

_EXACT = "P_1j = mu G_j + lam G_1 delta_1j for u = (u1, 0, 0), G = grad u1"
_LINEAR = "linear in u1 at any strain, from P = mu F + (lam (J - 1) - mu) cof F, Smith et al. 2018, Eq. 13"

# Cells along the bar of the convergence studies.
_SIZES = (4, 8, 16)


@case(
    "exact/straight-motion-forces",
    title="Forces along a motion in one direction are linear in it, elements turned over included",
    quantity="largest difference of a force along x over the sum of the terms at its vertex",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula=_EXACT,
    source=_LINEAR,
    tolerance={"float64": 2e-16, "float32": 1e-7},
    reason="a unit in the last place of the terms of the elements at the vertex, which bound what rounding can do",
    over={"precision": PRECISIONS, "mesh": ("box", "rabbit", "slivers")},
    own_mesh=True,
)
def straight_motion_forces(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Gradient pass against a linear stiffness."""
    disc = body(mesh)
    x = straight_line_state(disc)
    expected = straight_stiffness(disc) @ (x - disc.mesh.points)[:, 0]
    scale = at_vertices(disc, terms(disc, x, precision).force)[disc.free, 0]
    return compare(use.backend(disc, precision).gradient(x)[disc.free, 0] / scale, expected[disc.free] / scale, 1.0)


@case(
    "exact/straight-motion-stiffness",
    title="Hessian products along a motion in one direction do not depend on how far it has gone",
    quantity="largest difference of a product along x over the largest product",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="H_11 = K with " + _EXACT,
    source=_LINEAR,
    tolerance={"float64": 1e-12, "float32": 2e-5},
    reason="rounding of a sum over some twenty elements, with terms that cancel",
    over={"precision": PRECISIONS, "mesh": ("box", "rabbit")},
)
def straight_motion_stiffness(use: Use, *, precision: Precision, mesh: str) -> Measurement:
    """Hessian-vector products against the same linear stiffness."""
    disc = body(mesh)
    x = straight_line_state(disc)
    d = rng(403).standard_normal((disc.n_vertices, 1)) * disc.free[:, None] * [1.0, 0.0, 0.0]
    expected = (straight_stiffness(disc) @ d[:, 0])[disc.free]
    return compare(use.backend(disc, precision).hessian_product(x, d)[disc.free, 0], expected)


@case(
    "exact/wave-forces",
    title="Half a sine between walls is a mode of the mesh at 38 % strain, with the frequency of a chain",
    quantity="largest |M^-1 f + omega^2 u| over omega^2 |u|",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="omega = (2 c / d) sin(k d / 2); c = sqrt((lam + mu) / rho) along, sqrt(mu / rho) across the motion",
    source=_LINEAR + "; discrete dispersion of a chain, e.g. Kittel, chapter 4",
    tolerance={"float64": 1e-11, "float32": 2e-4},
    reason="forces of the single elements, some ten times the resultant, are rounded",
    over={"wave": WAVES, "precision": PRECISIONS},
)
def wave_forces(use: Use, *, wave: str, precision: Precision) -> Measurement:
    """Forces against inertia of the mode."""
    one = standing_wave(wave)
    backend = on_rollers(use.backend(one.disc, precision), 0)
    acceleration = backend.gradient(one.start) / one.disc.mass[:, None]
    return compare(acceleration, one.omega**2 * AMPLITUDE * one.shape)


@case(
    "exact/bar-between-walls",
    title="A bar that comes to rest under its own weight between two walls has the exact displacement at every vertex",
    quantity="largest error of a displacement over the largest displacement",
    unit="m",
    kind=Kind.CLOSED_FORM,
    formula="u = rho g x (L - x) / (2 (lam + mu)), 40 % strain at the walls",
    source=_LINEAR + "; linear elements are exact at the nodes of a chain with equal masses (Strang and Fix 1973)",
    tolerance=1e-11,
    reason="rest is approached by a factor of ten per step, twelve times, with residuals of 1e-13 m",
    over={"solver": SOLVERS},
    quick={"solver": ("chebyshev",)},
)
def bar_between_walls(use: Use, *, solver: str) -> Measurement:
    """Production's backward Euler with long steps, from the undeformed bar."""
    one = standing_wave("longitudinal")
    backend = on_rollers(use.backend(one.disc), 0)
    g = 0.8 * one.speed**2
    ends = np.flatnonzero(~one.disc.free)
    stepper = BackwardEuler(
        backend,
        build_solver(solver, backend, STOP["float64"]),
        1,
        np.array([g, 0.0, 0.0]),
        motions=(Moving(ends, one.disc.mesh.points[ends]),),
    )
    x = one.disc.mesh.points[:, 0]
    end = motion(stepper, one.disc.mesh.points, 10.0 / one.omega, 12)[-1]
    exact = (0.5 * g * x * (1.0 - x) / one.speed**2)[:, None] * [1.0, 0.0, 0.0]
    return compare(end.x - one.disc.mesh.points, exact)


@case(
    "exact/hanging-bar-order",
    title="A bar that hangs on one end on a distorted mesh converges to the exact displacement with order 2",
    quantity="order of the root mean square error, lumped masses as weights",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="u = rho g (L x - x^2 / 2) / (lam + mu), 40 % strain",
    source=_LINEAR,
    tolerance=0.1,
    reason="the meshes of the sequence are distorted at random, 4 to 16 cells",
)
def hanging_bar_order(use: Use) -> Measurement:
    """Newton's method on production's forces."""
    errors = [_hanging(use, cells).rms_error() for cells in _SIZES]
    h = [1.0 / cells for cells in _SIZES]
    return order(h, errors, 2.0, x="cell [m]", y="rms error over largest displacement", title="Hanging bar")


@case(
    "exact/hanging-bar-error",
    title="On 16 distorted cells the hanging bar errs no more than the exact displacement's interpolant, in energy",
    quantity="error in the norm of energy over that of the interpolant",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="u = rho g (L x - x^2 / 2) / (lam + mu); |e|^2 = integral of mu |grad e|^2 + lam (de/dx)^2",
    source=_LINEAR + "; Galerkin's solution is the best in this norm (Cea 1964)",
    tolerance=0.0,
    reason="the bound is 1: the problem is linear, and lumped weight is the exact load of linear elements",
)
def hanging_bar_error(use: Use) -> Measurement:
    """The finest of the sequence."""
    bar = _hanging(use, _SIZES[-1])
    error, interpolant = (_energy_error(bar, u) for u in (bar.u, bar.exact))
    return at_most(error / interpolant, 1.0, f"rms error at the vertices {bar.rms_error():.3g}")


@case(
    "exact/frequency-order",
    title="The lowest frequency of a bar on a distorted mesh converges to that of the continuum with order 2",
    quantity="order of the relative error of the frequency",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="omega = pi c / (2 L), fixed at one end; c = sqrt((lam + mu) / rho), sqrt(mu / rho) across",
    source=_LINEAR + "; lumped masses, error (k h)^2 / 24 on a chain",
    tolerance=0.15,
    reason="the meshes of the sequence are distorted at random, 4 to 16 cells",
    over={"wave": WAVES},
)
def frequency_order(use: Use, *, wave: str) -> Measurement:
    """Eigenvalues of production's Hessian products."""
    errors = [abs(_frequency_ratio(use, wave, cells) - 1.0) for cells in _SIZES]
    h = [1.0 / cells for cells in _SIZES]
    return order(h, errors, 2.0, x="cell [m]", y="relative error of the frequency", title=f"Lowest {wave} frequency")


def _bar(cells: int, along: int = 0) -> Discretisation:
    """Distorted bar of 1 m with half as many cells across, held at its lower end."""
    size, counts = [0.5] * 3, [cells // 2] * 3
    size[along], counts[along] = 1.0, cells
    mesh = box((size[0], size[1], size[2]), (counts[0], counts[1], counts[2]), jitter=0.12, seed=SEED)
    return uniform(mesh, np.flatnonzero(mesh.points[:, along] < 1e-9))


@dataclass(frozen=True, eq=False)
class _Hanging:
    """Displacements u and `exact` along x at the vertices [m], shape [n]; `top` is the exact strain at the held end."""

    disc: Discretisation
    u: Floats
    exact: Floats
    top: float

    def rms_error(self) -> float:
        """Root mean square error at the vertices, lumped masses as weights, over the largest displacement."""
        mass = self.disc.mass
        return float(np.sqrt(mass @ (self.u - self.exact) ** 2 / mass.sum()) / self.exact.max())


@cache
def _hanging(use: Use, cells: int) -> _Hanging:
    disc, top = _bar(cells), 0.4
    X = disc.mesh.points
    g = top * float(disc.mu[0] + disc.lam[0]) / 1000.0
    free = disc.free[:, None] & np.array([True, False, False])
    elasticity = ProductionElasticity.of(on_rollers(use.backend(disc), 0))
    load = disc.mass[:, None] * np.array([g, 0.0, 0.0])
    u = (equilibrium(elasticity, load, free, X).x - X)[:, 0]
    return _Hanging(disc, u, top * (X[:, 0] - 0.5 * X[:, 0] ** 2), top)


def _energy_error(bar: _Hanging, u: Floats) -> float:
    """Norm of energy of the error of linear elements with displacements u along x at the vertices, shape [n]."""
    mesh = bar.disc.mesh
    corners, values = mesh.points[mesh.cells], u[mesh.cells]
    edges = corners[:, 1:] - corners[:, :1]
    slope = np.linalg.solve(edges, (values[:, 1:] - values[:, :1])[:, :, None])[:, :, 0]
    along = bar.top * (1.0 - corners[:, :, 0]) - slope[:, :1]
    # The square of a linear function over a tetrahedron, from its values at the corners.
    square = (along**2).sum(axis=1) / 20.0 + along.sum(axis=1) ** 2 / 20.0
    density = (bar.disc.mu + bar.disc.lam) * square + bar.disc.mu * (slope[:, 1:] ** 2).sum(axis=1)
    return math.sqrt(float(np.abs(np.linalg.det(edges)) / 6.0 @ density))


def _frequency_ratio(use: Use, wave: str, cells: int) -> float:
    """Lowest frequency over that of the continuum."""
    along = WAVES.index(wave)
    disc = _bar(cells, along)
    backend, X = on_rollers(use.backend(disc), 0), disc.mesh.points
    scale = np.sqrt(disc.mass)

    def product(v: Floats) -> Floats:
        d = np.where(disc.free, v.ravel() / scale, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
        return backend.hessian_product(X, d)[:, 0] / scale

    # Held vertices would add eigenvalues of zero: they get one above all others.
    top = 4.0 * float((backend.gradient_and_blocks(backend.vertices, X, X, 0.0)[1][:, 0] / disc.mass[disc.free]).max())
    A = spla.LinearOperator(
        (len(X), len(X)), lambda v: product(v) + np.where(disc.free, 0.0, top * v.ravel()), dtype=float
    )
    start = scale * np.sin(0.5 * np.pi * X[:, along])
    square = spla.eigsh(A, 1, which="SA", v0=start, tol=1e-9, return_eigenvectors=False)[0]
    speed = math.sqrt((disc.mu[0] + (disc.lam[0] if along == 0 else 0.0)) / 1000.0)
    return math.sqrt(square) / (0.5 * math.pi * speed)
