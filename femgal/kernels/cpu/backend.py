# SPDX-License-Identifier: BSD-3-Clause
"""The production backend on the CPU: tiled element passes in float32 or float64, everything else in float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Precision
from femgal.kernels.cpu import nodes, passes, slots
from femgal.kernels.cpu.node_work import NodeWork
from femgal.kernels.cpu.simd import TERMS, VECTOR
from femgal.kernels.cpu.tiles import Slots, Tiles, build_pairs, build_tiles, vertex_slots
from femgal.kernels.plain import elements

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _LayerTiles:
    """The elements of a layer and how their results reach its nodes; `pairs` is empty on the finest layer."""

    tiles: Tiles
    slots: Slots
    pairs: tuple[Any, ...] = ()

    @property
    def n_slots(self) -> int:
        """Rows that the blocks write."""
        return int(self.slots.node_ptr[-1])


class CpuBackend(NodeWork):
    """Tiled element passes; the methods are those of `femgal.kernels.backend.Backend`.

    Parameters
    ----------
    disc : The discretised bodies.
    threads : Number of threads; None takes the processors that this process may use. Never changes a bit.
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
        self._layers: dict[Layer, _LayerTiles] = {}
        self._scratch = np.empty(0, precision)

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy at the free vertices [N], shape [n, 3], zero at constrained ones."""
        self.passes.gradient += 1
        return self._at_free_vertices(self._vectors(self.vertices, (passes.vertex_forces, passes.pair_forces), x))

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        """Elastic Hessian at x, or its definite part, times d at the free vertices [N], zero at constrained ones."""
        self.passes.hessian_product += 1
        finest = passes.vertex_definite_products if definite else passes.vertex_products
        return self._at_free_vertices(self._vectors(self.vertices, (finest, passes.pair_products), x, d))

    def nodal_product(self, layer: Layer, x: Floats, d: Floats, inverse_h2: float, *, definite: bool = False) -> Floats:
        """P^T (d2 phi)(x) d, or with the definite part, [N], shape [k, 3]."""
        assert layer is self.vertices or not definite
        self.passes.hessian_product += self._pass_share(layer)
        finest = passes.vertex_definite_products if definite else passes.vertex_products
        out = self._vectors(layer, (finest, passes.pair_products), x, d)
        arguments = (*_children(layer), self.disc.mass, d, inverse_h2, out)
        self.workers.run_ragged(nodes.inertia, layer.child_ptr, *arguments)
        return out

    def nodal_gradient(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> Floats:
        """P^T grad phi [N], shape [k, 3]."""
        self.passes.gradient += self._pass_share(layer)
        one = self._tiles_of(layer)
        values = self._blocks(one, (passes.vertex_forces, passes.pair_forces), VECTOR, x)
        g = np.empty((layer.n_nodes, 3))
        inertia = (*_children(layer), self.disc.mass, x, xhat, inverse_h2)
        arguments = (one.slots.slot_ptr, one.slots.slot, values, *inertia, g)
        self.workers.run_ragged(slots.sum_gradients, layer.child_ptr, *arguments)
        return g

    def gradient_and_blocks(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, Floats]:
        """Gradient and diagonal 3x3 blocks of phi at the nodes of a layer: shapes [k, 3] and [k, 6]."""
        self.passes.gradient_and_blocks += self._pass_share(layer)
        one = self._tiles_of(layer)
        values = self._blocks(one, (passes.vertex_terms, passes.pair_terms), TERMS, x)
        g, H = np.empty((layer.n_nodes, 3)), np.empty((layer.n_nodes, 6))
        inertia = (*_children(layer), self.disc.mass, x, xhat, inverse_h2)
        arguments = (one.slots.slot_ptr, one.slots.slot, values, *inertia, g, H)
        self.workers.run_ragged(slots.sum_terms, layer.child_ptr, *arguments)
        return g, H

    def correction(
        self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float, w: float = 1.0, *, scalar: bool = False
    ) -> tuple[Floats, float]:
        """dx = -w H^-1 g at the nodes of a layer [m], shape [k, 3], and its slope g . dx [J]."""
        self.passes.gradient_and_blocks += self._pass_share(layer)
        one = self._tiles_of(layer)
        values = self._blocks(one, (passes.vertex_terms, passes.pair_terms), TERMS, x)
        dx, slope = np.empty((layer.n_nodes, 3)), np.empty(layer.n_nodes)
        inertia = (*_children(layer), self.disc.mass, x, xhat, inverse_h2)
        arguments = (one.slots.slot_ptr, one.slots.slot, values, *inertia, w, scalar, dx, slope)
        self.workers.run_ragged(slots.sum_and_solve, layer.child_ptr, *arguments)
        return dx, float(slope.sum())

    def energies_along(self, layer: Layer, x: Floats, d: Floats) -> Floats:
        """Coefficients of t, t^2, ..., t^6 in E(x + t d) [J], shape [6], for a d that the layer's nodes make."""
        one = self._tiles_of(layer)
        partial = np.empty((one.tiles.n_blocks, 6))
        arguments = (x, self.disc.mesh.points, d, *_element_arrays(one.tiles), partial)
        self.workers.run(passes.energies_along, one.tiles.n_blocks, *arguments, smallest_share=1)
        self.passes.energy += one.tiles.n_elements / self.disc.n_tets
        return partial.sum(axis=0)

    def energies(self, x: Floats) -> tuple[Floats, Floats]:
        """Elastic energy [J] and volume ratio J of each tetrahedron, both shape [m]."""
        energy, J = np.empty(self.disc.n_tets), np.empty(self.disc.n_tets)
        for tiles in (self._tiles_of(self.vertices).tiles, self._held):
            arguments = (x, self.disc.mesh.points, *_element_arrays(tiles), tiles.element, energy, J)
            self.workers.run(passes.energies, tiles.n_blocks, *arguments, smallest_share=1)
        self.passes.energy += 1
        return energy, J

    def von_mises(self, x: Floats) -> Floats:
        """Von Mises norm of the Cauchy stress of each tetrahedron [Pa], shape [m]."""
        disc, out = self.disc, np.empty(self.disc.n_tets)
        cells, B = disc.mesh.cells, disc.B
        self.workers.run(elements.von_mises_stresses, disc.n_tets, x, cells, B, disc.mu, out)
        return out

    def _tiles_of(self, layer: Layer) -> _LayerTiles:
        if layer not in self._layers:
            tiles = build_tiles(self.disc, layer.active, self.precision)
            if layer is self.vertices:
                self._layers[layer] = _LayerTiles(tiles, vertex_slots(tiles, layer))
            else:
                pairs, where = build_pairs(self.disc, layer, tiles, self.precision)
                arrays = (where.node_ptr, pairs.row_ptr, pairs.node, pairs.u)
                self._layers[layer] = _LayerTiles(tiles, where, arrays)
        return self._layers[layer]

    @cached_property
    def _held(self) -> Tiles:
        """Elements without a free vertex: no node feels them, but they have an energy."""
        held = np.ones(self.disc.n_tets, bool)
        held[self.vertices.active] = False
        return build_tiles(self.disc, np.flatnonzero(held).astype(np.int32), self.precision)

    def _blocks(self, one: _LayerTiles, kernels: tuple[Any, Any], width: int, *vectors: Floats) -> NDArray:
        """Slots of a pass: the first kernel is for the finest layer, the other for coarse ones."""
        size = one.n_slots * width
        if len(self._scratch) < size:
            self._scratch = np.empty(size, self.precision)
        out = self._scratch[:size]
        x, *directions = vectors
        arguments = (x, self.disc.mesh.points, *directions, *_element_arrays(one.tiles), *one.pairs, out)
        self.workers.run(kernels[1 if one.pairs else 0], one.tiles.n_blocks, *arguments, smallest_share=1)
        return out

    def _vectors(self, layer: Layer, kernels: tuple[Any, Any], *vectors: Floats) -> Floats:
        one = self._tiles_of(layer)
        values = self._blocks(one, kernels, VECTOR, *vectors)
        out = np.empty((layer.n_nodes, 3))
        arguments = (one.slots.slot_ptr, one.slots.slot, values, out)
        self.workers.run(slots.sum_vectors, layer.n_nodes, *arguments)
        return out


def _element_arrays(tiles: Tiles) -> tuple[Any, ...]:
    """Arguments of every pass after positions and directions."""
    arrays = (tiles.vertex_ptr, tiles.vertex, tiles.corner, tiles.rest, tiles.anchor, tiles.anchor_inverse)
    return *arrays, tiles.most_vertices


def _children(layer: Layer) -> tuple[NDArray, NDArray, NDArray]:
    return layer.child_ptr, layer.child, layer.child_weight
