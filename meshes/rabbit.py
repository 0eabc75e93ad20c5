# SPDX-License-Identifier: BSD-3-Clause
"""The rabbit: the animal that is always there, made of formulas.

It sits on z = 0 looking along +x, is 1 m tall to the tip of its left ear (+y), which stands a tenth of a metre above
the right one, so that a plane just below the top selects the tip of one ear only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError
from meshes.isosurface import Vector, count_triangles, isosurface
from meshes.jit import kernel, scalar
from meshes.types import Origin, Points, TriMesh

_LOWER, _UPPER = (-0.55, -0.40, -0.08), (0.50, 0.40, 1.10)
_CONE, _ELLIPSOID = 0.0, 1.0
# Width [m] over which the mirror plane of paired parts is rounded: |y| has a kink, the animal should not.
_MIRROR = 0.02


@dataclass(frozen=True)
class _Ellipsoid:
    """Half axes ``radii``, turned by ``pitch`` about y (nose down) and ``roll`` about x (top to the right), degrees."""

    centre: Vector
    radii: Vector
    blend: float
    pitch: float = 0.0
    roll: float = 0.0
    paired: bool = False

    def row(self) -> list[float]:
        """Parameters for the kernel."""
        p, r = np.radians(self.pitch), np.radians(self.roll)
        turn_y = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
        turn_x = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
        turned = (turn_x @ turn_y).T.ravel()
        return [_ELLIPSOID, float(self.paired), self.blend, *self.centre, *self.radii, *turned]


@dataclass(frozen=True)
class _Cone:
    """Capsule between two points whose radius changes linearly."""

    start: Vector
    end: Vector
    radii: tuple[float, float]
    blend: float
    paired: bool = False

    def row(self) -> list[float]:
        """Parameters for the kernel."""
        return [_CONE, float(self.paired), self.blend, *self.start, *self.end, *self.radii, *(0.0,) * 7]


_PARTS: tuple[_Ellipsoid | _Cone, ...] = (
    # body
    _Ellipsoid((-0.11, 0.0, 0.24), (0.235, 0.185, 0.215), 0.01, pitch=-12),
    _Ellipsoid((0.06, 0.0, 0.29), (0.135, 0.135, 0.205), 0.10, pitch=8),
    _Ellipsoid((-0.335, 0.0, 0.17), (0.075, 0.075, 0.075), 0.02),
    # legs
    _Ellipsoid((-0.10, 0.145, 0.165), (0.150, 0.080, 0.150), 0.04, pitch=-20, paired=True),
    _Cone((-0.13, 0.168, 0.046), (0.085, 0.184, 0.047), (0.046, 0.047), 0.03, paired=True),
    _Cone((0.11, 0.075, 0.28), (0.165, 0.075, 0.06), (0.060, 0.050), 0.04, paired=True),
    _Ellipsoid((0.198, 0.076, 0.042), (0.068, 0.047, 0.042), 0.02, paired=True),
    # head
    _Ellipsoid((0.145, 0.0, 0.545), (0.160, 0.130, 0.130), 0.07, pitch=12),
    _Ellipsoid((0.200, 0.066, 0.488), (0.080, 0.066, 0.062), 0.05, paired=True),
    _Ellipsoid((0.262, 0.0, 0.502), (0.070, 0.066, 0.056), 0.035),
    # left ear upright, right ear lower and tipped outwards
    _Ellipsoid((0.055, 0.070, 0.800), (0.048, 0.070, 0.205), 0.035, pitch=-6, roll=-5),
    _Ellipsoid((0.050, -0.125, 0.735), (0.048, 0.070, 0.190), 0.035, pitch=-10, roll=22),
    # eyes and nose
    _Ellipsoid((0.222, 0.099, 0.578), (0.026, 0.020, 0.030), 0.003, paired=True),
    _Ellipsoid((0.326, 0.0, 0.521), (0.017, 0.025, 0.015), 0.004),
)
_SOLIDS = np.array([part.row() for part in _PARTS])


def rabbit_surface(triangles: int = 40_000) -> TriMesh:
    """Closed surface of the rabbit [m]: z from 0 to 1, about ``triangles`` triangles.

    Raises
    ------
    InputError
        A number of triangles outside 2000 to 20 million: the ears and feet need the lower one.
    """
    if not 2_000 <= triangles <= 20_000_000:
        raise InputError("impossible triangle count", where="rabbit", found=triangles, allowed="2000 to 20000000")
    return _standing(isosurface(rabbit_values, _LOWER, _UPPER, _spacing_for(triangles)))


def rabbit_values(points: Points) -> NDArray[np.float64]:
    """Implicit function of the rabbit before it is scaled to 1 m: negative inside, near the surface a distance [m].

    Parameters
    ----------
    points : Positions [m], shape [n, 3].
    """
    values = np.empty(len(points))
    _union(np.ascontiguousarray(points), _SOLIDS, values)
    return values


def _spacing_for(triangles: int) -> float:
    """Lattice spacing [m] for a number of triangles: the count grows with its inverse square.

    Lattices coarser than the feet and eyes depart from that law and are counted again.
    """
    spacing = 0.04
    for _ in range(4):
        count = count_triangles(rabbit_values, _LOWER, _UPPER, spacing)
        if abs(count - triangles) <= 0.02 * triangles:
            break
        spacing *= float(np.sqrt(count / triangles))
        if spacing < 0.02:
            break
    return spacing


def _standing(mesh: TriMesh) -> TriMesh:
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    scale = 1.0 / (high[2] - low[2])
    points = (mesh.points - [0.0, 0.0, low[2]]) * scale
    return TriMesh(points, mesh.cells, Origin("rabbit"))


@scalar
def _smooth_min(a: float, b: float, width: float) -> float:
    """Minimum whose kink is rounded by a parabola over ``width``."""
    overlap = max(width - abs(a - b), 0.0) / width
    return min(a, b) - 0.25 * width * overlap * overlap


@scalar
def _cone(x: float, y: float, z: float, s: NDArray[np.float64]) -> float:
    ux, uy, uz = s[6] - s[3], s[7] - s[4], s[8] - s[5]
    px, py, pz = x - s[3], y - s[4], z - s[5]
    t = (px * ux + py * uy + pz * uz) / (ux * ux + uy * uy + uz * uz)
    t = min(max(t, 0.0), 1.0)
    dx, dy, dz = px - t * ux, py - t * uy, pz - t * uz
    return np.sqrt(dx * dx + dy * dy + dz * dz) - (s[9] + t * (s[10] - s[9]))


@scalar
def _ellipsoid(x: float, y: float, z: float, s: NDArray[np.float64]) -> float:
    """First-order distance: f / |grad f| with f = |p / r|^2 - 1 written so that it is Lipschitz far away."""
    px, py, pz = x - s[3], y - s[4], z - s[5]
    a = (s[9] * px + s[10] * py + s[11] * pz) / s[6]
    b = (s[12] * px + s[13] * py + s[14] * pz) / s[7]
    c = (s[15] * px + s[16] * py + s[17] * pz) / s[8]
    length = np.sqrt(a * a + b * b + c * c)
    slope = np.sqrt((a / s[6]) ** 2 + (b / s[7]) ** 2 + (c / s[8]) ** 2)
    return length * (length - 1.0) / max(slope, 1e-9)


@kernel
def _union(points: Points, solids: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        mirrored = np.sqrt(y * y + _MIRROR * _MIRROR)
        total = 1e3
        for k in range(len(solids)):
            s = solids[k]
            side = mirrored if s[1] > 0.0 else y
            one = _ellipsoid(x, side, z, s) if s[0] == _ELLIPSOID else _cone(x, side, z, s)
            total = _smooth_min(total, one, s[2])
        values[i] = total
