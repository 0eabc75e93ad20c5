# SPDX-License-Identifier: BSD-3-Clause
"""Warping: a lattice point too close to a cut on one of its edges moves there and takes the sign 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel
from meshes.stuffing.lattice import DIRECTIONS, N_DIRECTIONS
from meshes.stuffing.signs import Sample
from meshes.stuffing.stencils import ALPHA

STAYS = -1
_LENGTH = np.linalg.norm(DIRECTIONS, axis=1) / 2.0


@dataclass(frozen=True, eq=False)
class Warped:
    """What warping made of a sample; the sample's signs now hold the zeros.

    Parameters
    ----------
    way : Edge along which each near point moved: its direction, plus 7 against it, or -1; shape [n_near].
    vertices : Vertices that the mesh will have before any repair.
    """

    way: NDArray[np.int8]
    vertices: int


def warp(sample: Sample) -> Warped:
    """Move every point that a cut violates onto the nearest such cut: first the outside points, then the inside ones.

    A moved point takes the cuts on its other edges with it. The paper leaves the order open; outside first keeps more
    inside points where the body is thin, and with them up to 2% more of its volume (Buddha, 20,000 vertices: 1.6% lost
    instead of 1.9%). Points of one side share no cut, so the order within a side does not matter.
    """
    steps = sample.lattice.steps
    way = np.full(len(sample.near), STAYS, np.int8)
    for side in (-1, 1):
        _choose(side, sample.sign, sample.near, sample.slot, sample.cut, steps, ALPHA, _LENGTH, way)
        sample.sign[sample.near[way != STAYS]] = 0
    return Warped(way, _count(sample.sign, sample.near, steps))


@kernel
def _choose(
    side: int,
    sign: NDArray[np.int8],
    near: NDArray[np.int32],
    slot: NDArray[np.int32],
    cut: NDArray[np.float64],
    steps: NDArray[np.int64],
    alpha: NDArray[np.float64],
    length: NDArray[np.float64],
    way: NDArray[np.int8],
) -> None:
    for i in range(near.shape[0]):
        p = near[i]
        if sign[p] != side:
            continue
        closest = np.inf
        for e in range(2 * N_DIRECTIONS):
            q = p + steps[p & 1, e]
            if sign[q] != -side:
                continue
            d = e % N_DIRECTIONS
            t = cut[i, d] if e < N_DIRECTIONS else 1.0 - cut[slot[q], d]
            if t < alpha[d] and t * length[d] < closest:
                closest = t * length[d]
                way[i] = e


@kernel
def _count(sign: NDArray[np.int8], near: NDArray[np.int32], steps: NDArray[np.int64]) -> int:
    """Inside points, surface points beside one, and cuts between + and -."""
    n = 0
    for p in range(sign.shape[0]):
        n += sign[p] > 0
    for i in range(near.shape[0]):
        p = near[i]
        beside = False
        for e in range(2 * N_DIRECTIONS):
            s = sign[p + steps[p & 1, e]]
            beside |= s > 0
            n += s * sign[p] < 0 and e < N_DIRECTIONS
        n += beside and sign[p] == 0
    return n
