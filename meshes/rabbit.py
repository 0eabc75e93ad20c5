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
from meshes.isosurface import isosurface
from meshes.jit import kernel, scalar
from meshes.types import Origin, Points, TriMesh

Vector = tuple[float, float, float]

_LOWER, _UPPER = (-0.55, -0.40, -0.08), (0.50, 0.40, 1.10)
_CONE, _ELLIPSOID = 0.0, 1.0


@dataclass(frozen=True)
class _Ellipsoid:
    """Half axes ``radii``, turned by ``pitch`` about y (nose down) and ``roll`` about x (top to the right), degrees."""

    centre: Vector
    radii: Vector
    blend: float
    pitch: float = 0.0
    roll: float = 0.0
    paired: bool = False

    def row(self, side: float) -> list[float]:
        """Parameters for the kernel; ``side`` = -1 mirrors to the animal's right."""
        x, y, z = self.centre
        p, r = np.radians(self.pitch), side * np.radians(self.roll)
        turn_y = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
        turn_x = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
        return [_ELLIPSOID, self.blend, x, side * y, z, *self.radii, *(turn_x @ turn_y).T.ravel()]


@dataclass(frozen=True)
class _Cone:
    """Capsule between two points whose radius changes linearly."""

    start: Vector
    end: Vector
    radii: tuple[float, float]
    blend: float
    paired: bool = False

    def row(self, side: float) -> list[float]:
        """Parameters for the kernel; ``side`` = -1 mirrors to the animal's right."""
        mirrored = [(x, side * y, z) for x, y, z in (self.start, self.end)]
        return [_CONE, self.blend, *mirrored[0], *mirrored[1], *self.radii, *(0.0,) * 7]


_PARTS: tuple[_Ellipsoid | _Cone, ...] = (
    # body
    _Ellipsoid((-0.11, 0.0, 0.24), (0.235, 0.185, 0.215), 0.01, pitch=-12),
    _Ellipsoid((0.06, 0.0, 0.29), (0.135, 0.135, 0.205), 0.10, pitch=8),
    _Ellipsoid((-0.335, 0.0, 0.17), (0.075, 0.075, 0.075), 0.02),
    # legs
    _Ellipsoid((-0.10, 0.145, 0.165), (0.150, 0.080, 0.150), 0.04, pitch=-20, paired=True),
    _Cone((-0.13, 0.165, 0.046), (0.10, 0.175, 0.048), (0.046, 0.048), 0.03, paired=True),
    _Cone((0.11, 0.075, 0.28), (0.165, 0.078, 0.06), (0.058, 0.046), 0.04, paired=True),
    _Ellipsoid((0.195, 0.080, 0.042), (0.070, 0.048, 0.042), 0.025, paired=True),
    # head
    _Ellipsoid((0.145, 0.0, 0.545), (0.160, 0.130, 0.130), 0.07, pitch=12),
    _Ellipsoid((0.200, 0.066, 0.488), (0.080, 0.066, 0.062), 0.05, paired=True),
    _Ellipsoid((0.262, 0.0, 0.502), (0.070, 0.066, 0.056), 0.035),
    # left ear upright, right ear lower and tipped outwards
    _Ellipsoid((0.055, 0.070, 0.800), (0.043, 0.068, 0.205), 0.035, pitch=-6, roll=-5),
    _Ellipsoid((0.050, -0.125, 0.735), (0.043, 0.068, 0.190), 0.035, pitch=-10, roll=22),
    # eyes and nose
    _Ellipsoid((0.222, 0.099, 0.578), (0.026, 0.020, 0.030), 0.003, paired=True),
    _Ellipsoid((0.326, 0.0, 0.521), (0.017, 0.025, 0.015), 0.004),
)
_SOLIDS = np.array([part.row(side) for part in _PARTS for side in ((1.0, -1.0) if part.paired else (1.0,))])


def rabbit_surface(triangles: int = 40_000) -> TriMesh:
    """Closed surface of the rabbit [m]: z from 0 to 1, about ``triangles`` triangles.

    Raises
    ------
    InputError
        A number of triangles outside 2000 to 20 million: the ears and feet need the lower one.
    """
    if not 2_000 <= triangles <= 20_000_000:
        raise InputError("impossible triangle count", where="rabbit", found=triangles, allowed="2000 to 20000000")
    # The count grows with the inverse square of the spacing: measured once on a coarse lattice.
    coarse = 0.04
    count = len(isosurface(rabbit_values, _LOWER, _UPPER, coarse, smoothing=0).cells)
    spacing = coarse * float(np.sqrt(count / triangles))
    mesh = isosurface(rabbit_values, _LOWER, _UPPER, spacing)
    return _standing(mesh)


def rabbit_values(points: Points) -> NDArray[np.float64]:
    """Implicit function of the rabbit before it is scaled to 1 m: negative inside, near the surface a distance [m].

    Parameters
    ----------
    points : Positions [m], shape [n, 3].
    """
    values = np.empty(len(points))
    _union(np.ascontiguousarray(points), _SOLIDS, values)
    return values


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
    ux, uy, uz = s[5] - s[2], s[6] - s[3], s[7] - s[4]
    px, py, pz = x - s[2], y - s[3], z - s[4]
    t = (px * ux + py * uy + pz * uz) / (ux * ux + uy * uy + uz * uz)
    t = min(max(t, 0.0), 1.0)
    dx, dy, dz = px - t * ux, py - t * uy, pz - t * uz
    return np.sqrt(dx * dx + dy * dy + dz * dz) - (s[8] + t * (s[9] - s[8]))


@scalar
def _ellipsoid(x: float, y: float, z: float, s: NDArray[np.float64]) -> float:
    """First-order distance: f / |grad f| with f = |p / r|^2 - 1 written so that it is Lipschitz far away."""
    px, py, pz = x - s[2], y - s[3], z - s[4]
    a = (s[8] * px + s[9] * py + s[10] * pz) / s[5]
    b = (s[11] * px + s[12] * py + s[13] * pz) / s[6]
    c = (s[14] * px + s[15] * py + s[16] * pz) / s[7]
    length = np.sqrt(a * a + b * b + c * c)
    slope = np.sqrt((a / s[5]) ** 2 + (b / s[6]) ** 2 + (c / s[7]) ** 2)
    return length * (length - 1.0) / max(slope, 1e-9)


@kernel
def _union(points: Points, solids: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        total = 1e3
        for k in range(len(solids)):
            s = solids[k]
            one = _ellipsoid(x, y, z, s) if s[0] == _ELLIPSOID else _cone(x, y, z, s)
            total = _smooth_min(total, one, s[1])
        values[i] = total
