# SPDX-License-Identifier: BSD-3-Clause
"""Sweeps over vertices: what each of them does to the potential, and sweeps on assembled matrices."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.gauss_seidel.colours import colour_vertices
from femgal.gauss_seidel.stars import build_stars
from femgal.gauss_seidel.sweep import descend
from femgal.kernels.cpu.threads import Workers
from femgal.solvers.explicit_jacobi import ExplicitJacobi
from femgal.solvers.explicit_vbd import ExplicitVBD
from femgal.solvers.linearised import Linearised
from femgal.solvers.smoother import step_lengths
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import STATES, body
from verify.reference.galerkin import assembled
from verify.reference.transfer import diagonal_blocks
from verify.suite.case import Kind, Measurement, case
from verify.suite.measure import compare, vanishes, worst
from verify.suite.use import Use

Floats = NDArray[np.float64]


@case(
    "descent/vertex-minimum",
    title="A sweep of vertex block descent takes every vertex of a colour to the minimum over its own position",
    quantity="largest force on a vertex of the colour just moved over the largest before, worst of all colours",
    unit="N",
    kind=Kind.CROSS_CODE,
    formula="(grad phi)_i = (1 - w) of what it was, for all vertices i of a colour at once; 0 for w = 1",
    source="phi is quadratic in one vertex, and vertices of one colour share no element; gradient by scikit-fem",
    tolerance=1e-11,
    reason="rounding of forces that cancel, in elements that are stretched or turned over",
    over={"mesh": ("box", "rabbit", "bunny"), "state": STATES, "w": (1.0, 0.7, 1.6)},
    quick={"mesh": ("box",), "state": ("random",), "w": (1.0, 1.6)},
    requires="scikit-fem; the bunny's surface for its rows",
)
def vertex_minimum(use: Use, *, mesh: str, state: str, w: float) -> Measurement:
    """Colour by colour through one sweep."""
    one, found = assembled(body(mesh), state), {}
    for colour, vertices, before, after, _ in _sweep(one.disc, state, w):
        scale = float(np.abs(before).max())
        found[f"colour {colour}"] = compare(after[vertices], (1.0 - w) * before[vertices], scale)
    return worst(found)


@case(
    "descent/fall",
    title="Every colour of a sweep lowers the potential by exactly what its blocks and forces say",
    quantity="largest error of the fall of phi over the largest fall, worst of all colours",
    unit="J",
    kind=Kind.IDENTITY,
    formula="phi(before) - phi(after) = w (2 - w) / 2 sum over the colour of g_i . H_i^-1 g_i > 0 for 0 < w < 2",
    source="phi is quadratic in each vertex; phi, g and H by scikit-fem, H of the state at the start",
    tolerance=1e-9,
    reason="rounding of phi, which is summed over all elements, against the fall by one colour",
    over={"mesh": ("box", "rabbit"), "w": (1.0, 0.7, 1.6)},
    quick={"mesh": ("box",), "w": (1.0,)},
    requires="scikit-fem",
)
def fall(use: Use, *, mesh: str, w: float) -> Measurement:
    """The first colour of a sweep, whose blocks are known from the start, and that no other raises phi."""
    one, found, scale = assembled(body(mesh), "random"), {}, 0.0
    value = one.value(one.x)
    for colour, vertices, before, _, x in _sweep(one.disc, "random", w):
        now = one.value(x)
        if colour == 0:
            H = diagonal_blocks(one.A)[vertices]
            g = before[vertices]
            expected = 0.5 * w * (2.0 - w) * float((g * np.linalg.solve(H, g[:, :, None])[:, :, 0]).sum())
            found["colour 0"] = compare(value - now, expected)
            scale = expected
        found[f"rise in colour {colour}"] = vanishes(max(now - value, 0.0), scale)
        value = now
    return worst(found)


@case(
    "descent/matrix-sweep",
    title="Sweeps on an assembled matrix are those of dense block Jacobi and coloured block Gauss-Seidel",
    quantity="largest difference of a displacement after three sweeps over the largest displacement",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="d += w D^-1 (b - A d); the blocks of D alone, or D and all blocks whose column has an earlier colour",
    source="A and b by scikit-fem at rest, where the definite part is all of it; colours of the production code",
    tolerance=1e-10,
    reason="rounding of sums over elements",
    over={"solver": ("jacobi-explicit", "vbd-explicit"), "mesh": ("box", "rabbit")},
    quick={"mesh": ("box",)},
    requires="scikit-fem",
)
def matrix_sweep(use: Use, *, solver: str, mesh: str) -> Measurement:
    """Three sweeps on one system, of a body at rest that is predicted elsewhere."""
    one = assembled(body(mesh), "rest")
    phi = IncrementalPotential(use.backend(one.disc), one.xhat, one.inverse_h2**-0.5)
    made = ExplicitVBD(phi.backend) if solver == "vbd-explicit" else ExplicitJacobi(phi.backend)
    w = 1.0 if isinstance(made, ExplicitVBD) else float(step_lengths("spectral", phi, (phi.backend.vertices,))[0])
    at = np.repeat(one.disc.free, 3)
    A, b = one.A[at][:, at].toarray(), -one.g.ravel()[at]
    M, d = _splitting(one.disc, A, ordered=isinstance(made, ExplicitVBD)), np.zeros(int(at.sum()))
    for _ in range(3):
        d += w * np.linalg.solve(M, b - A @ d)
    return compare(_swept(made, phi, one.x, w, 3).ravel()[at], d)


@cache
def _sweep(disc: Discretisation, state: str, w: float) -> tuple[tuple[int, NDArray, Floats, Floats, Floats], ...]:
    """Of each colour its number, its vertices, grad phi before and after it has moved, and the positions then."""
    one, colouring = assembled(disc, state), colour_vertices(disc)
    stars, x, steps = build_stars(disc, colouring.vertex), one.x.copy(), []
    dx, before = np.zeros((len(colouring.vertex), 3)), one.g
    for colour, (first, count) in enumerate(colouring.ranges):
        tail = (disc.mass, one.inverse_h2, one.xhat, w, x, dx)
        Workers(1).run(descend, count, first, *stars.arrays, *tail)
        after = one.gradient_at(x)
        steps.append((colour, colouring.vertex[first : first + count], before, after, x.copy()))
        before = after
    return tuple(steps)


def _splitting(disc: Discretisation, A: Floats, *, ordered: bool) -> Floats:
    """Blocks on the diagonal of A, and with `ordered` those whose column is of an earlier colour than their row."""
    colouring = colour_vertices(disc)
    colour = np.empty(disc.n_vertices, int)
    colour[colouring.vertex] = np.repeat(np.arange(colouring.n_colours), np.diff(colouring.ptr))
    c, vertex = np.repeat(colour[disc.free], 3), np.repeat(np.arange(int(disc.free.sum())), 3)
    kept = vertex[:, None] == vertex
    return A * (kept | (c[:, None] > c) if ordered else kept)


def _swept(made: Linearised, phi: IncrementalPotential, x: Floats, w: float, sweeps: int) -> Floats:
    """Displacement [m] after so many sweeps on the system at x, shape [n, 3]."""
    if isinstance(made, ExplicitJacobi):
        made._w = w
    made.linearise(phi, x)
    backend = phi.backend
    d = np.zeros((backend.vertices.n_nodes, 3))
    for _ in range(sweeps):
        d = d + made.sweep(d.copy())
    out = np.zeros_like(x)
    backend.prolong(backend.vertices, d, out)
    return out
