# SPDX-License-Identifier: BSD-3-Clause
"""Plots of the verification report.

1. A logarithmic axis maps equal ratios to equal lengths, and labels powers of ten, or 1, 2, 5 times them where there
   are few.
2. Labels of small and large numbers carry an exponent; the label is the number.
3. A slope triangle rises by its order, lies below the curve that comes nearest to the order, and follows its direction.
4. Points that are not positive numbers are left out of the drawing, counted in the legend, and kept in the numbers.
5. A plot without a drawable point says so; texts are escaped.
6. The CSV holds every point and reads back.
"""

from __future__ import annotations

import csv
import io
import math
import re
from itertools import pairwise

import pytest

from reports.verification.figure import csv_text, figure
from reports.verification.plot import drawable, plot_svg
from reports.verification.scale import log_scale, tick_label
from reports.verification.slope import slope_triangle
from tests.reports.verification_samples import CONVERGENCE, HURTS, SUBSTEPS, UNDRAWABLE, row


def test_scale_is_logarithmic():
    scale = log_scale([1e-3, 10.0], 50.0, 450.0)
    assert scale(1e-1) - scale(1e-2) == pytest.approx(scale(1.0) - scale(1e-1))
    assert 50.0 < scale(1e-3) < scale(10.0) < 450.0
    assert scale.ticks() == pytest.approx([1e-3, 1e-2, 1e-1, 1.0, 10.0])


@pytest.mark.parametrize(
    ("values", "ticks"),
    [([25, 800], [50, 100, 200, 500]), ([0.03, 0.25], [0.05, 0.1, 0.2]), ([5.0, 5.0], [5.0, 10.0])],
)
def test_short_scales_have_labels_between_powers(values, ticks):
    assert log_scale(values, 0.0, 100.0).ticks() == pytest.approx(ticks)


def test_long_scales_have_few_labels():
    ticks = log_scale([1e-16, 1.0], 0.0, 100.0).ticks()
    assert 3 <= len(ticks) <= 7
    assert all(math.log10(tick) == pytest.approx(round(math.log10(tick))) for tick in ticks)


@pytest.mark.parametrize("value", [1e-12, 2e-5, 5e-3, 0.01, 0.2, 1.0, 50.0, 5000.0, 1e4, 2e6])
def test_labels_are_their_number(value):
    text, exponent = tick_label(value)
    leading = text.replace("\u00d710", "") if "\u00d7" in text else "1" if exponent else text
    assert float(leading) * 10.0 ** int(exponent or 0) == pytest.approx(value)


@pytest.mark.parametrize(("order", "of"), [(2.0, 2.0), (1.0, 1.0), (1.9, 2.0)])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_slope_triangle(order, of, direction):
    x = [1.0, 2.0, 4.0, 8.0, 16.0]
    curves = {p: [(a, 3.0 * p * a ** (p * direction)) for a in x] for p in (1.0, 2.0)}
    triangle = slope_triangle(order, list(curves.values()), 0.2)
    (xf, yf), (xc, yc), (xt, yt) = triangle.points
    assert (yf, xt) == (yc, xc)
    assert abs(math.log(yt / yf) / math.log(xc / xf)) == pytest.approx(order)
    assert (xc > xf) == (direction > 0)
    assert yt > yf
    for a, b in triangle.points:
        assert b <= 3.0 * of * a ** (of * direction) * 10.0**-0.1
        assert x[0] < a < x[-1]


def test_no_triangle_without_a_curve():
    assert slope_triangle(2.0, [[(1.0, 1.0)], []], 0.2) is None


def test_what_cannot_be_drawn_is_said():
    assert drawable(UNDRAWABLE["curves"][0]) == []
    drawn = figure(UNDRAWABLE, row("study/left"))
    assert "nothing to draw" in drawn
    assert "3 of 3 points not positive" in drawn
    assert "<script" not in drawn
    assert "&lt;script&gt;" in drawn
    assert '<td class="number">nan</td>' in drawn


def test_drawing():
    drawn = plot_svg(CONVERGENCE)
    for label in (CONVERGENCE["x"], CONVERGENCE["y"], CONVERGENCE["title"]):
        assert label in drawn
    assert drawn.count('class="mark"') == 8
    assert drawn.count('class="triangle"') == 2
    pixels = [float(number) for number in re.findall(r"translate\(([\d.]+) [\d.]+\)", drawn)]
    steps = [b - a for a, b in pairwise(pixels[:4])]
    assert steps == pytest.approx([steps[0]] * 3, abs=0.11)


def test_numbers_and_csv_hold_every_point():
    drawn = figure(SUBSTEPS, row("study/substeps"))
    assert drawn.count("<td") == 2 * 18
    lines = list(csv.reader(io.StringIO(csv_text(SUBSTEPS))))
    assert lines[0] == ["curve", SUBSTEPS["x"], SUBSTEPS["y"]]
    expected = [(c["name"], x, y) for c in SUBSTEPS["curves"] for x, y in zip(c["x"], c["y"], strict=True)]
    assert [(name, float(x), float(y)) for name, x, y in lines[1:]] == expected
    assert HURTS in next(csv.reader(io.StringIO(csv_text(UNDRAWABLE).split("\n", 1)[1])))
