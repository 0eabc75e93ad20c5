# SPDX-License-Identifier: BSD-3-Clause
"""Coarse spaces of affine handles: piecewise-constant weights in skinning-space coordinates (Xian et al. 2019).

A handle moves all the vertices of its cluster by one affine map of their rest positions,

    u_v = T [X_v; 1],    T of shape [3, 4]: 12 unknowns per handle,

and a handle of a coarser level moves all handles of its cluster by one affine map again. Affine maps of affine maps are
affine, so each level has 12 unknowns per cluster and its matrix couples clusters that touch.

Chosen here: within every cluster the four coordinates [X_v; 1] are replaced by an orthonormal basis q of what they span
on it, which changes no space but keeps the diagonal blocks well conditioned. Where a cluster lies in a plane or on a
line, the basis has fewer functions, and columns of zeros in place of the others. Clusters come from Lloyd's iteration
on the mesh (`femgal.hierarchy.clusters`); a cluster belongs to that of the coarser level in which most of its vertices
lie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from femgal.discretisation import Discretisation
from femgal.hierarchy.clusters import cluster_vertices

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Functions per handle: three coordinates and one.
FUNCTIONS = 4


@dataclass(frozen=True, eq=False)
class Handles:
    """Nodes of one level in clusters, and how the clusters move them; k nodes with a functions each, c clusters.

    Parameters
    ----------
    label : Cluster of each node, shape [k].
    q : Basis functions of the cluster at the functions of each node, shape [k, a, 4]: the displacements of the node
        are sum_j q[:, j] (x) those of the cluster.
    child_ptr, child : Nodes of each cluster, ascending.
    """

    label: Ints
    q: Floats
    child_ptr: Longs
    child: Ints

    @property
    def n_clusters(self) -> int:
        """Number of clusters."""
        return len(self.child_ptr) - 1

    def unused(self) -> NDArray[np.bool_]:
        """Functions that are zero on the whole cluster, shape [c, 4]."""
        size = np.add.reduceat(np.abs(self.q).sum(axis=1)[self.child], self.child_ptr[:-1])
        return size == 0.0


def build_handles(disc: Discretisation, cluster: int, ratio: int, bottom: int) -> tuple[Handles, ...]:
    """Clusters of about `cluster` free vertices, clusters of `ratio` of these, and so on; finest first.

    Parameters
    ----------
    bottom : No coarser level than the first with at most so many clusters.
    """
    X, tets, free = disc.mesh.points, disc.mesh.cells, disc.free
    functions = _coordinates(X[free])[:, None, :]
    levels: list[Handles] = []
    # Cluster of each free vertex on the level before: its own.
    node = np.arange(int(free.sum()), dtype=np.int64)
    size = cluster
    while not levels or levels[-1].n_clusters > bottom:
        wanted = cluster_vertices(X, tets, free, size)[0][free]
        label = _majority(node, wanted)
        if levels and label.max() + 1 == levels[-1].n_clusters:
            # As many bodies as clusters.
            break
        q, functions = _orthonormal(label, functions)
        levels.append(Handles(label, q, *_children(label)))
        node, size = label.astype(np.int64)[node], size * ratio
    return tuple(levels)


def _coordinates(X: Floats) -> Floats:
    """[1; X_v] about the middle of the bodies and in units of their size, shape [k, 4]."""
    Y = X - X.mean(axis=0)
    return np.column_stack([np.ones(len(Y)), Y / max(float(np.abs(Y).max(initial=0.0)), 1e-300)])


def _majority(node: Longs, wanted: Ints) -> Ints:
    """For each node the label that most of its vertices want, numbered without gaps."""
    shape = (int(node.max()) + 1, int(wanted.max()) + 1)
    votes = sparse.coo_matrix((np.ones(len(node)), (node, wanted)), shape=shape).tocsr()
    chosen = np.asarray(votes.argmax(axis=1)).ravel()
    return np.unique(chosen, return_inverse=True)[1].reshape(-1).astype(np.int32)


def _children(label: Ints) -> tuple[Longs, Ints]:
    ptr = np.zeros(int(label.max()) + 2, np.int64)
    np.cumsum(np.bincount(label), out=ptr[1:])
    return ptr, np.argsort(label, kind="stable").astype(np.int32)


def _orthonormal(label: Ints, functions: Floats) -> tuple[Floats, Floats]:
    """Orthonormal basis on each cluster, shape [k, a, 4], and the functions in it, shape [c, 4, 4].

    Parameters
    ----------
    functions : Values at the nodes, shape [k, a, 4].
    """
    from pyamg.aggregation.tentative import fit_candidates

    k, a, _ = functions.shape
    belongs = sparse.csr_matrix((np.ones(k), label, np.arange(k + 1)))
    Q, R = fit_candidates(belongs, functions.reshape(k * a, FUNCTIONS))
    Q.sort_indices()
    return np.ascontiguousarray(Q.data), R.reshape(-1, FUNCTIONS, FUNCTIONS)
