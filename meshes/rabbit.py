# SPDX-License-Identifier: BSD-3-Clause
"""The rabbit: the animal that is always there, made of formulas.

It sits on z = 0 looking along +x, is 1 m tall to the tip of its left ear (+y), which stands a tenth of a metre above
the right one, so that a plane just below the top selects the tip of one ear only.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError
from meshes.isosurface import Sampled, Vector, sampled
from meshes.jit import kernel, scalar
from meshes.types import Origin, Points, TriMesh

_LOWER, _UPPER = (-0.55, -0.40, -0.08), (0.50, 0.40, 1.10)
_CONE, _ELLIPSOID = 0.0, 1.0
# Width [m] over which the mirror plane of paired parts is rounded: |y| has a kink, the animal should not.
_MIRROR = 0.02
_MOST_LATTICES = 4
_BLOCK = 256  # points whose coordinates stay in the cache while the parts go over them


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
        axes = turned.reshape(3, 3) / np.array(self.radii)[:, None]
        return [_ELLIPSOID, float(self.paired), self.blend, *self.centre, *axes.ravel(), *(1.0 / np.array(self.radii))]


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
        along = np.subtract(self.end, self.start)
        radius = self.radii[0], self.radii[1] - self.radii[0]
        place = *self.start, *along, *(along / (along @ along))
        return [_CONE, float(self.paired), self.blend, *place, *radius, *(0.0,) * 4]


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
    return _standing(_sampled_for(triangles).surface())


def rabbit_values(points: Points) -> NDArray[np.float64]:
    """Implicit function of the rabbit before it is scaled to 1 m: negative inside, near the surface a distance [m].

    Parameters
    ----------
    points : Positions [m], shape [n, 3].
    """
    values = np.empty(len(points))
    _union(np.ascontiguousarray(points), _SOLIDS, values)
    return values


def _sampled_for(triangles: int) -> Sampled:
    """The rabbit on the lattice that gives a number of triangles: it grows with the inverse square of the spacing.

    Lattices coarser than the feet and eyes depart from that law and are counted again.
    """
    found = sampled(rabbit_values, _LOWER, _UPPER, 0.04)
    for _ in range(_MOST_LATTICES):
        if abs(found.triangles - triangles) <= 0.02 * triangles:
            break
        spacing = found.spacing * float(np.sqrt(found.triangles / triangles))
        found = sampled(rabbit_values, _LOWER, _UPPER, spacing)
    return found


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
def _cone(x: float, y: float, z: float, s: tuple[float, ...]) -> float:
    px, py, pz = x - s[0], y - s[1], z - s[2]
    t = min(max(px * s[6] + py * s[7] + pz * s[8], 0.0), 1.0)
    dx, dy, dz = px - t * s[3], py - t * s[4], pz - t * s[5]
    return sqrt(dx * dx + dy * dy + dz * dz) - (s[9] + t * s[10])


@scalar
def _ellipsoid(x: float, y: float, z: float, s: tuple[float, ...]) -> float:
    """First-order distance: f / |grad f| with f = |p / r|^2 - 1 written so that it is Lipschitz far away."""
    px, py, pz = x - s[0], y - s[1], z - s[2]
    a = s[3] * px + s[4] * py + s[5] * pz
    b = s[6] * px + s[7] * py + s[8] * pz
    c = s[9] * px + s[10] * py + s[11] * pz
    length = sqrt(a * a + b * b + c * c)
    a, b, c = a * s[12], b * s[13], c * s[14]
    return length * (length - 1.0) / max(sqrt(a * a + b * b + c * c), 1e-9)


@kernel
def _union(points: Points, solids: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """Smooth minimum over the parts; one part after the other over a block of points, which is vectorised."""
    x, y, z, mirrored = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    total = np.empty(_BLOCK)
    for first in range(0, len(points), _BLOCK):
        n = min(_BLOCK, len(points) - first)
        for i in range(n):
            x[i], y[i], z[i] = points[first + i, 0], points[first + i, 1], points[first + i, 2]
            mirrored[i] = sqrt(y[i] * y[i] + _MIRROR * _MIRROR)
            total[i] = 1e3
        for k in range(len(solids)):
            s = (solids[k, 3], solids[k, 4], solids[k, 5], solids[k, 6], solids[k, 7], solids[k, 8], solids[k, 9],
                 solids[k, 10], solids[k, 11], solids[k, 12], solids[k, 13], solids[k, 14], solids[k, 15],
                 solids[k, 16], solids[k, 17])  # fmt: skip
            side, blend = mirrored if solids[k, 1] > 0.0 else y, solids[k, 2]
            if solids[k, 0] == _ELLIPSOID:
                for i in range(n):
                    total[i] = _smooth_min(total[i], _ellipsoid(x[i], side[i], z[i], s), blend)
            else:
                for i in range(n):
                    total[i] = _smooth_min(total[i], _cone(x[i], side[i], z[i], s), blend)
        for i in range(n):
            values[first + i] = total[i]
