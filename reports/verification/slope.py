# SPDX-License-Identifier: BSD-3-Clause
"""Slope triangles: what an order of convergence looks like, drawn beside the curve that should have it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

Point = tuple[float, float]

_LONGEST_LEG = 0.5  # decades


@dataclass(frozen=True)
class SlopeTriangle:
    """A right triangle under a falling or rising curve.

    Parameters
    ----------
    order : The order p of y ~ x^p.
    foot, corner, tip : Points in data units; from foot to corner x changes, from corner to tip y does.
    """

    order: float
    foot: Point
    corner: Point
    tip: Point

    @property
    def points(self) -> tuple[Point, Point, Point]:
        """Its three corners."""
        return self.foot, self.corner, self.tip


def slope_triangle(order: float, curves: Sequence[Sequence[Point]], gap: float) -> SlopeTriangle | None:
    """The triangle of an order under the curve that comes nearest to it; None where no curve has two points.

    Parameters
    ----------
    order : Its sign is that of the curve: an error that falls with the number of steps has the same order as one that
        rises with their size.
    curves : Points with positive coordinates, ordered by x.
    gap : Distance from the curve, in decades of y.
    """
    lines = [curve for curve in curves if len(curve) > 1 and curve[0][0] < curve[-1][0]]
    if not lines:
        return None
    curve = min(lines, key=lambda line: abs(abs(_trend(line)) - abs(order)))
    rise = math.copysign(abs(order), _trend(curve))
    # In the middle third: at the ends, labels of the axes are near.
    length = min(_LONGEST_LEG, math.log10(curve[-1][0] / curve[0][0]) / 3.0)
    middle = 0.5 * (math.log10(curve[0][0]) + math.log10(curve[-1][0]))
    left, right = middle - 0.5 * length, middle + 0.5 * length
    # Low enough that no point of the curve above the triangle touches its long side.
    below = min(_log_y(curve, x) - rise * (x - left) for x in (left, middle, right)) - gap
    low, high = sorted((below, below + rise * length))
    foot, corner_x, tip_y = (left, right, high) if rise > 0 else (right, left, high)
    return SlopeTriangle(abs(order), _exp(foot, low), _exp(corner_x, low), _exp(corner_x, tip_y))


def _trend(curve: Sequence[Point]) -> float:
    (x0, y0), (x1, y1) = curve[0], curve[-1]
    return math.log(y1 / y0) / math.log(x1 / x0)


def _log_y(curve: Sequence[Point], log_x: float) -> float:
    """Height of the curve over a place between its points, both logarithms."""
    points = [(math.log10(x), math.log10(y)) for x, y in curve]
    for (x0, y0), (x1, y1) in pairwise(points):
        if x0 <= log_x <= x1 and x1 > x0:
            return y0 + (y1 - y0) * (log_x - x0) / (x1 - x0)
    return points[-1][1]


def _exp(log_x: float, log_y: float) -> Point:
    return 10.0**log_x, 10.0**log_y
