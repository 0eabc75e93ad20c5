# SPDX-License-Identifier: BSD-3-Clause
"""Where a body stands.

1. Without scaling a body keeps the coordinates of its file, plus its translation.
2. A scaled body has the height or longest side asked for, keeps its proportions, stands on z = 0, and is centred
   over the origin before it is translated.
3. `up` turns the named axis upwards; no placement mirrors the body.
4. Where a surface was filled, extents and centres are the surface's, however much smaller the mesh is.
5. Rotations are applied in their order, about the centre of the bounding box.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.scene.model import Body
from femgal.scene.place import placed

CORNERS = np.array([[x, y, z] for x in (1, 4) for y in (2, 4) for z in (5, 6)], float)

MOVE = np.array([1.0, 2.0, 3.0])


def place(points=CORNERS, **keys):
    return placed(points, Body.model_validate({"mesh": "cube", "E": 1.0, "nu": 0.4, "rho": 1.0, **keys}))


def orientation(points):
    return np.linalg.det(points[[4, 2, 1]] - points[0])


def test_file_coordinates():
    np.testing.assert_array_equal(place(), CORNERS)
    np.testing.assert_array_equal(place(translate=[1, 2, 3]), CORNERS + MOVE)


@pytest.mark.parametrize(
    ("keys", "extent"),
    [
        ({"height": 2.0}, [6, 4, 2]),
        ({"size": 6.0}, [6, 4, 2]),
        ({"height": 3.0, "up": "x"}, [1, 2, 3]),
        ({"height": 4.0, "up": "y"}, [6, 2, 4]),
    ],
)
def test_scaling(keys, extent):
    x = place(**keys)
    np.testing.assert_allclose(np.ptp(x, axis=0), extent, rtol=1e-14)
    np.testing.assert_allclose(x.min(axis=0), [-0.5 * extent[0], -0.5 * extent[1], 0], atol=1e-14)
    np.testing.assert_allclose(place(translate=[1, 2, 3], **keys), x + MOVE, atol=1e-14)


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_up(up, axis):
    x = place(up=up)
    np.testing.assert_array_equal(x[:, 2], CORNERS[:, axis])
    assert orientation(x) == pytest.approx(orientation(CORNERS), rel=1e-14)


def test_rotation_about_the_centre():
    x = place(rotate=[{"axis": "z", "degrees": 90}])
    middle = np.array([2.5, 3.0, 5.5])
    dx, dy, dz = (CORNERS - middle).T
    np.testing.assert_allclose(x, middle + np.stack([-dy, dx, dz], axis=1), atol=1e-14)


def test_rotations_in_order():
    turns = [{"axis": "x", "degrees": 90}, {"axis": "z", "degrees": 90}]
    x = place(CORNERS - [2.5, 3.0, 5.5], rotate=turns)
    # (x, y, z) -> (x, -z, y) -> (z, x, y)
    np.testing.assert_allclose(x, (CORNERS - [2.5, 3.0, 5.5])[:, [2, 0, 1]], atol=1e-14)


def test_rotated_and_scaled_bodies_stand_on_the_ground():
    x = place(height=1.0, rotate=[{"axis": [1, 2, 3], "degrees": 40}])
    assert x[:, 2].min() == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(x.min(axis=0)[:2], -x.max(axis=0)[:2], atol=1e-14)
    assert orientation(x) == pytest.approx(orientation(CORNERS), rel=1e-13)


@pytest.mark.parametrize("keys", [{"height": 2.0}, {"size": 3.0}, {"height": 1.0, "up": "y"}, {}])
def test_extents_are_those_of_the_surface(keys):
    keys = {"rotate": [{"axis": [1, 2, 3], "degrees": 40}], "translate": [1, 2, 3], **keys}
    body = Body.model_validate({"mesh": "cube", "E": 1.0, "nu": 0.4, "rho": 1.0, **keys})
    inner = CORNERS.mean(axis=0) + 0.5 * (CORNERS - CORNERS.mean(axis=0))
    outside = place(**keys)
    expected = outside.mean(axis=0) + 0.5 * (outside - outside.mean(axis=0))
    np.testing.assert_allclose(placed(inner, body, CORNERS), expected, atol=1e-14)


def test_far_from_the_origin():
    x = place(CORNERS + 1e6, height=1.0)
    np.testing.assert_allclose(x, place(height=1.0), atol=1e-15)
