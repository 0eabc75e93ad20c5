# SPDX-License-Identifier: BSD-3-Clause
"""Which points a selector holds.

1. Box, sphere, halfspace and tip hold the points that their definition says, borders included; a tip always
   holds the farthest point.
2. A point that rounding moved off a border still belongs to the region; one a thousandth off does not.
3. Relative selectors move and grow with the body: the same points are chosen after scaling and translating it.
4. `all` holds everything, `none` nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.scene.select import bounding_box, describe, describe_box, select
from femgal.scene.shapes import Selector

GRID = np.stack(np.meshgrid(*(np.arange(5.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def chosen(points=GRID, **keys):
    return select(Selector.model_validate(keys), points, bounding_box(points))


def test_box():
    found = GRID[chosen(box={"min": [1, 1, 1], "max": [2, 2, 3]})]
    assert len(found) == 2 * 2 * 3
    assert (found >= 1).all()
    assert (found <= [2, 2, 3]).all()


def test_sphere():
    found = chosen(sphere={"center": [2, 2, 2], "radius": 1.0})
    assert found.sum() == 7
    np.testing.assert_array_equal(found, np.linalg.norm(GRID - 2.0, axis=1) <= 1.0)


def test_halfspace_does_not_depend_on_the_length_of_the_normal():
    short, long = (
        chosen(halfspace={"point": [0, 0, 3], "normal": list(scale * np.array([0, 0.6, 0.8]))}) for scale in (1, 1e6)
    )
    np.testing.assert_array_equal(short, GRID @ [0, 0.6, 0.8] >= 2.4 - 1e-12)
    np.testing.assert_array_equal(short, long)


def test_tip():
    np.testing.assert_array_equal(
        chosen(tip={"direction": [0, 3, 4], "depth": 0.6}), GRID @ [0, 0.6, 0.8] >= 5.0 - 1e-12
    )


def test_a_tip_is_never_empty():
    points = np.random.default_rng(31415927).standard_normal((50, 3))
    for direction in np.random.default_rng(27182819).standard_normal((20, 3)):
        found = chosen(points, tip={"direction": direction.tolist(), "depth": 1e-9})
        np.testing.assert_array_equal(np.flatnonzero(found), [np.argmax(points @ direction)])


@pytest.mark.parametrize(
    "keys",
    [
        {"box": {"min": [0, 0, 4], "max": [4, 4, 4]}},
        {"sphere": {"center": [2, 2, 6], "radius": 2.0}},
        {"halfspace": {"point": [0, 0, 4], "normal": "z"}},
    ],
)
def test_borders_survive_rounding(keys):
    points = GRID.copy()
    points[:, 2] *= 1.0 - 1e-13
    assert chosen(points, **keys).sum() == chosen(**keys).sum() > 0
    points[:, 2] *= 0.999
    assert chosen(points, **keys).sum() == 0


@pytest.mark.parametrize(
    ("keys", "count"),
    [
        ({"box": {"min": [0, 0, 0], "max": [0.25, 1, 1]}}, 50),
        ({"sphere": {"center": [0.5, 0.5, 0.5], "radius": 0.25}}, 7),
        ({"halfspace": {"point": [0, 0, 0.75], "normal": "z"}}, 50),
        ({"tip": {"direction": "z", "depth": 0.25}}, 50),
    ],
)
def test_relative(keys, count):
    found = chosen(relative=True, **keys)
    assert found.sum() == count
    np.testing.assert_array_equal(chosen(7.3 * GRID + [100, -20, 3], relative=True, **keys), found)


def test_relative_radius_counts_in_longest_sides():
    flat = GRID * [1.0, 0.5, 0.25]
    found = chosen(flat, sphere={"center": [0, 0, 0], "radius": 0.5}, relative=True)
    np.testing.assert_array_equal(found, np.linalg.norm(flat, axis=1) <= 2.0)


def test_all_and_none():
    assert chosen(all=True).all()
    assert not chosen(none=True).any()


def test_descriptions():
    selector = Selector.model_validate({"halfspace": {"point": [0, 0, 0.96], "normal": "z"}, "relative": True})
    assert describe(selector) == "halfspace beyond (0, 0, 0.96) towards (0, 0, 1), relative to the body"
    selector = Selector.model_validate({"box": {"min": [0, 0, 0], "max": [1, 1, 1]}})
    assert describe(selector) == "box from (0, 0, 0) to (1, 1, 1) [m]"
    selector = Selector.model_validate({"sphere": {"center": [1, 2, 3], "radius": 0.5}})
    assert describe(selector) == "sphere of radius 0.5 about (1, 2, 3) [m]"
    selector = Selector.model_validate({"tip": {"direction": "x", "depth": 0.05}})
    assert describe(selector) == "tip of depth 0.05 towards (1, 0, 0) [m]"
    assert describe_box(bounding_box(GRID)) == "(0, 0, 0) to (4, 4, 4) [m]"
