# SPDX-License-Identifier: BSD-3-Clause
"""The plan of the sums over nodes: in how many rounds, and which chunk adds up what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.cuda.sums import CHUNK

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# A thread of its own adds up a node with no more slots or vertices than this on average, and no more than CHUNK.
FEW = 16


@dataclass(frozen=True, eq=False)
class Round:
    """Chunks that blocks of threads add up at once.

    Parameters
    ----------
    child_range, slot_range : Vertices and slots of each chunk, as first and one past the last, shape [chunks, 2].
    slot : Order of the slots, shape [slots].
    """

    child_range: Ints
    slot_range: Ints
    slot: Ints

    @property
    def n_chunks(self) -> int:
        """Slots that the round leaves."""
        return len(self.slot_range)


@dataclass(frozen=True, eq=False)
class Sums:
    """Rounds, and what is left for one thread per node.

    Parameters
    ----------
    rounds : In the order in which they are made.
    slot_ptr, slot : Slots of each node after the last round, shape [k + 1] and [slots].
    child_ptr : Vertices of each node that no round has added up: all of them or none, shape [k + 1].
    """

    rounds: tuple[Round, ...]
    slot_ptr: Longs
    slot: Ints
    child_ptr: Longs


def plan_sums(layer: Layer, slot_ptr: Longs, slot: Ints) -> Sums:
    """How to add up the slots and vertices of the nodes of a layer."""
    rounds: list[Round] = []
    child_ptr = layer.child_ptr
    while _many(slot_ptr) or _many(child_ptr):
        chunks, chunk_ptr = _round(child_ptr, slot_ptr, slot)
        rounds.append(chunks)
        child_ptr = np.zeros_like(child_ptr)
        slot_ptr, slot = chunk_ptr, np.arange(chunk_ptr[-1], dtype=np.int32)
    return Sums(tuple(rounds), slot_ptr, slot, child_ptr)


def _many(ptr: Longs) -> bool:
    sizes = np.diff(ptr)
    return bool(sizes.size and (sizes.mean() > FEW or sizes.max() > CHUNK))


def _round(child_ptr: Longs, slot_ptr: Longs, slot: Ints) -> tuple[Round, Longs]:
    """Cut the vertices and slots of each node into as many chunks as the longer list needs, evenly."""
    children, slots = np.diff(child_ptr), np.diff(slot_ptr)
    pieces = np.maximum(1, -(-np.maximum(children, slots) // CHUNK))
    chunk_ptr = np.concatenate(([0], np.cumsum(pieces))).astype(np.int64)
    node = np.repeat(np.arange(len(pieces)), pieces)
    place = np.arange(chunk_ptr[-1]) - chunk_ptr[node]
    ranges = [
        _shares(ptr[node], count[node], place, pieces[node])
        for ptr, count in ((child_ptr, children), (slot_ptr, slots))
    ]
    return Round(ranges[0], ranges[1], slot), chunk_ptr


def _shares(first: Longs, count: Longs, place: Longs, pieces: Longs) -> Ints:
    """First and one past the last of piece number `place` of so many pieces of a list."""
    bounds = [first + count * (place + k) // pieces for k in (0, 1)]
    return np.ascontiguousarray(np.stack(bounds, axis=1).astype(np.int32))
