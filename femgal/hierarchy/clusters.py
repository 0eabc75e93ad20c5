# SPDX-License-Identifier: BSD-3-Clause
"""Connected clusters of nearly equal size: the nodes of a piecewise-constant layer (Lu et al. 2025, section 5.1.1).

Lloyd's iteration on the vertex graph: a cluster is the set of vertices whose shortest path along edges leads to the
same seed, so it is connected; then each seed moves to the vertex nearest to its cluster's centroid. Seeds are added in
clusters that grew too large and taken from those that stayed too small. The graph holds the free vertices only, so a
cluster never reaches across a fixed region, and each connected part of the body has at least one cluster.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.connectivity import component_labels, vertex_cells
from meshes.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# More sweeps change the share of elements that cross clusters of 8 or 32 vertices by less than one in a thousand, of
# 1024 by 0.4 of a hundred (bunny, 20,000 vertices).
SWEEPS = 5


def cluster_vertices(X: Floats, tets: Ints, free: NDArray[np.bool_], size: int) -> tuple[Ints, int]:
    """Cluster the free vertices into connected sets of about `size` vertices.

    Parameters
    ----------
    X : Rest positions [m], shape [n, 3], numbered so that neighbours are close (Morton order): seeds start evenly
        spaced along the numbering.
    tets : Shape [m, 4].
    free : Vertices to cluster, shape [n].
    size : Vertices per cluster aimed at, >= 1.

    Returns
    -------
    label : Cluster of each vertex, -1 where not free, shape [n].
    n_clusters : Number of clusters.
    """
    around = vertex_cells(tets, len(X))
    candidates = np.flatnonzero(free)
    # The lowest vertex of each connected part of the free vertices is the seed of a part that has no other.
    part = component_labels(tets, np.where(free, 0, -1).astype(np.int32))
    parts = np.unique(part[candidates])
    n_seeds = max(1, round(len(candidates) / size))
    seeds = candidates[((np.arange(n_seeds) + 0.5) * len(candidates) / n_seeds).astype(np.int64)]
    label, distance = np.empty(len(X), np.int32), np.empty(len(X))
    for sweep in range(SWEEPS):
        seeds = np.union1d(seeds, np.setdiff1d(parts, part[seeds]))
        label[:], distance[:] = -1, np.inf
        _spread(X, tets, free, *around, seeds, label, distance)
        if sweep < SWEEPS - 1:
            seeds = _recentre(X, label, distance, len(seeds), size)
    return label, len(seeds)


@kernel
def _spread(
    X: Floats,
    tets: Ints,
    free: NDArray[np.bool_],
    ptr: Longs,
    incident: Ints,
    seeds: Longs,
    label: Ints,
    distance: Floats,
) -> None:
    """Shortest paths from all seeds at once: a queue that takes a vertex again when its distance shrinks."""
    n = len(X)
    # One place more than there are vertices, so that a full ring never looks empty.
    queue = np.empty(n + 1, np.int64)
    waiting = np.zeros(n, np.bool_)
    head = tail = 0
    for s in range(len(seeds)):
        v = seeds[s]
        label[v], distance[v] = s, 0.0
        waiting[v] = True
        queue[tail] = v
        tail += 1
    while head != tail:
        v = queue[head]
        head = head + 1 if head < n else 0
        waiting[v] = False
        for j in range(ptr[v], ptr[v + 1]):
            for k in range(4):
                w = tets[incident[j], k]
                if not free[w]:
                    continue
                d0, d1, d2 = X[w, 0] - X[v, 0], X[w, 1] - X[v, 1], X[w, 2] - X[v, 2]
                d = distance[v] + np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
                if d < distance[w]:
                    distance[w], label[w] = d, label[v]
                    if not waiting[w]:
                        waiting[w] = True
                        queue[tail] = w
                        tail = tail + 1 if tail < n else 0


def _recentre(X: Floats, label: Ints, distance: Floats, n: int, size: int) -> Longs:
    """Next seeds: the vertices nearest to the centroids; large clusters also send their farthest vertex, small none."""
    centre, farthest, count = np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(n, np.int64)
    _centres(X, label, distance, centre, farthest, count)
    keep = count > 0.3 * size
    if not keep.any():
        keep[np.argmax(count)] = True
    # In a ring the two can be the same vertex; sorted, clusters that are close have close numbers.
    return np.union1d(centre[keep], farthest[count > 1.7 * size])


@kernel
def _centres(X: Floats, label: Ints, distance: Floats, centre: Longs, farthest: Longs, count: Longs) -> None:
    n = len(centre)
    centroid = np.zeros((n, 3))
    for v in range(len(X)):
        c = label[v]
        if c >= 0:
            count[c] += 1
            for d in range(3):
                centroid[c, d] += X[v, d]
    nearest, most = np.full(n, np.inf), np.full(n, -1.0)
    for v in range(len(X)):
        c = label[v]
        if c < 0:
            continue
        r = 0.0
        for d in range(3):
            r += (X[v, d] - centroid[c, d] / count[c]) ** 2
        if r < nearest[c]:
            nearest[c], centre[c] = r, v
        if distance[v] > most[c]:
            most[c], farthest[c] = distance[v], v
