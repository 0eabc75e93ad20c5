# SPDX-License-Identifier: BSD-3-Clause
"""Prescribed motion of vertices: held, displaced along a path, or rotated about an axis."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femgal.scene.shapes import Path, Rotation

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """A function of time through given points, held before the first and after the last.

    Parameters
    ----------
    times : Times [s], increasing, shape [p].
    values : Values, shape [p, q].
    """

    times: Floats
    values: Floats

    def at(self, time: float) -> Floats:
        """Value at a time [s], shape [q]."""
        return np.array([np.interp(time, self.times, column) for column in self.values.T])

    def slope(self, time: float) -> Floats:
        """Slope just after a time [s], shape [q]; zero where the value is held."""
        piece = int(np.searchsorted(self.times, time, side="right")) - 1
        if piece < 0 or piece >= len(self.times) - 1:
            return np.zeros(self.values.shape[1])
        return (self.values[piece + 1] - self.values[piece]) / (self.times[piece + 1] - self.times[piece])

    @property
    def is_constant(self) -> bool:
        """Whether the value never changes."""
        return bool((self.values == self.values[0]).all())


_HELD = PiecewiseLinear(np.zeros(1), np.zeros((1, 3)))
_UNTURNED = PiecewiseLinear(np.zeros(1), np.zeros((1, 1)))


@dataclass(frozen=True, eq=False)
class Motion:
    """Prescribed motion of some vertices: x(t) = c + R(t) (X - c) + d(t).

    Parameters
    ----------
    vertices : Indices of the vertices, shape [k], int64, increasing.
    rest : Their rest positions X [m], shape [k, 3].
    offset : Displacement d [m] over time.
    angle : Angle [rad] of R over time.
    axis : Unit vector of the axis of R, shape [3].
    center : A point c of the axis [m], shape [3].
    """

    vertices: NDArray[np.int64]
    rest: Floats
    offset: PiecewiseLinear = _HELD
    angle: PiecewiseLinear = _UNTURNED
    axis: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    center: Floats = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def is_fixed(self) -> bool:
        """Whether the vertices stay in one place, at rest or displaced."""
        return self.offset.is_constant and self.angle.is_constant

    def positions(self, time: float) -> Floats:
        """Positions [m] at a time [s], shape [k, 3]."""
        return self._turned(time) + self.offset.at(time)

    def velocities(self, time: float) -> Floats:
        """Velocities [m/s] just after a time [s], shape [k, 3]."""
        spin = float(self.angle.slope(time)[0])
        return spin * np.cross(self.axis, self._turned(time) - self.center) + self.offset.slope(time)

    def _turned(self, time: float) -> Floats:
        angle = float(self.angle.at(time)[0])
        if angle == 0.0:
            return self.rest
        return self.center + (self.rest - self.center) @ rotation_matrix(self.axis, angle).T


def make_motion(vertices: NDArray, points: Floats, path: Path | None, rotation: Rotation | None) -> Motion:
    """Build the motion that a constraint prescribes.

    Parameters
    ----------
    vertices : Indices of the constrained vertices, shape [k].
    points : Rest positions [m] of all vertices, shape [n, 3].
    path, rotation : The constraint's tables; neither means held at rest.
    """
    indices = np.ascontiguousarray(vertices, np.int64)
    rest = points[indices]
    offset = _HELD if path is None else PiecewiseLinear(np.array(path.times), np.array(path.offsets))
    if rotation is None:
        return Motion(indices, rest, offset)
    radians = np.radians(np.array(rotation.degrees))[:, None]
    middle = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
    center = middle if rotation.center is None else np.array(rotation.center)
    return Motion(
        indices, rest, offset, PiecewiseLinear(np.array(rotation.times), radians), _unit(rotation.axis), center
    )


def rotation_matrix(axis: Floats, angle: float) -> Floats:
    """Matrix of a rotation by `angle` [rad] about a unit vector (Rodrigues' formula), shape [3, 3]."""
    K = np.cross(np.eye(3), axis)  # K v = axis x v
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


def _unit(axis: tuple[float, float, float]) -> Floats:
    vector = np.array(axis)
    return vector / np.linalg.norm(vector)
