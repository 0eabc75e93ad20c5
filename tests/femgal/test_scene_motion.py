# SPDX-License-Identifier: BSD-3-Clause
"""Prescribed motions.

1. A path is linear between its times and held outside of them; its offsets count from the rest positions.
2. A rotation turns counter-clockwise about its axis through its centre, keeps distances, and adds to a path.
3. Velocities are the derivative of the positions, to the right where a path bends.
4. Only motions that change with time are not fixed; a displaced but held one is.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.scene.motion import PiecewiseLinear, make_motion, rotation_matrix
from femgal.scene.shapes import Path, Rotation

POINTS = np.random.default_rng(20250731).uniform(-1.0, 1.0, (20, 3))
VERTICES = np.array([3, 4, 11, 19])


def motion(path=None, rotation=None):
    return make_motion(
        VERTICES,
        POINTS,
        None if path is None else Path.model_validate(path),
        None if rotation is None else Rotation.model_validate(rotation),
    )


def test_fixed():
    found = motion()
    assert found.is_fixed
    assert found.vertices.dtype == np.int64
    np.testing.assert_array_equal(found.positions(0.3), POINTS[VERTICES])
    np.testing.assert_array_equal(found.velocities(0.3), 0.0)


@pytest.mark.parametrize(
    ("time", "offset", "velocity"),
    [
        (0.0, [0, 0, 0], [0, 0, 0]),
        (0.5, [0, 0, 0], [2, 0, 0]),
        (1.0, [1, 0, 0], [2, 0, 0]),
        (1.5, [2, 0, 0], [0, -4, 0]),
        (1.75, [2, -1, 0], [0, -4, 0]),
        (2.0, [2, -2, 0], [0, 0, 0]),
        (9.0, [2, -2, 0], [0, 0, 0]),
    ],
)
def test_path(time, offset, velocity):
    found = motion({"times": [0.5, 1.5, 2.0], "offsets": [[0, 0, 0], [2, 0, 0], [2, -2, 0]]})
    assert not found.is_fixed
    np.testing.assert_allclose(found.positions(time), POINTS[VERTICES] + offset, atol=1e-14)
    np.testing.assert_allclose(found.velocities(time), np.tile(velocity, (4, 1)), atol=1e-14)


def test_jump_and_hold_is_fixed():
    found = motion({"times": [0.0], "offsets": [[0, 0, 19]]})
    assert found.is_fixed
    np.testing.assert_allclose(found.positions(0.0), POINTS[VERTICES] + [0, 0, 19], atol=1e-14)
    np.testing.assert_array_equal(found.velocities(0.0), 0.0)


def test_quarter_turn():
    turn = {"times": [0, 1], "degrees": [0, 90], "axis": "z", "center": [1, 0, 0]}
    found = motion(None, turn)
    x, y, z = POINTS[VERTICES].T
    np.testing.assert_allclose(found.positions(1.0), np.stack([1 - y, x - 1, z], axis=1), atol=1e-14)
    assert not found.is_fixed


def test_center_defaults_to_the_middle_of_the_vertices():
    rest = POINTS[VERTICES]
    found = motion(None, {"times": [0], "degrees": [180], "axis": [0, 0, 5]})
    middle = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
    expected = np.where([True, True, False], 2 * middle - rest, rest)
    np.testing.assert_allclose(found.positions(0.0), expected, atol=1e-14)
    assert found.is_fixed


def test_turn_then_displace():
    path = {"times": [0, 1], "offsets": [[0, 0, 0], [0, 0, 3]]}
    turn = {"times": [0, 1], "degrees": [0, 120], "axis": [1, 1, 1], "center": [0, 0, 0]}
    expected = POINTS[VERTICES][:, [2, 0, 1]] + [0, 0, 3]
    np.testing.assert_allclose(motion(path, turn).positions(1.0), expected, atol=1e-14)


def test_velocities_are_derivatives():
    path = {"times": [0, 1, 2], "offsets": [[0, 0, 0], [1, 2, 3], [0, 1, 0]]}
    turn = {"times": [0, 1.5], "degrees": [20, 200], "axis": [1, -2, 0.5], "center": [0.3, 0.2, 0.1]}
    found, h = motion(path, turn), 1e-6
    for time in (0.1, 0.7, 1.3, 1.8):
        difference = (found.positions(time + h) - found.positions(time - h)) / (2 * h)
        np.testing.assert_allclose(found.velocities(time), difference, atol=1e-8)
    at_the_bend = (found.positions(1 + h) - found.positions(1.0)) / h
    np.testing.assert_allclose(found.velocities(1.0), at_the_bend, atol=1e-4)


def test_rotation_matrix():
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    R = rotation_matrix(axis, 0.7)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-15)
    np.testing.assert_allclose(rotation_matrix(np.array([0, 0, 1.0]), np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_slope_outside_is_zero():
    line = PiecewiseLinear(np.array([1.0, 2.0]), np.array([[1.0], [5.0]]))
    assert [line.slope(t)[0] for t in (0.5, 1.0, 1.5, 2.0, 3.0)] == [0, 4, 4, 0, 0]
    assert [line.at(t)[0] for t in (0.5, 1.5, 3.0)] == [1, 3, 5]
