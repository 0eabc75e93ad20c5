# SPDX-License-Identifier: BSD-3-Clause
"""Puts a mesh where the scene wants the body: upright, scaled, turned, translated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.scene.model import Body
from femgal.scene.motion import rotation_matrix
from femgal.scene.select import bounding_box

Floats = NDArray[np.float64]

# Quarter turns about the file's y and x axis: exact, and they keep the orientation of the tetrahedra.
_UPRIGHT = {
    "x": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}


def placed(points: Floats, body: Body, shape: Floats | None = None) -> Floats:
    """Return the rest positions [m] of a body's vertices in the scene, shape [n, 3].

    Parameters
    ----------
    points : Coordinates of the mesh, shape [n, 3].
    body : Its `up`, `height` or `size`, `rotate` and `translate`, applied in this order; see `Body` for where a
        scaled body stands.
    shape : Points of the surface that the mesh fills, in the same coordinates, shape [s, 3]. Extents and centres are
        those of the surface, so that they do not depend on how finely it was filled; those of the mesh when None.
    """
    scaled = body.height is not None or body.size is not None
    count = len(points) if shape is None else len(shape)
    x = (points if shape is None else np.concatenate([shape, points])) @ _UPRIGHT[body.up].T
    if scaled:
        low, high = bounding_box(x[:count])
        # Centred before scaling: a file whose coordinates lie far from the origin would lose digits.
        x = (x - 0.5 * (low + high)) * _factor(body, high - low)
    for turn in body.rotate:
        low, high = bounding_box(x[:count])
        axis = np.asarray(turn.axis)
        matrix = rotation_matrix(axis / np.linalg.norm(axis), np.radians(turn.degrees))
        x = 0.5 * (low + high) + (x - 0.5 * (low + high)) @ matrix.T
    if scaled:
        low, high = bounding_box(x[:count])
        x = x - np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])
    return x[-len(points) :] + np.asarray(body.translate)


def _factor(body: Body, extent: Floats) -> float:
    if body.height is not None:
        return body.height / float(extent[2])
    return (body.size or 1.0) / float(extent.max())
