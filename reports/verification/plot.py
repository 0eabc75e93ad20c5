# SPDX-License-Identifier: BSD-3-Clause
"""Curves with logarithmic axes as inline SVG: text stays text, colours are the page's and follow light and dark."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from reports.verification.markup import Markup, element, join
from reports.verification.scale import LogScale, log_scale, tick_label
from reports.verification.slope import Point, SlopeTriangle, slope_triangle

WIDTH, HEIGHT = 460, 330
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 442, 30, 284

# Shapes of the marks, so that curves can be told apart without colours; drawn around the origin.
_MARKS = (
    "M-3.6,0a3.6,3.6 0 1,0 7.2,0a3.6,3.6 0 1,0 -7.2,0",
    "M-3.3,-3.3h6.6v6.6h-6.6z",
    "M0,-4.4L4.2,3.2H-4.2z",
    "M0,-4.6L4.6,0L0,4.6L-4.6,0z",
    "M0,4.4L4.2,-3.2H-4.2z",
    "M-3.4,-3.4L3.4,3.4M-3.4,3.4L3.4,-3.4",
)
COLOURS = len(_MARKS)


def shape(number: int) -> str:
    """Shape of a curve's marks: with the colour, which comes round every COLOURS curves, it tells COLOURS^2 apart."""
    return _MARKS[(number + number // COLOURS) % COLOURS]


def plot_svg(plot: Mapping[str, Any]) -> Markup:
    """One plot; a sentence in place of axes where no point can be drawn."""
    curves = [drawable(curve) for curve in plot["curves"]]
    points = [point for curve in curves for point in curve]
    if not points:
        return element("p", "No point with positive coordinates: nothing to draw.", class_="empty")
    triangles = _triangles(plot.get("slopes", ()), curves)
    corners = [corner for triangle in triangles for corner in triangle.points]
    x = log_scale([p[0] for p in points + corners], _LEFT, _RIGHT)
    y = log_scale([p[1] for p in points + corners], _BOTTOM, _TOP)
    return element(
        "svg",
        element("title", plot["title"]),
        _x_axis(x, plot["x"]),
        _y_axis(y, plot["y"]),
        *(_triangle(triangle, x, y) for triangle in triangles),
        *(_curve(curve, number, x, y) for number, curve in enumerate(curves)),
        viewBox=f"0 0 {WIDTH} {HEIGHT}",
        role="img",
        class_="plot",
    )


def drawable(curve: Mapping[str, Any]) -> list[Point]:
    """Points that a logarithmic axis has room for, by increasing x."""
    pairs = zip(curve["x"], curve["y"], strict=True)
    return sorted((float(x), float(y)) for x, y in pairs if _is_positive(x) and _is_positive(y))


def mark(number: int) -> Markup:
    """A piece of a curve for the legend."""
    line = element("path", d="M1,7H25", class_="line")
    dot = element("path", d=shape(number), class_="mark", transform="translate(13 7)")
    return element("svg", line, dot, viewBox="0 0 26 14", class_=f"key c{number % COLOURS}", aria_hidden="true")


def _triangles(orders: Sequence[float], curves: list[list[Point]]) -> list[SlopeTriangle]:
    heights = [y for curve in curves for _, y in curve]
    gap = 0.09 * max(1.0, math.log10(max(heights) / min(heights)))
    found = (slope_triangle(order, curves, gap) for order in orders)
    return [triangle for triangle in found if triangle is not None]


def _x_axis(x: LogScale, label: str) -> Markup:
    lines = [element("path", d=f"M{x(tick):.1f},{_TOP}V{_BOTTOM}", class_="grid") for tick in x.ticks()]
    labels = [_label(tick, x(tick), _BOTTOM + 17, "middle") for tick in x.ticks()]
    baseline = element("path", d=f"M{_LEFT},{_BOTTOM}H{_RIGHT}", class_="axis")
    name = element("text", label, x=(_LEFT + _RIGHT) / 2, y=_BOTTOM + 38, text_anchor="middle", class_="name")
    return join(*lines, baseline, *labels, name)


def _y_axis(y: LogScale, label: str) -> Markup:
    lines = [element("path", d=f"M{_LEFT},{y(tick):.1f}H{_RIGHT}", class_="grid") for tick in y.ticks()]
    labels = [_label(tick, _LEFT - 7, y(tick) + 4, "end") for tick in y.ticks()]
    return join(*lines, *labels, element("text", label, x=6, y=15, class_="name"))


def _label(value: float, x: float, y: float, anchor: str) -> Markup:
    text, exponent = tick_label(value)
    raised = element("tspan", exponent, dy=-5, class_="exponent") if exponent else None
    return element("text", text, raised, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor, class_="tick")


def _curve(points: Sequence[Point], number: int, x: LogScale, y: LogScale) -> Markup:
    pixels = [(x(a), y(b)) for a, b in points]
    line = "M" + "L".join(f"{a:.1f},{b:.1f}" for a, b in pixels) if pixels else ""
    marks = (
        element("path", d=shape(number), transform=f"translate({a:.1f} {b:.1f})", class_="mark") for a, b in pixels
    )
    return element("g", element("path", d=line, class_="line"), *marks, class_=f"c{number % COLOURS}")


def _triangle(triangle: SlopeTriangle, x: LogScale, y: LogScale) -> Markup:
    foot, corner, tip = ((x(a), y(b)) for a, b in triangle.points)
    side = 1 if corner[0] > foot[0] else -1
    path = element(
        "path", d="M" + "L".join(f"{a:.1f},{b:.1f}" for a, b in (foot, corner, tip)) + "Z", class_="triangle"
    )
    one = element("text", "1", x=f"{(foot[0] + corner[0]) / 2:.1f}", y=f"{corner[1] + 13:.1f}", text_anchor="middle")
    order = element(
        "text",
        f"{triangle.order:g}",
        x=f"{corner[0] + 6 * side:.1f}",
        y=f"{(corner[1] + tip[1]) / 2 + 4:.1f}",
        text_anchor="start" if side > 0 else "end",
    )
    return element("g", path, one, order, class_="slope")


def _is_positive(value: float | str) -> bool:
    return not isinstance(value, str) and math.isfinite(value) and value > 0.0
