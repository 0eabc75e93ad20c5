# SPDX-License-Identifier: BSD-3-Clause
"""The reference backend: every element writes its tensor, every node gathers from its elements, all in float64."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, Pairs, build_pairs
from femgal.kernels.backend import Precision
from femgal.kernels.cpu import nodes as shared
from femgal.kernels.cpu.node_work import NodeWork
from femgal.kernels.plain import elements, nodes

Floats = NDArray[np.float64]


class PlainBackend(NodeWork):
    """Element passes without tiles; the methods are those of `femgal.kernels.backend.Backend`.

    Parameters
    ----------
    disc : The discretised bodies.
    threads : Number of threads; None takes the processors that this process may use. Never changes a bit.
    finest : The finest layer, when it has been built already.
    """

    precision: Precision = "float64"

    def __init__(self, disc: Discretisation, threads: int | None = None, finest: Layer | None = None) -> None:
        super().__init__(disc, threads, finest)
        self._tensors = np.empty((disc.n_tets, 9))
        self._material = (disc.mesh.cells, disc.B, disc.Vmu, disc.Vlam)
        self._pairs: dict[Layer, Pairs] = {}

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy at the free vertices [N], shape [n, 3], zero at constrained ones."""
        self.passes.gradient += 1
        return self._at_free_vertices(self._stress_forces(self.vertices, x))

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        """Elastic Hessian at x, or its definite part, times d at the free vertices [N], zero at constrained ones."""
        self.passes.hessian_product += 1
        increments = elements.definite_stress_increments if definite else elements.stress_increments
        return self._at_free_vertices(self._products(self.vertices, x, d, increments))

    def nodal_gradient(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> Floats:
        """P^T grad phi [N], shape [k, 3]."""
        self.passes.gradient += self._pass_share(layer)
        return self._add_inertia(layer, self._stress_forces(layer, x), x - xhat, inverse_h2)

    def nodal_product(self, layer: Layer, x: Floats, d: Floats, inverse_h2: float, *, definite: bool = False) -> Floats:
        """P^T (d2 phi)(x) d, or with the definite part, [N], shape [k, 3]."""
        self.passes.hessian_product += self._pass_share(layer)
        increments = elements.definite_stress_increments if definite else elements.stress_increments
        return self._add_inertia(layer, self._products(layer, x, d, increments), d, inverse_h2)

    def gradient_and_blocks(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, Floats]:
        """Gradient and diagonal 3x3 blocks of phi at the nodes of a layer: shapes [k, 3] and [k, 6]."""
        disc, k = self.disc, layer.n_nodes
        F = self._tensors[: len(layer.active)]
        g, H = np.empty((k, 3)), np.empty((k, 6))
        self.workers.run(elements.deformation_gradients, len(layer.active), x, disc.mesh.cells, disc.B, layer.active, F)
        children = (layer.child_ptr, layer.child, layer.child_weight)
        inertia = (disc.mass, x, xhat, inverse_h2)
        self.workers.run_ragged(nodes.inertia_gradient_and_blocks, layer.child_ptr, *children, *inertia, g, H)
        ptr, element, u = self._pairs_of(layer)
        pairs = (ptr, element, u, layer.active)
        self.workers.run_ragged(nodes.gather_gradient_and_blocks, ptr, *pairs, F, disc.Vmu, disc.Vlam, g, H)
        self.passes.gradient_and_blocks += self._pass_share(layer)
        return g, H

    def correction(
        self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float, w: float = 1.0, *, scalar: bool = False
    ) -> tuple[Floats, float]:
        """dx = -w H^-1 g at the nodes of a layer [m], shape [k, 3], and its slope g . dx [J]."""
        g, H = self.gradient_and_blocks(layer, x, xhat, inverse_h2)
        dx = self.solve(g, H, w, scalar=scalar)
        return dx, float((g * dx).sum())

    def energies_along(self, layer: Layer, x: Floats, d: Floats) -> Floats:
        """Coefficients of t, t^2, ..., t^6 in E(x + t d) [J], shape [6], for a d that the layer's nodes make."""
        partial = np.empty((-(-len(layer.active) // elements.CHUNK), 6))
        arguments = (x, d, *self._material, layer.active, partial)
        self.workers.run(elements.energies_along, len(partial), *arguments, smallest_share=1)
        self.passes.energy += len(layer.active) / self.disc.n_tets
        return partial.sum(axis=0)

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

    def _pairs_of(self, layer: Layer) -> tuple[NDArray[np.int64], NDArray[np.int32], Floats]:
        if layer not in self._pairs:
            self._pairs[layer] = build_pairs(self.disc, layer)
        pairs = self._pairs[layer]
        return pairs.ptr, pairs.element, pairs.u

    def _stress_forces(self, layer: Layer, x: Floats) -> Floats:
        P = self._tensors[: len(layer.active)]
        self.workers.run(elements.stresses, len(layer.active), x, *self._material, layer.active, P)
        return self._gather(layer, P)

    def _products(self, layer: Layer, x: Floats, d: Floats, increments: Callable[..., None]) -> Floats:
        P = self._tensors[: len(layer.active)]
        self.workers.run(increments, len(layer.active), x, d, *self._material, layer.active, P)
        return self._gather(layer, P)

    def _gather(self, layer: Layer, P: Floats) -> Floats:
        rows = np.empty((layer.n_nodes, 3))
        pairs = self._pairs_of(layer)
        self.workers.run_ragged(nodes.gather_stress, pairs[0], *pairs, P, rows)
        return rows

    def _add_inertia(self, layer: Layer, f: Floats, d: Floats, inverse_h2: float) -> Floats:
        children = (layer.child_ptr, layer.child, layer.child_weight)
        arguments = (*children, self.disc.mass, d, inverse_h2, f)
        self.workers.run_ragged(shared.inertia, layer.child_ptr, *arguments)
        return f
