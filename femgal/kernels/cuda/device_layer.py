# SPDX-License-Identifier: BSD-3-Clause
"""A layer on the device: its blocks, how their results reach its nodes, and its prolongation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Precision
from femgal.kernels.cuda.layout import SHARED, SIZES, Blocks, Entries, Parts, build_blocks, build_entries, build_parts
from femgal.kernels.cuda.rounds import Sums, plan_sums
from meshes.errors import MeshError

# Puts a host array on the device.
Put = Callable[[np.ndarray], Any]

SMALLEST_SIZE = 16


@dataclass(frozen=True, eq=False)
class DeviceBlocks:
    """Blocks with their arrays on the device.

    Parameters
    ----------
    size, n_blocks, n_elements, most_vertices : As in `Blocks`.
    arrays : Arguments of every pass after positions and directions: vertex_ptr, vertex, corner, rest.
    element : Element at each place.
    """

    size: int
    n_blocks: int
    n_elements: int
    most_vertices: int
    arrays: tuple[Any, ...]
    element: Any


@dataclass(frozen=True, eq=False)
class DeviceRound:
    """A round of the sums; see `femgal.kernels.cuda.rounds.Round`."""

    child_range: Any
    slot_range: Any
    slot: Any
    n_chunks: int


@dataclass(frozen=True, eq=False)
class DeviceLayer:
    """A layer; k nodes.

    Parameters
    ----------
    blocks : Its active elements.
    targets : Arguments of a pass that say where its results go, without the number of slots.
    n_slots, most_parts : Slots that a pass writes; parts of the block that has most, 0 on the finest layer.
    rounds, slot_ptr, slot, child_ptr : How they are added up.
    child, child_weight, parent, weight : The prolongation.
    """

    blocks: DeviceBlocks
    targets: tuple[Any, ...]
    n_slots: int
    most_parts: int
    rounds: tuple[DeviceRound, ...]
    slot_ptr: Any
    slot: Any
    child_ptr: Any
    child: Any
    child_weight: Any
    parent: Any
    weight: Any

    def shared_bytes(self, width: int, itemsize: int, *, directions: bool) -> int:
        """Shared memory of a pass that gives so many values per node, in a precision of so many bytes."""
        return _shared_bytes(self.blocks, self.most_parts, width, itemsize, directions)


def device_blocks(blocks: Blocks, put: Put) -> DeviceBlocks:
    """Put blocks on the device."""
    arrays = (put(blocks.vertex_ptr), put(blocks.vertex), put(blocks.corner), put(blocks.rest))
    sizes = (blocks.size, blocks.n_blocks, blocks.n_elements, blocks.most_vertices)
    return DeviceBlocks(*sizes, arrays, put(blocks.element))


def device_layer(disc: Discretisation, layer: Layer, precision: Precision, put: Put, *, finest: bool) -> DeviceLayer:
    """Lay out a layer and put it on the device.

    Raises
    ------
    MeshError
        Its blocks do not fit into the shared memory of a multiprocessor, however small they are made.
    """
    size, itemsize = SIZES[precision], np.dtype(precision).itemsize
    while True:
        blocks = build_blocks(disc, layer.active, precision, size)
        where: Entries | Parts = build_entries(blocks, layer) if finest else build_parts(disc, layer, blocks)
        most_parts = where.most_parts if isinstance(where, Parts) else 0
        widest = max(_shared_bytes(blocks, most_parts, *kind) for kind in ((9, itemsize, False), (3, itemsize, True)))
        if widest <= SHARED:
            return _assembled(layer, blocks, where, most_parts, put)
        if size <= SMALLEST_SIZE:
            raise MeshError("a block of elements does not fit into shared memory", found=widest, allowed=SHARED)
        size //= 2


def _shared_bytes(blocks: Blocks | DeviceBlocks, most_parts: int, width: int, itemsize: int, directions: bool) -> int:
    points = (2 if directions else 1) * 24 * blocks.most_vertices
    if most_parts == 0:
        return points + itemsize * 4 * width * blocks.size
    tensors = 20 if width == 9 else 9
    return points + itemsize * (tensors * blocks.size + width * most_parts)


def _assembled(layer: Layer, blocks: Blocks, where: Entries | Parts, most_parts: int, put: Put) -> DeviceLayer:
    sums = plan_sums(layer, where.slot_ptr, where.slot)
    if isinstance(where, Parts):
        targets: tuple[Any, ...] = (where.node_ptr, where.node_part, where.part_ptr, where.pair, where.u)
        n_slots = int(where.node_ptr[-1])
    else:
        targets, n_slots = (where.ptr, where.entry), len(blocks.vertex)
    return DeviceLayer(
        device_blocks(blocks, put),
        tuple(put(array) for array in targets),
        n_slots,
        most_parts,
        *_put_sums(sums, put),
        *(put(array) for array in (layer.child, layer.child_weight, layer.parent, layer.weight)),
    )


def _put_sums(sums: Sums, put: Put) -> tuple[Any, ...]:
    rounds = tuple(DeviceRound(put(r.child_range), put(r.slot_range), put(r.slot), r.n_chunks) for r in sums.rounds)
    return rounds, put(sums.slot_ptr), put(sums.slot), put(sums.child_ptr)
