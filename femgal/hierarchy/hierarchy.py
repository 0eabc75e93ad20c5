# SPDX-License-Identifier: BSD-3-Clause
"""The layers of a multigrid solver, finest first, and how many a mesh deserves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy import LINEAR_RATIO
from femgal.hierarchy.clusters import cluster_vertices
from femgal.hierarchy.lattice import lattice_nodes
from femgal.hierarchy.layer import Layer, build_layer, finest_layer
from meshes.connectivity import cell_edges, component_labels

Transfer = Literal["constant", "linear"]

# A choice: the prediction has the motion of the whole body right, and so nearly that of a few parts.
FEWEST_NODES = 4

# A layer with more nodes than this share of those of the finer one is the finer one over again: many bodies, each too
# small to be divided by the ratio.
LARGEST_SHARE = 0.7

# Cubes of the first lattice in mean edges, which makes one node of 8 to 16 vertices. One cycle over all layers gains
# within a factor of 2.5 the same from 1.9 to 3.2 mean edges; wider lattices meet fewer nodes per element (bunny, 6,700
# vertices).
FIRST_SPACING = 2.5


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Layers, finest first; ``print(hierarchy)`` is a table.

    Parameters
    ----------
    layers : layers[0] has the free vertices as nodes; each other one is built independently from the finest mesh.
    ratio : Vertices per node from one layer to the next.
    n_tets : Tetrahedra of the finest mesh.
    connected : For each layer, whether the vertices of every node form one connected set; lattices are made so.
    transfer : How a coarse layer moves a vertex: "constant" with one node, "linear" with those of a coarse tetrahedron.
    """

    layers: tuple[Layer, ...]
    ratio: int
    n_tets: int
    connected: tuple[bool, ...]
    transfer: Transfer = "constant"

    @property
    def complexity(self) -> float:
        """(element, node) pairs of all layers over those of the finest: work of one pass over all layers."""
        return sum(layer.n_pairs for layer in self.layers) / max(1, self.layers[0].n_pairs)

    def rows(self) -> list[tuple[str, ...]]:
        """One row per layer: name, nodes, vertices per node, connected, active elements, share, pairs."""
        rows: list[tuple[str, ...]] = []
        for number, (layer, connected) in enumerate(zip(self.layers, self.connected, strict=True)):
            sizes = layer.sizes
            rows.append(
                (
                    f"{number} {layer.name}",
                    f"{layer.n_nodes}",
                    f"{sizes.min()} / {sizes.mean():.1f} / {sizes.max()}",
                    "yes" if connected else "no",
                    f"{len(layer.active)}",
                    f"{len(layer.active) / self.n_tets:.3f}",
                    f"{layer.n_pairs}",
                )
            )
        return rows

    def __str__(self) -> str:
        header = ("layer", "nodes", "vertices min / mean / max", "connected", "active tets", "share", "pairs")
        table = [header, *self.rows()]
        widths = [max(len(row[k]) for row in table) for k in range(len(header))]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in table]
        summary = f"{self.transfer} transfer, ratio {self.ratio}, complexity {self.complexity:.3f}"
        return "\n".join([*(line.rstrip() for line in lines), summary])


def coarse_sizes(n_free: int, ratio: int, layers: int | Literal["full"]) -> list[int]:
    """Vertices per cluster of each coarse layer that the mesh can use: ratio, ratio^2, ...

    Layers that would have fewer than FEWEST_NODES nodes are left out even when asked for.
    """
    sizes: list[int] = []
    while (layers == "full" or len(sizes) < layers) and n_free // ratio ** (len(sizes) + 1) >= FEWEST_NODES:
        sizes.append(ratio ** (len(sizes) + 1))
    return sizes


def build_constant_hierarchy(
    disc: Discretisation, ratio: int = 32, layers: int | Literal["full"] = "full"
) -> Hierarchy:
    """Piecewise-constant hierarchy of Lu et al. 2025, section 5.1.1.

    Parameters
    ----------
    disc : The discretised bodies.
    ratio : Clusters of layer l hold about ratio^l vertices.
    layers : Number of coarse layers, or "full" for as many as the mesh can use.
    """
    built = [finest_layer(disc)]
    for size in coarse_sizes(built[0].n_nodes, ratio, layers):
        label, n_clusters = cluster_vertices(disc.mesh.points, disc.mesh.cells, disc.free, size)
        if n_clusters > LARGEST_SHARE * built[-1].n_nodes:
            break
        weight = np.ones((disc.n_vertices, 1))
        built.append(build_layer(disc, label[:, None].copy(), weight, n_clusters, f"clusters of {size}"))
    connected = tuple(_connected(disc, layer) for layer in built)
    return Hierarchy(tuple(built), ratio, disc.n_tets, connected)


def build_linear_hierarchy(disc: Discretisation, layers: int | Literal["full"] = "full") -> Hierarchy:
    """Piecewise-linear hierarchy of Lu et al. 2025, section 5.1.2: lattices of tetrahedra, each twice as wide.

    Parameters
    ----------
    disc : The discretised bodies.
    layers : Number of coarse layers, or "full" for as many as the mesh can use.
    """
    X, free = disc.mesh.points, disc.free
    edges = cell_edges(disc.mesh.cells, disc.n_vertices)
    mean, longest = _edge_lengths(disc, edges)
    built = [finest_layer(disc)]
    wanted = len(coarse_sizes(built[0].n_nodes, LINEAR_RATIO, layers))
    spacing = FIRST_SPACING * mean
    while len(built) <= wanted:
        nodes = lattice_nodes(X, free, edges, spacing)
        n_nodes = len(nodes.position)
        if n_nodes <= LARGEST_SHARE * built[-1].n_nodes:
            built.append(build_layer(disc, nodes.parent, nodes.weight, n_nodes, f"lattice of {spacing:.3g} m"))
        elif spacing > FIRST_SPACING * longest:
            break
        # Where the mesh is coarser than elsewhere, the lattice may still be too fine to join its vertices.
        spacing *= 2.0
    return Hierarchy(tuple(built), LINEAR_RATIO, disc.n_tets, (True,) * len(built), "linear")


def _edge_lengths(disc: Discretisation, edges: NDArray[np.int32]) -> tuple[float, float]:
    """Mean and largest length of the edges that a free vertex has [m]."""
    i, j = edges[disc.free[edges].any(axis=1)].T
    lengths = np.linalg.norm(disc.mesh.points[i] - disc.mesh.points[j], axis=1)
    return float(lengths.mean()), float(lengths.max())


def _connected(disc: Discretisation, layer: Layer) -> bool:
    """Whether the vertices of each node hang together, where a vertex has one node at most."""
    roots = component_labels(disc.mesh.cells, layer.parent[:, 0].copy())[layer.child]
    first = np.repeat(roots[layer.child_ptr[:-1]], layer.sizes)
    return bool((roots == first).all())
