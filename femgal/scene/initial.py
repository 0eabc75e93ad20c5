# SPDX-License-Identifier: BSD-3-Clause
"""Shapes in which a body may start: at rest, random, flattened, on a sphere, stretched."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.scene.problems import Problem, SceneError
from femgal.scene.select import bounding_box, describe, describe_box, select
from femgal.scene.shapes import Flat, OnSphere, Random, Rest, Stretched

Floats = NDArray[np.float64]


def initial_positions(
    initial: Rest | Random | Flat | OnSphere | Stretched, points: Floats, key: str, source: str
) -> Floats:
    """Return the start positions [m] of a body's vertices, shape [n, 3].

    Parameters
    ----------
    initial : What the scene asks for.
    points : Rest positions [m] of the placed body, shape [n, 3].
    key, source : Where it stands (``bodies[0].initial``) in which scene, for messages.

    Raises
    ------
    SceneError
        A pull that selects nothing.
    """
    if isinstance(initial, Random):
        return _random(initial, points)
    if isinstance(initial, Flat):
        return _flat(initial, points)
    if isinstance(initial, OnSphere):
        return _on_sphere(initial, points)
    if isinstance(initial, Stretched):
        return _stretched(initial, points, key, source)
    return points.copy()


def _random(initial: Random, points: Floats) -> Floats:
    low, high = bounding_box(points)
    middle, half = 0.5 * (low + high), 0.5 * initial.scale * (high - low)
    return np.random.default_rng(initial.seed).uniform(middle - half, middle + half, points.shape)


def _flat(initial: Flat, points: Floats) -> Floats:
    normal = np.asarray(initial.normal)
    normal = normal / np.linalg.norm(normal)
    above = points @ normal
    above -= above.min()
    kept = above * min(initial.thickness / above.max(), 1.0)
    return points - np.outer(above - kept, normal)


def _on_sphere(initial: OnSphere, points: Floats) -> Floats:
    low, high = bounding_box(points)
    middle = 0.5 * (low + high)
    radius = 0.5 * float((high - low).max()) if initial.radius is None else initial.radius
    # Normally distributed vectors have no preferred direction: their directions are uniform on the sphere.
    rays = np.random.default_rng(initial.seed).standard_normal(points.shape)
    if initial.placement == "projected":
        off_center = np.linalg.norm(points - middle, axis=1) > 1e-12 * float((high - low).max())
        rays[off_center] = (points - middle)[off_center]
    return middle + radius * rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _stretched(initial: Stretched, points: Floats, key: str, source: str) -> Floats:
    box = bounding_box(points)
    moved = points.copy()
    for number, pull in enumerate(initial.pulls):
        chosen = select(pull.where, points, box)
        if not chosen.any():
            found = f"{describe(pull.where)}; the body spans {describe_box(box)}"
            problem = Problem(f"{key}.pulls[{number}].where", "selects no vertex", found, "at least one vertex")
            raise SceneError([problem], source=source)
        moved[chosen] += np.asarray(pull.offset)
    return moved
