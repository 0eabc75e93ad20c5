# SPDX-License-Identifier: BSD-3-Clause
"""The part of a CPU backend that needs no element: block solves, transfer, sums over vertices. Always in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, finest_layer
from femgal.kernels.backend import Passes
from femgal.kernels.cpu import nodes
from femgal.kernels.cpu.threads import Workers

Floats = NDArray[np.float64]


class NodeWork:
    """What all CPU backends share; the methods are those of `femgal.kernels.backend.Backend`.

    Parameters
    ----------
    disc : The discretised bodies.
    threads : Number of threads; None takes the processors that this process may use. Never changes a bit.
    finest : The finest layer, when it has been built already.
    """

    def __init__(self, disc: Discretisation, threads: int | None = None, finest: Layer | None = None) -> None:
        self.disc = disc
        self.vertices = finest or finest_layer(disc)
        self.passes = Passes()
        self.workers = Workers(threads)

    @property
    def threads(self) -> int:
        """CPU threads that share the work."""
        return self.workers.threads

    def solve(self, g: Floats, H: Floats, w: float, *, scalar: bool = False) -> Floats:
        """-w H^-1 g block by block [m]; with the diagonal of each block only when `scalar`."""
        dx = np.empty_like(g)
        self.workers.run(nodes.solve, len(g), w, scalar, g, H, dx)
        return dx

    def compare_blocks(self, g: Floats, old: Floats, H: Floats, *, scalar: bool = False) -> tuple[float, float]:
        """(dx' - dx) . H (dx' - dx) [J] of the corrections that old and new blocks make, and their largest change."""
        n_chunks = -(-len(g) // nodes.CHUNK)
        stale, change = np.empty(n_chunks), np.empty(n_chunks)
        self.workers.run(nodes.compare_blocks, n_chunks, scalar, g, old, H, stale, change, smallest_share=1)
        return float(stale.sum()), float(change.max(initial=0.0))

    def prolong(self, layer: Layer, dx: Floats, x: Floats) -> None:
        """x += P dx in place."""
        self.workers.run(nodes.prolong, self.disc.n_vertices, layer.parent, layer.weight, dx, x)

    def restrict(self, layer: Layer, f: Floats) -> Floats:
        """P^T f, shape [n_nodes, 3]."""
        out = np.empty((layer.n_nodes, 3))
        children = (layer.child_ptr, layer.child, layer.child_weight)
        self.workers.run_ragged(nodes.restrict, layer.child_ptr, *children, f, out)
        return out

    def inertia_along(self, x: Floats, xhat: Floats, d: Floats, inverse_h2: float) -> Floats:
        """Coefficients of t and t^2 in |x + t d - xhat|^2_M inverse_h2 / 2 [J], shape [2]."""
        partial = np.empty((-(-len(x) // nodes.CHUNK), 2))
        self.workers.run(
            nodes.inertia_along, len(partial), self.disc.mass, x, xhat, d, inverse_h2, partial, smallest_share=1
        )
        return partial.sum(axis=0)

    def add_scaled(self, x: Floats, t: float, d: Floats) -> None:
        """x += t d in place."""
        self.workers.run(nodes.add_scaled, len(x), x, t, d)

    def difference(self, x: Floats, y: Floats, scale: float = 1.0) -> Floats:
        """scale (x - y), shape [n, 3]."""
        out = np.empty_like(x)
        self.workers.run(nodes.difference, len(x), scale, x, y, out)
        return out

    def predict(self, x: Floats, v: Floats, h: float, gravity: Floats, inertia: float = 1.0) -> Floats:
        """x + (h v + h^2 g) / inertia [m], shape [n, 3]."""
        xhat = np.empty_like(x)
        self.workers.run(nodes.predict, len(x), x, v, h, gravity, inertia, xhat)
        return xhat

    def dot(self, a: Floats, b: Floats) -> float:
        """Sum of a * b over arrays of shape [k, 3]."""
        partial = np.empty(-(-len(a) // nodes.CHUNK))
        self.workers.run(nodes.dot, len(partial), a, b, partial, smallest_share=1)
        return float(partial.sum())

    def largest(self, dx: Floats) -> float:
        """Largest |component| of an array of shape [k, 3]; NaN when one of them is not finite."""
        partial = np.empty(-(-len(dx) // nodes.CHUNK))
        self.workers.run(nodes.largest, len(partial), dx, partial, smallest_share=1)
        return float(partial.max(initial=0.0))

    def _pass_share(self, layer: Layer) -> float:
        """A pass over a layer in units of one over the finest."""
        return layer.n_pairs / max(1, self.vertices.n_pairs)

    def _at_free_vertices(self, rows: Floats) -> Floats:
        """Spread rows of the finest layer over all vertices, zero at constrained ones; shape [n, 3]."""
        if len(rows) == self.disc.n_vertices:
            return rows
        out = np.zeros((self.disc.n_vertices, 3))
        out[self.disc.free] = rows
        return out
