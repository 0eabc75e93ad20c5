# SPDX-License-Identifier: BSD-3-Clause
"""What solvers ask of a device, answered by the CPU kernels in float64.

Another device offers the same methods on its own arrays; solvers and time stepping know no other way to the elements.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, finest_layer
from femgal.kernels.cpu import elements, nodes
from femgal.kernels.cpu.threads import Workers

Floats = NDArray[np.float64]


@dataclass
class Passes:
    """Element passes by kind, in units of one pass over all tetrahedra of the finest mesh.

    A pass over a coarse layer counts by its (element, node) pairs against those of the finest layer.
    """

    gradient: float = 0.0
    gradient_and_blocks: float = 0.0
    hessian_product: float = 0.0
    energy: float = 0.0

    @property
    def total(self) -> float:
        """Passes of all kinds."""
        return self.gradient + self.gradient_and_blocks + self.hessian_product + self.energy

    def as_dict(self) -> dict[str, float]:
        """Passes by kind."""
        return dict(vars(self))


@dataclass(eq=False)
class CpuBackend:
    """Element and node passes on the CPU; n vertices, m tetrahedra.

    Parameters
    ----------
    disc : The discretised bodies.
    threads : Number of threads; None takes the processors that this process may use. Never changes a bit.
    finest : The finest layer, when it has been built already.
    """

    disc: Discretisation
    threads: int | None = None
    finest: Layer | None = None
    passes: Passes = field(default_factory=Passes)

    def __post_init__(self) -> None:
        self.workers = Workers(self.threads)
        self.vertices = self.finest or finest_layer(self.disc)
        self._tensors = np.empty((self.disc.n_tets, 9))
        self._material = (self.disc.mesh.cells, self.disc.B, self.disc.Vmu, self.disc.Vlam)

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy at the free vertices [N], shape [n, 3], zero at constrained ones."""
        active = self.vertices.active
        self.workers.run(elements.stresses, len(active), x, *self._material, active, self._tensors)
        self.passes.gradient += 1
        return self._gather()

    def hessian_product(self, x: Floats, d: Floats) -> Floats:
        """Exact elastic Hessian at x times d at the free vertices [N], shape [n, 3], zero at constrained ones."""
        active = self.vertices.active
        self.workers.run(elements.stress_increments, len(active), x, d, *self._material, active, self._tensors)
        self.passes.hessian_product += 1
        return self._gather()

    def gradient_and_blocks(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, Floats]:
        """Gradient and diagonal 3x3 blocks of phi = |x - xhat|^2_M inverse_h2 / 2 + E at the nodes of a layer.

        Returns
        -------
        g : [N], shape [n_nodes, 3].
        H : [N/m], shape [n_nodes, 6], entries xx xy xz yy yz zz. Equal to the block of P^T (d2 phi) P.
        """
        disc, k = self.disc, layer.n_nodes
        F = self._tensors[: len(layer.active)]
        g, H = np.empty((k, 3)), np.empty((k, 6))
        self.workers.run(elements.deformation_gradients, len(layer.active), x, disc.mesh.cells, disc.B, layer.active, F)
        children = (layer.child_ptr, layer.child, layer.child_weight)
        inertia = (disc.mass, x, xhat, inverse_h2)
        self.workers.run_ragged(nodes.inertia_gradient_and_blocks, layer.child_ptr, *children, *inertia, g, H)
        pairs = (layer.ptr, layer.element, layer.u, layer.active)
        self.workers.run_ragged(nodes.gather_gradient_and_blocks, layer.ptr, *pairs, F, disc.Vmu, disc.Vlam, g, H)
        self.passes.gradient_and_blocks += len(layer.element) / max(1, len(self.vertices.element))
        return g, H

    def energies_along(self, layer: Layer, x: Floats, d: Floats) -> Floats:
        """Coefficients of t, t^2, ..., t^6 in E(x + t d) [J], shape [6], for a d that the layer's nodes make."""
        n_chunks = -(-len(layer.active) // elements.CHUNK)
        partial = np.empty((n_chunks, 6))
        self.workers.run_ragged(
            elements.energies_along,
            np.arange(n_chunks + 1) * elements.CHUNK,
            x,
            d,
            *self._material,
            layer.active,
            partial,
        )
        self.passes.energy += len(layer.active) / self.disc.n_tets
        return partial.sum(axis=0)

    def solve(self, g: Floats, H: Floats, w: float, *, scalar: bool = False) -> Floats:
        """-w H^-1 g block by block [m]; with the diagonal of each block only when `scalar`."""
        dx = np.empty_like(g)
        self.workers.run(nodes.solve_diagonals if scalar else nodes.solve_blocks, len(g), w, g, H, dx)
        return dx

    def prolong(self, layer: Layer, dx: Floats, x: Floats) -> None:
        """x += P dx in place."""
        self.workers.run(nodes.prolong, self.disc.n_vertices, layer.parent, layer.weight, dx, x)

    def restrict(self, layer: Layer, f: Floats) -> Floats:
        """P^T f, shape [n_nodes, 3]."""
        out = np.empty((layer.n_nodes, 3))
        children = (layer.child_ptr, layer.child, layer.child_weight)
        self.workers.run_ragged(nodes.restrict, layer.child_ptr, *children, f, out)
        return out

    def energies(self, x: Floats) -> tuple[Floats, Floats]:
        """Elastic energy [J] and volume ratio J of each tetrahedron, both shape [m]."""
        energy, J = np.empty(self.disc.n_tets), np.empty(self.disc.n_tets)
        self.workers.run(elements.energies, self.disc.n_tets, x, *self._material, energy, J)
        self.passes.energy += 1
        return energy, J

    def von_mises(self, x: Floats) -> Floats:
        """Von Mises norm of the Cauchy stress of each tetrahedron [Pa], shape [m]."""
        disc, out = self.disc, np.empty(self.disc.n_tets)
        cells, B = disc.mesh.cells, disc.B
        self.workers.run(elements.von_mises_stresses, disc.n_tets, x, cells, B, disc.mu, out)
        return out

    def _gather(self) -> Floats:
        layer = self.vertices
        rows = np.empty((layer.n_nodes, 3))
        pairs = (layer.ptr, layer.element, layer.u)
        self.workers.run_ragged(nodes.gather_stress, layer.ptr, *pairs, self._tensors, rows)
        out = np.zeros((self.disc.n_vertices, 3))
        out[self.disc.free] = rows
        return out
