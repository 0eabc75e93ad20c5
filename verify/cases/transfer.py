# SPDX-License-Identifier: BSD-3-Clause
"""Prolongation and restriction of every coarse layer: what they must leave alone, and what they must reproduce."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.hierarchy.lattice import LatticeNodes, lattice_nodes
from femgal.hierarchy.layer import Layer, build_layer
from meshes.connectivity import cell_edges
from verify.problems.bodies import OWN, body, is_own, mean_edge
from verify.reference.transfer import prolongation
from verify.suite.case import Kind, Measurement, Skip, case
from verify.suite.measure import compare, vanishes
from verify.suite.use import Use

Floats = NDArray[np.float64]

HIERARCHIES = ("constant-8", "constant-32", "linear")
_LU = "Lu et al. 2025, sections 5.1.1 and 5.1.2"
_OVER = {"mesh": ("rabbit", "slivers"), "hierarchy": HIERARCHIES}
_QUICK = {"mesh": ("rabbit", OWN)}


@cache
def coarse_layers(disc: Discretisation, hierarchy: str) -> tuple[Layer, ...]:
    """Layers of a hierarchy but the finest; "constant-8", "constant-32" or "linear".

    Raises
    ------
    Skip
        The user's own mesh is too small for one.
    """
    kind, _, ratio = hierarchy.partition("-")
    built = build_constant_hierarchy(disc, int(ratio)) if kind == "constant" else build_linear_hierarchy(disc)
    if len(built.layers) < 2:
        if is_own(disc):
            raise Skip("the mesh is too small for a coarse layer")
        raise AssertionError("no coarse layer was made of a mesh that is large enough")
    return built.layers[1:]


def prolonged(use: Use, disc: Discretisation, layer: Layer, dx: Floats) -> Floats:
    """P dx by production [m], shape [n, 3]."""
    moved = np.zeros((disc.n_vertices, 3))
    use.backend(disc).prolong(layer, dx, moved)
    return moved


@case(
    "transfer/translation",
    title="When all nodes of a layer move alike, so do all free vertices",
    quantity="largest difference from the motion of the nodes, all coarse layers",
    unit="1",
    kind=Kind.IDENTITY,
    formula="P 1 = 1 at free vertices: the weights of a vertex sum to one",
    source=_LU,
    tolerance=1e-15,
    reason="rounding of four weights",
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def translation(use: Use, *, mesh: str, hierarchy: str) -> Measurement:
    """Partition of unity."""
    disc = body(mesh)
    moved = [prolonged(use, disc, layer, np.ones((layer.n_nodes, 3))) for layer in coarse_layers(disc, hierarchy)]
    return compare(np.stack(moved)[:, disc.free], np.ones((len(moved), int(disc.free.sum()), 3)))


@case(
    "transfer/fixed-vertices",
    title="No motion of the nodes moves a fixed vertex",
    quantity="largest motion of a fixed vertex, nodes moving at random, all coarse layers",
    unit="1",
    kind=Kind.IDENTITY,
    formula="fixed vertices belong to no node",
    source=_LU,
    tolerance=0.0,
    reason="nothing is added at all",
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def fixed_vertices(use: Use, *, mesh: str, hierarchy: str) -> Measurement:
    """Rows of P at constrained vertices."""
    disc = body(mesh)
    if mesh == OWN and disc.free.all():
        raise Skip("no vertex is fixed")
    moved = [
        prolonged(use, disc, layer, use.rng(601).standard_normal((layer.n_nodes, 3)))
        for layer in coarse_layers(disc, hierarchy)
    ]
    return vanishes(np.stack(moved)[:, ~disc.free], 1.0)


@case(
    "transfer/transpose",
    title="Restriction is the transpose of prolongation",
    quantity="largest |f . P dx - P^T f . dx| of a layer, over the sum of the sizes of its products",
    unit="1",
    kind=Kind.IDENTITY,
    formula="f . (P dx) = (P^T f) . dx for all f and dx",
    source="definition of the transpose; " + _LU,
    tolerance=1e-15,
    reason="machine epsilon times a few: sums of products of mixed sign",
    over=_OVER,
    quick=_QUICK,
    own_mesh=True,
)
def transpose(use: Use, *, mesh: str, hierarchy: str) -> Measurement:
    """Inner products with random vectors."""
    disc, random = body(mesh), use.rng(602)
    f = random.standard_normal((disc.n_vertices, 3))
    differences = []
    for layer in coarse_layers(disc, hierarchy):
        dx = random.standard_normal((layer.n_nodes, 3))
        fine = f * prolonged(use, disc, layer, dx)
        coarse = use.backend(disc).restrict(layer, f) * dx
        differences.append((fine.sum() - coarse.sum()) / np.abs(fine).sum())
    return vanishes(differences, 1.0)


@case(
    "transfer/assembled",
    title="Prolongation and restriction are those of the assembled sparse matrix",
    quantity="largest difference of P dx and of P^T f, over the sum of the sizes of their terms",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="P assembled from the parents and weights of each vertex, not from the children of each node",
    source="verify/reference/transfer.py",
    tolerance=1e-15,
    reason="machine epsilon times a few",
    over=_OVER,
    quick=_QUICK,
    requires="SciPy",
    own_mesh=True,
)
def assembled(use: Use, *, mesh: str, hierarchy: str) -> Measurement:
    """Both products with random vectors."""
    disc, random = body(mesh), use.rng(603)
    f = random.standard_normal((disc.n_vertices, 3))
    differences = []
    for layer in coarse_layers(disc, hierarchy):
        P, dx = prolongation(layer), random.standard_normal((layer.n_nodes, 3))
        fine = prolonged(use, disc, layer, dx).ravel() - P @ dx.ravel()
        coarse = use.backend(disc).restrict(layer, f).ravel() - P.T @ f.ravel()
        # Rows of fixed vertices are empty, and so is their difference.
        differences += [fine / np.maximum(P @ np.abs(dx.ravel()), 1e-300), coarse / (P.T @ np.abs(f.ravel()))]
    return vanishes(np.concatenate(differences), 1.0)


@case(
    "transfer/connected-nodes",
    title="The vertices that a node moves hang together",
    quantity="connected parts of the supports of all nodes",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="one part per node, in the graph of the edges of the mesh restricted to the node's vertices",
    source="connected components by SciPy; " + _LU,
    tolerance=0.0,
    reason="a count",
    over=_OVER,
    quick=_QUICK,
    requires="SciPy",
    own_mesh=True,
)
def connected_nodes(use: Use, *, mesh: str, hierarchy: str) -> Measurement:
    """Parts of the supports of all coarse layers."""
    disc = body(mesh)
    layers = coarse_layers(disc, hierarchy)
    return compare(sum(support_parts(disc, one) for one in layers), sum(one.n_nodes for one in layers), 1.0)


def support_parts(disc: Discretisation, layer: Layer) -> int:
    """Connected parts of the vertices of each node, added up."""
    i, j = cell_edges(disc.mesh.cells, disc.n_vertices).T
    graph = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(disc.n_vertices, disc.n_vertices))
    supports = np.split(layer.child, layer.child_ptr[1:-1])
    return sum(int(connected_components(graph[one][:, one], directed=False)[0]) for one in supports)


@case(
    "transfer/linear-fields",
    title="Where the lattice covers a vertex with all its nodes, linear fields are reproduced",
    quantity="largest difference from the linear field, over its largest value",
    unit="1",
    kind=Kind.IDENTITY,
    formula="P (a + A y) = a + A X with y the positions of the nodes, except where a point carries less than a vertex",
    source="barycentric coordinates; Lu et al. 2025, section 5.1.2",
    tolerance=2e-15,
    reason="rounding of positions and of four weights",
    over={"mesh": ("rabbit", "box", "slivers"), "spacing": (2.5, 5.0)},
    quick=_QUICK,
    own_mesh=True,
)
def linear_fields(use: Use, *, mesh: str, spacing: float) -> Measurement:
    """A random linear field at the interior vertices of a lattice of that many mean edges."""
    disc = body(mesh)
    h = spacing * mean_edge(disc.mesh)
    lattice, expected = nodes_of(disc, h), barycentric(disc, h)
    complete = (lattice.parent >= 0).sum(axis=1) == (expected.weight > 0.0).sum(axis=1)
    interior = disc.free & complete
    if mesh == OWN and not interior.any():
        raise Skip("no vertex has all its lattice points: the mesh is too small")
    A, (a, *_) = use.rng(604).standard_normal((2, 3, 3))
    layer = build_layer(disc, lattice.parent, lattice.weight, len(lattice.position), "lattice")
    moved = prolonged(use, disc, layer, lattice.position @ A.T + a)
    note = f"{interior.sum()} of {disc.free.sum()} free vertices are interior"
    field = disc.mesh.points @ A.T + a
    return compare(moved[interior], field[interior], note=note)


@case(
    "transfer/lattice-weights",
    title="Weights of the linear layer are barycentric coordinates in the body-centred cubic lattice",
    quantity="largest difference of a weight, at each vertex with the share of nodes that were left out taken off",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="the tetrahedra of the lattice are the Delaunay tetrahedra of its points",
    source="Delaunay triangulation by Qhull (SciPy); Labelle & Shewchuk 2007, section 3",
    tolerance=1e-13,
    reason="machine epsilon times the size of the body in cubes, and Qhull's planes",
    over={"mesh": ("rabbit", "box", "slivers"), "spacing": (2.5,)},
    quick=_QUICK,
    requires="SciPy",
    own_mesh=True,
)
def lattice_weights(use: Use, *, mesh: str, spacing: float) -> Measurement:
    """Weights before any is left out, where none is."""
    disc = body(mesh)
    h = spacing * mean_edge(disc.mesh)
    lattice, expected = nodes_of(disc, h), barycentric(disc, h)
    y = lattice.position[lattice.parent]
    same = np.abs(y[:, :, None] - expected.corner[:, None]).max(axis=3) <= 1e-6 * h
    weight = np.where(lattice.parent >= 0, (same * expected.weight[:, None]).sum(axis=2), 0.0)
    # What remains where a node was left out is scaled to sum to one.
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    return compare(lattice.weight[disc.free], weight[disc.free], 1.0)


@dataclass(frozen=True, eq=False)
class Barycentric:
    """Lattice points around each vertex, shape [n, 4, 3], and barycentric coordinates, shape [n, 4]."""

    corner: Floats
    weight: Floats


@cache
def barycentric(disc: Discretisation, spacing: float) -> Barycentric:
    """Delaunay tetrahedra of the body-centred cubic points that the vertices lie in; coordinates of 1e-9 are zero.

    Points of the lattice near the vertices are enough: a tetrahedron of the lattice whose corners are there is one of
    their triangulation.
    """
    X = disc.mesh.points
    origin = 0.5 * (X.min(axis=0) + X.max(axis=0))
    cubes = np.unique(np.floor((X - origin) / spacing), axis=0)
    near = np.stack(np.meshgrid(*[np.arange(-1.0, 3.0)] * 3), axis=-1).reshape(-1, 3)
    corners = np.unique((cubes[:, None] + near).reshape(-1, 3), axis=0)
    points = np.concatenate([corners, corners + 0.5])
    delaunay = Delaunay(points)
    y = (X - origin) / spacing
    cell = delaunay.find_simplex(y)
    transform = delaunay.transform[cell]
    three = np.einsum("vij,vj->vi", transform[:, :3], y - transform[:, 3])
    weight = np.concatenate([three, 1.0 - three.sum(axis=1, keepdims=True)], axis=1)
    weight[weight <= 1e-9] = 0.0
    return Barycentric(origin + spacing * points[delaunay.simplices[cell]], weight)


@cache
def nodes_of(disc: Discretisation, spacing: float) -> LatticeNodes:
    """Nodes of production's lattice of that spacing [m]."""
    edges = cell_edges(disc.mesh.cells, disc.n_vertices)
    return lattice_nodes(disc.mesh.points, disc.free, edges, spacing)
