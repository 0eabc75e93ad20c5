# SPDX-License-Identifier: BSD-3-Clause
"""The part of a CPU backend that needs no element: block solves, transfer, sums over vertices. Always in float64."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, finest_layer
from femgal.kernels.backend import Passes, Prescribed
from femgal.kernels.cpu import motion, nodes
from femgal.kernels.cpu.threads import Workers

if TYPE_CHECKING:
    from femgal.gauss_seidel.stars import Stars

Floats = NDArray[np.float64]

# Vertices of a colour per thread: one takes about a microsecond, handing a range to a thread twenty.
SMALLEST_COLOUR = 128


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

    def to_device(self, values: Floats) -> Floats:
        """The array itself."""
        return values

    def to_host(self, values: NDArray) -> NDArray:
        """The array itself."""
        return values

    @property
    def runs_ahead(self) -> bool:
        """What is asked for has been done when the call returns."""
        return False

    def fetch(self, values: Floats) -> Callable[[], NDArray]:
        """The array itself."""
        return lambda: values

    def rows(self, x: Floats, vertices: NDArray[np.int64]) -> Floats:
        """The rows of an array at some vertices, shape [k, 3]."""
        return x[vertices]

    def copy(self, x: Floats) -> Floats:
        """A copy that belongs to the caller."""
        return x.copy()

    def zeros(self, rows: int) -> Floats:
        """Zeros of shape [rows, 3]."""
        return np.zeros((rows, 3))

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        """Elastic Hessian at x, or its definite part, times d at the free vertices [N], zero at constrained ones."""
        raise NotImplementedError

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

    def kick_drift(self, x: Floats, v: Floats, a: Floats, h: float, decay: float) -> tuple[Floats, Floats]:
        """Positions x + h v' and velocities v' = decay v + h/2 a."""
        x_out, v_out = np.empty_like(x), np.empty_like(v)
        before = (x.ravel(), v.ravel(), a.ravel())
        self.workers.run(motion.kick_drift, x.size, *before, h, decay, x_out.ravel(), v_out.ravel())
        return x_out, v_out

    def accelerate_kick(self, g: Floats, v: Floats, gravity: Floats, h: float, growth: float) -> None:
        """In place the elastic gradient g becomes the acceleration a [m/s^2], and v becomes growth (v + h/2 a)."""
        self.workers.run(motion.accelerate_kick, len(g), self.disc.mass, self.disc.free, gravity, h, growth, g, v)

    def place(self, x: Floats, motion: Prescribed, time: float) -> None:
        """Put vertices where they have to be at a time [s], in place."""
        x[motion.vertices] = motion.positions(time)

    def place_velocities(self, v: Floats, vertices: NDArray[np.int64], x: Floats, before: Floats, h: float) -> None:
        """Velocities (x - before) / h of the listed vertices, in place."""
        v[vertices] = (x[vertices] - before[vertices]) / h

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

    def norm(self, a: Floats) -> float:
        """Square root of the sum of a * a over an array of rows."""
        return float(np.linalg.norm(a))

    def is_finite(self, x: Floats) -> bool:
        """Whether all entries of an array of rows are finite."""
        return bool(np.isfinite(x).all())

    def looks_finite(self, x: Floats) -> bool:
        """The same, at the cost of one sum."""
        return bool(np.isfinite(x.sum()))

    def total(self, values: Floats) -> float:
        """Sum of a list of numbers."""
        return float(values.sum())

    def smallest(self, values: Floats) -> float:
        """Smallest of a list of numbers, not a number where one of them is not."""
        return float(values.min())

    def kinetic_energy(self, v: Floats) -> float:
        """sum m |v|^2 / 2 [J]."""
        return 0.5 * float(self.disc.mass @ np.einsum("ij,ij->i", v, v))

    def weight_energy(self, x: Floats, gravity: Floats) -> float:
        """Potential energy of gravity [J], zero at the rest positions."""
        return -float(self.disc.mass @ ((x - self.disc.mesh.points) @ gravity))

    def mass_distance(self, x: Floats, y: Floats) -> float:
        """sum m |x - y|^2 [kg m^2]."""
        return float((self.disc.mass[:, None] * (x - y) ** 2).sum())

    def divided_by_mass(self, f: Floats, scale: float = 1.0) -> Floats:
        """scale M^-1 f, shape [n, 3]."""
        return scale * f / self.disc.mass[:, None]

    def add_inertia(self, g: Floats, x: Floats, xhat: Floats, inverse_h2: float) -> None:
        """g += M (x - xhat) inverse_h2 [N] at the free vertices, in place."""
        free = self.disc.free
        g[free] += inverse_h2 * self.disc.mass[free, None] * (x - xhat)[free]

    def unit_mode(self, v: Floats) -> Floats:
        """v at the free vertices, zero at constrained ones, over its norm weighted by mass, shape [n, 3]."""
        v = np.where(self.disc.free[:, None], v, 0.0)
        return v / self._mass_norm(v)

    def power_step(self, x: Floats, v: Floats) -> tuple[float, float, Floats]:
        """Rayleigh quotient of v in M^-1 K at x, its residual, and M^-1 K v, all of v of unit norm."""
        v = v / self._mass_norm(v)
        Kv = self.hessian_product(x, v)
        theta = float((v * Kv).sum())
        w = Kv / self.disc.mass[:, None]
        return theta, self._mass_norm(w - theta * v), w

    def _mass_norm(self, v: Floats) -> float:
        return float(np.sqrt((self.disc.mass[:, None] * v * v).sum()))

    def descend(
        self,
        stars: Stars,
        ranges: Sequence[tuple[int, int]],
        phi: tuple[Floats, float],
        w: float,
        x: Floats,
        dx: Floats,
    ) -> None:
        """x_i -= w H_i^-1 g_i vertex by vertex, in place; see `femgal.gauss_seidel.sweep.descend`."""
        from femgal.gauss_seidel.sweep import descend

        xhat, inverse_h2 = phi
        tail = (self.disc.mass, inverse_h2, xhat, w, x, dx)
        for first, count in ranges:
            self.workers.run(descend, count, first, *stars.arrays, *tail, smallest_share=SMALLEST_COLOUR)

    def take_off_fall(self, x: Floats, share: Floats, fall: Floats) -> None:
        """x -= (1 - share) fall, in place; one share per vertex."""
        x -= (1.0 - share)[:, None] * fall

    def share_of_gravity(self, x: Floats, xhat: Floats, gravity: Floats, inverse_h2: float) -> Floats:
        """Which part of gravity is in the accelerations (x - xhat) inverse_h2 + gravity: one per vertex, 0 to 1."""
        along = (x - xhat) @ gravity * inverse_h2
        return np.clip(1.0 + along / float(gravity @ gravity), 0.0, 1.0)

    def cycle_on_device(self, cycle: Any) -> None:
        """None: the host itself makes it."""
        return

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
