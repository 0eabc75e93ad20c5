# SPDX-License-Identifier: BSD-3-Clause
"""Signs of the lattice points, and the cut points on the edges between + and -.

A point is inside when the surface winds around it a positive number of times (not: an odd number), so the union of
overlapping parts is filled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel, scalar
from meshes.stuffing.crossings import BUNDLES, cross, lattice_number
from meshes.stuffing.lattice import N_DIRECTIONS, Lattice
from meshes.stuffing.thickness import thin_points
from meshes.types import TriMesh

_NO_CUT = 2.0  # marks an edge whose cut is not known yet; fractions lie in [0, 1]
# A crossing this close to a lattice point may fall on the other side of it in another bundle (fraction of an edge).
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Sample:
    """A surface sampled on a lattice.

    Parameters
    ----------
    lattice : The points.
    sign : +1 inside, -1 outside, shape [lattice.size]; warping sets 0.
    near : Numbers of the points that have an edge between + and -, ascending, shape [n_near].
    slot : Row of a point in `near`, -1 for the others, shape [lattice.size].
    cut : Place of the cut on the edge from a near point along each direction, as a fraction of it; shape [n_near, 7].
    face : Triangle of the surface that each cut lies on, same shape.
    inside : Number of inside points.
    thin : Local thickness of the body at those inside points where it is thin, ascending, in units of the spacing.
    doubled : Volume that the surface winds around more than once, counted as often as it does so beyond the first
        time [m^3]; enclosed_volume - doubled is the volume of the union.
    unresolved : Edges between + and - on which no bundle found a crossing; their cut is put in the middle.
    unbalanced : Lattice lines on which the winding number did not return to zero.
    """

    lattice: Lattice
    sign: NDArray[np.int8]
    near: NDArray[np.int32]
    slot: NDArray[np.int32]
    cut: NDArray[np.float64]
    face: NDArray[np.int32]
    inside: int
    thin: NDArray[np.float32]
    doubled: float
    unresolved: int
    unbalanced: int


def sample(surface: TriMesh, lattice: Lattice) -> Sample:
    """Find the sign of every lattice point and the cut on every edge between + and -."""
    half_steps = (surface.points - lattice.origin) * (2.0 / lattice.spacing)
    found = [cross(bundle, half_steps, surface.cells) for bundle in BUNDLES]
    sign = np.full(lattice.size, -1, np.int8)
    doubled = 0.0
    for bundle, crossings in zip(BUNDLES, found, strict=True):
        if bundle.direction == N_DIRECTIONS - 1:
            doubled += _mark_inside(sign, lattice.strides, *crossings.line_data(bundle))
    slot, near = _near_points(sign, lattice.steps)
    cut = np.full((len(near), N_DIRECTIONS), _NO_CUT)
    face = np.zeros((len(near), N_DIRECTIONS), np.int32)
    for bundle, crossings in zip(BUNDLES, found, strict=True):
        step = int(lattice.steps[0, bundle.direction]), int(lattice.steps[1, bundle.direction])
        _place_cuts(sign, slot, cut, face, bundle.direction, step, lattice.strides, *crossings.line_data(bundle))
    return Sample(
        lattice=lattice,
        sign=sign,
        near=near,
        slot=slot,
        cut=cut,
        face=face,
        inside=int((sign > 0).sum()),
        thin=thin_points(sign, lattice, found),
        doubled=doubled * lattice.spacing**3 / 2.0,
        unresolved=_settle(sign, near, cut, lattice.steps),
        unbalanced=sum(crossings.unbalanced for crossings in found),
    )


@kernel
def _mark_inside(
    sign: NDArray[np.int8],
    strides: NDArray[np.int64],
    frame: NDArray[np.int64],
    low: NDArray[np.int64],
    columns: int,
    start: NDArray[np.int64],
    height: NDArray[np.float64],
    face: NDArray[np.int32],
    turn: NDArray[np.int8],
) -> float:
    """Set the points of positive winding number to +1; return the summed length of multiple winding in steps."""
    doubled = 0.0
    for line in range(start.shape[0] - 1):
        winding = 0
        for i in range(start[line], start[line + 1] - 1):
            winding += turn[i]
            length = height[i + 1] - height[i]
            doubled += (winding - 1 if winding > 0 else winding) * length
            if winding <= 0:
                continue
            first, last = int(np.ceil(height[i])), int(np.floor(height[i + 1]))
            u, v = low[0] + line // columns, low[1] + line % columns
            for w in range(first, last + 1):
                sign[lattice_number(frame, strides, u, v, w)] = 1
    return doubled


def _near_points(sign: NDArray[np.int8], steps: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    slot = np.full(len(sign), -1, np.int32)
    _number_near(sign, steps, slot)
    return slot, np.flatnonzero(slot >= 0).astype(np.int32)


@kernel
def _number_near(sign: NDArray[np.int8], steps: NDArray[np.int64], slot: NDArray[np.int32]) -> None:
    # The margin of the lattice is outside, so only inside points need their neighbours looked at.
    for p in range(sign.shape[0]):
        if sign[p] > 0:
            for way in range(steps.shape[1]):
                q = p + steps[p & 1, way]
                if sign[q] < 0:
                    slot[p] = slot[q] = 0
    n = 0
    for p in range(sign.shape[0]):
        if slot[p] == 0:
            slot[p] = n
            n += 1


@kernel
def _place_cuts(
    sign: NDArray[np.int8],
    slot: NDArray[np.int32],
    cut: NDArray[np.float64],
    face: NDArray[np.int32],
    direction: int,
    step: tuple[int, int],
    strides: NDArray[np.int64],
    frame: NDArray[np.int64],
    low: NDArray[np.int64],
    columns: int,
    start: NDArray[np.int64],
    height: NDArray[np.float64],
    triangle: NDArray[np.int32],
    turn: NDArray[np.int8],
) -> None:
    """Record the first crossing between winding <= 0 and > 0 on each edge of a bundle."""
    for line in range(start.shape[0] - 1):
        u, v = low[0] + line // columns, low[1] + line % columns
        winding = 0
        for i in range(start[line], start[line + 1]):
            before = winding
            winding += turn[i]
            if (before > 0) == (winding > 0):
                continue
            w = int(np.floor(height[i]))
            t = height[i] - w
            p = lattice_number(frame, strides, u, v, w)
            if _record(sign, slot, cut, face, direction, step, p, t, triangle[i]):
                continue
            # Another bundle saw this crossing on the far side of the lattice point: it belongs to the next edge.
            if t < _ROUNDING:
                p = lattice_number(frame, strides, u, v, w - 1)
                _record(sign, slot, cut, face, direction, step, p, 1.0, triangle[i])
            elif t > 1.0 - _ROUNDING:
                p = lattice_number(frame, strides, u, v, w + 1)
                _record(sign, slot, cut, face, direction, step, p, 0.0, triangle[i])


@scalar
def _record(
    sign: NDArray[np.int8],
    slot: NDArray[np.int32],
    cut: NDArray[np.float64],
    face: NDArray[np.int32],
    direction: int,
    step: tuple[int, int],
    p: int,
    t: float,
    triangle: int,
) -> bool:
    q = p + (step[1] if p & 1 else step[0])
    if sign[p] == sign[q] or cut[slot[p], direction] <= 1.0:
        return False
    cut[slot[p], direction] = t
    face[slot[p], direction] = triangle
    return True


@kernel
def _settle(sign: NDArray[np.int8], near: NDArray[np.int32], cut: NDArray[np.float64], steps: NDArray[np.int64]) -> int:
    unresolved = 0
    for i in range(near.shape[0]):
        p = near[i]
        for d in range(cut.shape[1]):
            if sign[p + steps[p & 1, d]] != sign[p] and cut[i, d] > 1.0:
                cut[i, d] = 0.5
                unresolved += 1
    return unresolved
