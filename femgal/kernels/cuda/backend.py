# SPDX-License-Identifier: BSD-3-Clause
"""The backend on a GPU: element passes in float32 or float64, state vectors and sums in float64.

Nothing waits for the device but what returns a number of Python; see `femgal.kernels.cuda.node_work`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Precision
from femgal.kernels.cuda import nodes, pair_passes, sums, vertex_passes
from femgal.kernels.cuda.device_layer import DeviceBlocks, DeviceLayer, device_blocks, device_layer
from femgal.kernels.cuda.layout import build_blocks
from femgal.kernels.cuda.node_work import NodeWork
from femgal.kernels.cuda.shared import TERMS, VECTOR
from femgal.kernels.cuda.stream import THREADS
from femgal.kernels.cuda.sums import CHUNK_THREADS
from femgal.kernels.deferred import Deferred, Number

# A device array.
Floats = Any


class CudaBackend(NodeWork):
    """Blocked element passes; the methods are those of `femgal.kernels.backend.Backend`.

    Parameters
    ----------
    disc : The discretised bodies.
    threads : CPU threads for what is made on the host.
    finest : The finest layer, when it has been built already.
    precision : Of the element passes.
    """

    def __init__(
        self,
        disc: Discretisation,
        threads: int | None = None,
        finest: Layer | None = None,
        precision: Precision = "float64",
    ) -> None:
        super().__init__(disc, threads, finest)
        self.precision = precision
        self._itemsize = np.dtype(precision).itemsize
        self._layers: dict[Layer, DeviceLayer] = {}
        self._nothing = self.pool.take((0, 3))

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy at the free vertices [N], shape [n, 3], zero at constrained ones."""
        self.passes.gradient += 1
        return self._vectors(self.vertices, _FORCES, x, at_vertices=True)

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        """Elastic Hessian at x, or its definite part, times d at the free vertices [N], zero at constrained ones."""
        self.passes.hessian_product += 1
        return self._vectors(self.vertices, _DEFINITE if definite else _PRODUCTS, x, d, at_vertices=True)

    def nodal_product(self, layer: Layer, x: Floats, d: Floats, inverse_h2: float, *, definite: bool = False) -> Floats:
        """P^T (d2 phi)(x) d, or with the definite part, [N], shape [k, 3]."""
        assert layer is self.vertices or not definite
        self.passes.hessian_product += self._pass_share(layer)
        return self._vectors(layer, _DEFINITE if definite else _PRODUCTS, x, d, inertia=(d, d, inverse_h2, 0.0))

    def nodal_gradient(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> Floats:
        """P^T grad phi [N], shape [k, 3]."""
        self.passes.gradient += self._pass_share(layer)
        return self._vectors(layer, _FORCES, x, inertia=(x, xhat, inverse_h2, 1.0))

    def gradient_and_blocks(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, Floats]:
        """Gradient and diagonal 3x3 blocks of phi at the nodes of a layer: shapes [k, 3] and [k, 6]."""
        arguments = self._terms(layer, x, xhat, inverse_h2)
        g, H = self.pool.take((layer.n_nodes, 3)), self.pool.take((layer.n_nodes, 6))
        self.stream.over_rows(sums.sum_terms, layer.n_nodes, *arguments, g, H)
        return g, H

    def correction(
        self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float, w: float = 1.0, *, scalar: bool = False
    ) -> tuple[Floats, Number]:
        """dx = -w H^-1 g at the nodes of a layer [m], shape [k, 3], and its slope g . dx [J], deferred."""
        arguments = self._terms(layer, x, xhat, inverse_h2)
        dx, slope = self.pool.take((layer.n_nodes, 3)), self.pool.take((layer.n_nodes,))
        self.stream.over_rows(sums.sum_and_solve, layer.n_nodes, *arguments, w, scalar, dx, slope)
        return dx, Deferred(lambda: self.total(slope))

    def energies_along(self, layer: Layer, x: Floats, d: Floats) -> NDArray[np.float64]:
        """Coefficients of t, t^2, ..., t^6 in E(x + t d) [J], shape [6], for a d that the layer's nodes make."""
        blocks = self._layer(layer).blocks
        self.passes.energy += blocks.n_elements / self.disc.n_tets
        partial, out = self.pool.take((6 * blocks.n_blocks,)), self.pool.take((6,))
        shared = max(48 * blocks.most_vertices, 48 * min(blocks.size, THREADS))
        tail = (blocks.size, blocks.most_vertices, blocks.n_blocks, partial)
        arguments = (x, self._X, d, *blocks.arrays, *tail)
        self.stream.over_blocks(vertex_passes.energies_along, blocks.n_blocks, blocks.size, shared, *arguments)
        self.stream.over_blocks(nodes.row_sums, 6, THREADS, 8 * THREADS, partial, blocks.n_blocks, out)
        return self.stream.download(out)

    def energies(self, x: Floats) -> tuple[Floats, Floats]:
        """Elastic energy [J] and volume ratio J of each tetrahedron, both shape [m]."""
        energy, J = self.pool.take((self.disc.n_tets,)), self.pool.take((self.disc.n_tets,))
        self._each_element(vertex_passes.energies, x, energy, J)
        self.passes.energy += 1
        return energy, J

    def von_mises(self, x: Floats) -> Floats:
        """Von Mises norm of the Cauchy stress of each tetrahedron [Pa], shape [m]."""
        out = self.pool.take((self.disc.n_tets,))
        self._each_element(vertex_passes.von_mises_stresses, x, out)
        return out

    def restrict(self, layer: Layer, f: Floats) -> Floats:
        """P^T f, shape [k, 3]."""
        inertia = (f, f, 1.0, 0.0)
        one, out = self._layer(layer), self.pool.take((layer.n_nodes, 3))
        arguments = self._rounds(one, None, VECTOR, self._ones, *inertia)
        self.stream.over_rows(sums.sum_vectors, layer.n_nodes, *arguments, *inertia, layer.n_nodes, False, out)
        return out

    @cached_property
    def _ones(self) -> Any:
        return self.put(np.ones(self.disc.n_vertices))

    @cached_property
    def _held(self) -> DeviceBlocks:
        """Elements without a free vertex: no node feels them, but they have an energy."""
        held = np.ones(self.disc.n_tets, bool)
        held[self.vertices.active] = False
        return device_blocks(build_blocks(self.disc, np.flatnonzero(held).astype(np.int32), self.precision), self.put)

    def _each_element(self, kernel: Any, x: Floats, *out: Any) -> None:
        for blocks in (self._layer(self.vertices).blocks, self._held):
            arguments = (x, self._X, *blocks.arrays, blocks.size, blocks.element, *out)
            self.stream.over_blocks(kernel, blocks.n_blocks, blocks.size, 24 * blocks.most_vertices, *arguments)

    def _layer(self, layer: Layer) -> DeviceLayer:
        if layer not in self._layers:
            finest = layer is self.vertices
            self._layers[layer] = device_layer(self.disc, layer, self.precision, self.put, finest=finest)
        return self._layers[layer]

    def _prolongation(self, layer: Layer) -> tuple[Any, Any]:
        one = self._layer(layer)
        return one.parent, one.weight

    def _pass_share(self, layer: Layer) -> float:
        """A pass over a layer in units of one over the finest."""
        return layer.n_pairs / max(1, self.vertices.n_pairs)

    def _slots(self, layer: Layer, kernels: tuple[Any, Any], width: int, *vectors: Floats) -> Any:
        """Slots of a pass: the first kernel is for the finest layer, the other for coarse ones."""
        one = self._layer(layer)
        blocks, out = one.blocks, self.pool.take((width * one.n_slots,), self.precision)
        kernel, parts = (kernels[0], ()) if layer is self.vertices else (kernels[1], (one.most_parts,))
        x, *directions = vectors
        head = (x, self._X, *directions, *blocks.arrays, blocks.size, blocks.most_vertices)
        shared = one.shared_bytes(width, self._itemsize, directions=bool(directions))
        arguments = (*head, *one.targets, *parts, one.n_slots, out)
        self.stream.over_blocks(kernel, blocks.n_blocks, blocks.size, shared, *arguments)
        return out

    def _rounds(
        self, one: DeviceLayer, values: Any, width: int, mass: Any, y: Floats, z: Floats, factor: float, share: float
    ) -> tuple[Any, ...]:
        """Add up in rounds, and return the arguments of the last sum up to the masses."""
        n_slots = one.n_slots
        slot_ptr, slot, child_ptr = one.slot_ptr, one.slot, one.child_ptr
        if values is None:
            values, n_slots = self.pool.take((0,), self.precision), 0
            slot_ptr = self._no_slots(one) if not one.rounds else slot_ptr
        for number, r in enumerate(one.rounds):
            out = self.pool.take((width * r.n_chunks,))
            slots = r.slot_range if n_slots or number else self._no_range(r)
            head = (r.child_range, slots, r.slot, values, n_slots, width, one.child, one.child_weight)
            arguments = (*head, mass, y, z, factor, share, r.n_chunks, out)
            shared = 8 * width * CHUNK_THREADS
            self.stream.over_blocks(sums.chunk_sums, r.n_chunks, CHUNK_THREADS, shared, *arguments)
            values, n_slots = out, r.n_chunks
        return slot_ptr, slot, values, n_slots, child_ptr, one.child, one.child_weight, mass

    def _no_slots(self, one: DeviceLayer) -> Any:
        """As if no node had a slot."""
        return self._zeros_like(one.slot_ptr)

    def _no_range(self, r: Any) -> Any:
        return self._zeros_like(r.slot_range)

    def _zeros_like(self, array: Any) -> Any:
        known = self._constants.get(id(array))
        if known is None:
            known = self._constants[id(array)] = (array, self.put(np.zeros(array.shape, array.dtype)))
        return known[1]

    def _terms(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Any, ...]:
        """Gradient and block of every node but for the last sum, whose arguments are returned."""
        self.passes.gradient_and_blocks += self._pass_share(layer)
        one, values = self._layer(layer), self._slots(layer, _TERMS, TERMS, x)
        inertia = (x, xhat, inverse_h2)
        return *self._rounds(one, values, TERMS, self._mass, *inertia, 1.0), *inertia

    def _vectors(
        self,
        layer: Layer,
        kernels: tuple[Any, Any],
        *vectors: Floats,
        inertia: tuple[Any, Any, float, float] | None = None,
        at_vertices: bool = False,
    ) -> Floats:
        """Three values per node: of a pass, with sum w m factor (y - share z) of its vertices added.

        With `at_vertices` they are rows of all vertices, zero at constrained ones.
        """
        one, values = self._layer(layer), self._slots(layer, kernels, VECTOR, *vectors)
        # A factor of zero: positions are read, but add nothing.
        inertia = inertia or (vectors[0], vectors[0], 0.0, 1.0)
        n, k = self.disc.n_vertices, layer.n_nodes
        out = self.zeros(n) if at_vertices and k < n else self.pool.take((k, 3))
        arguments = self._rounds(one, values, VECTOR, self._mass, *inertia)
        self.stream.over_rows(sums.sum_vectors, k, *arguments, *inertia, k, at_vertices, out)
        return out


_TERMS = (vertex_passes.vertex_terms, pair_passes.pair_terms)
_FORCES = (vertex_passes.vertex_forces, pair_passes.pair_forces)
_PRODUCTS = (vertex_passes.vertex_products, pair_passes.pair_products)
_DEFINITE = (vertex_passes.vertex_definite_products, pair_passes.pair_products)
