# SPDX-License-Identifier: BSD-3-Clause
"""Which points a selector holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.scene.shapes import Selector

Points = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Borders belong to the region; scaling and turning a body moves a point off its border by rounding.
_BORDER = 1e-9


def bounding_box(points: Points) -> tuple[Points, Points]:
    """Lowest and highest corner [m] of the box around points, shape [n, 3] -> [3], [3]."""
    return points.min(axis=0), points.max(axis=0)


def select(selector: Selector, points: Points, box: tuple[Points, Points]) -> Mask:
    """Return which points a selector holds.

    Parameters
    ----------
    selector : The region, in metres or relative to the box.
    points : Rest positions [m], shape [n, 3].
    box : Bounding box of the body that the points belong to.

    Returns
    -------
    Mask, shape [n]; points on the border of a region, within 1e-9 of the body's longest side, belong to it.
    """
    border = _BORDER * float((box[1] - box[0]).max())
    if selector.box is not None:
        low, high = (_metres(corner, selector, box) for corner in (selector.box.min, selector.box.max))
        inside = (points >= low - border) & (points <= high + border)
        return np.asarray(inside.all(axis=1))
    if selector.sphere is not None:
        distance = np.linalg.norm(points - _metres(selector.sphere.center, selector, box), axis=1)
        return np.asarray(distance <= selector.sphere.radius * _unit(selector, box) + border)
    if selector.halfspace is not None:
        height = _along(selector.halfspace.normal, points - _metres(selector.halfspace.point, selector, box))
        return np.asarray(height >= -border)
    if selector.tip is not None:
        height = _along(selector.tip.direction, points)
        return np.asarray(height >= height.max() - selector.tip.depth * _unit(selector, box) - border)
    return np.full(len(points), selector.all)


def describe(selector: Selector) -> str:
    """Return a selector in words: ``box from (0, 0, 0.9) to (1, 1, 1), relative to the body``."""
    if selector.box is not None:
        text = f"box from {describe_point(selector.box.min)} to {describe_point(selector.box.max)}"
    elif selector.sphere is not None:
        text = f"sphere of radius {selector.sphere.radius:g} about {describe_point(selector.sphere.center)}"
    elif selector.halfspace is not None:
        point, normal = selector.halfspace.point, selector.halfspace.normal
        text = f"halfspace beyond {describe_point(point)} towards {describe_point(normal)}"
    elif selector.tip is not None:
        text = f"tip of depth {selector.tip.depth:g} towards {describe_point(selector.tip.direction)}"
    else:
        return "all" if selector.all else "none"
    return text + (", relative to the body" if selector.relative else " [m]")


def describe_point(point: Points | tuple[float, float, float]) -> str:
    """Return a point in words: ``(0, 0, 0.96)``."""
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"


def describe_box(box: tuple[Points, Points]) -> str:
    """Return a bounding box in words: ``(0, 0, 0) to (1, 1, 1) [m]``."""
    return f"{describe_point(box[0])} to {describe_point(box[1])} [m]"


def _along(direction: tuple[float, float, float], points: Points) -> Points:
    vector = np.asarray(direction)
    return points @ (vector / np.linalg.norm(vector))


def _metres(point: tuple[float, float, float], selector: Selector, box: tuple[Points, Points]) -> Points:
    return box[0] + np.asarray(point) * (box[1] - box[0]) if selector.relative else np.asarray(point)


def _unit(selector: Selector, box: tuple[Points, Points]) -> float:
    return float((box[1] - box[0]).max()) if selector.relative else 1.0
