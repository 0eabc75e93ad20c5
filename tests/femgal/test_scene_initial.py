# SPDX-License-Identifier: BSD-3-Clause
"""Shapes in which a body may start.

1. Random starts fill the bounding box enlarged about its centre, uniformly, the same for the same seed.
2. A flat start lies in one plane through the lowest point, or keeps the thickness asked for, and unfolds: the
   cofactor of F points to the side of the rest shape.
3. Points on a sphere have its radius; random ones favour no direction, projected ones keep theirs.
4. A stretched start moves the chosen vertices only; pulls add up; one that selects nothing is refused.
5. The rest shape stays untouched.
"""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from femgal.scene.initial import initial_positions
from femgal.scene.problems import SceneError
from femgal.scene.shapes import Initial

REST = np.random.default_rng(31415927).uniform([0, 0, 2], [2, 1, 3], (4000, 3))
LOW, HIGH = REST.min(axis=0), REST.max(axis=0)


def start(points=REST, **keys):
    return initial_positions(TypeAdapter(Initial).validate_python(keys), points, "bodies[0].initial", "a.toml")


def test_rest_is_a_copy():
    found = start(kind="rest")
    np.testing.assert_array_equal(found, REST)
    assert not np.shares_memory(found, REST)


def test_random():
    found = start(kind="random", scale=2.0)
    middle, half = 0.5 * (LOW + HIGH), HIGH - LOW
    unit = (found - middle) / half
    assert np.abs(unit).max() <= 1.0
    # Uniform on [-1, 1]: mean 0, variance 1/3; four standard errors of 4000 samples are 0.037 and 0.019.
    np.testing.assert_allclose(unit.mean(axis=0), 0.0, atol=0.037)
    np.testing.assert_allclose((unit**2).mean(axis=0), 1 / 3, atol=0.019)


@pytest.mark.parametrize("kind", ["random", "sphere"])
def test_seeds(kind):
    np.testing.assert_array_equal(start(kind=kind, seed=77777777), start(kind=kind, seed=77777777))
    assert np.abs(start(kind=kind, seed=77777777) - start(kind=kind, seed=99999999)).max() > 0.1


def test_flat():
    found = start(kind="flat")
    np.testing.assert_allclose(found[:, 2], LOW[2], atol=1e-15)
    np.testing.assert_array_equal(found[:, :2], REST[:, :2])


def test_flat_along_any_direction():
    normal = np.array([1.0, 2.0, 2.0]) / 3.0
    found = start(kind="flat", normal=[1, 2, 2])
    np.testing.assert_allclose(found @ normal, (REST @ normal).min(), atol=1e-14)
    np.testing.assert_allclose(np.cross(found - REST, normal), 0.0, atol=1e-14)


def test_flat_unfolds_to_the_side_of_the_rest_shape():
    normal = np.array([1.0, 2.0, 2.0]) / 3.0
    X = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    x = start(X, kind="flat", normal=[1, 2, 2])
    F = np.linalg.solve(X[1:] - X[0], x[1:] - x[0]).T
    cofactor = np.array([np.cross(F[:, (k + 1) % 3], F[:, (k + 2) % 3]) for k in range(3)]).T
    assert abs(np.linalg.det(F)) < 1e-15
    np.testing.assert_allclose(cofactor, np.outer(normal, normal), atol=1e-14)


def test_flat_keeps_a_thickness():
    found = start(kind="flat", thickness=0.25)
    assert np.ptp(found[:, 2]) == pytest.approx(0.25, rel=1e-12)
    np.testing.assert_array_equal(np.argsort(found[:, 2]), np.argsort(REST[:, 2]))
    np.testing.assert_allclose(start(kind="flat", thickness=50.0), REST, atol=1e-15)


@pytest.mark.parametrize(("keys", "radius"), [({}, 0.5 * (HIGH - LOW).max()), ({"radius": 3.0}, 3.0)])
@pytest.mark.parametrize("placement", ["random", "projected"])
def test_sphere(keys, radius, placement):
    rays = start(kind="sphere", placement=placement, **keys) - 0.5 * (LOW + HIGH)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), radius, rtol=1e-13)


def test_random_on_a_sphere_favours_no_direction():
    rays = start(kind="sphere", radius=1.0) - 0.5 * (LOW + HIGH)
    # E[r] = 0 and E[r r^T] = I/3; four standard errors of 4000 samples are 0.037 and 0.019.
    np.testing.assert_allclose(rays.mean(axis=0), 0.0, atol=0.037)
    np.testing.assert_allclose(rays.T @ rays / len(rays), np.eye(3) / 3, atol=0.019)


def test_projection_keeps_directions_and_survives_the_centre():
    points = np.vstack([REST, 0.5 * (LOW + HIGH)])
    found = start(points, kind="sphere", placement="projected", radius=1.0)
    rays, before = found - 0.5 * (LOW + HIGH), points - 0.5 * (LOW + HIGH)
    np.testing.assert_allclose(np.cross(rays, before), 0.0, atol=1e-14)
    assert np.linalg.norm(rays[-1]) == pytest.approx(1.0, rel=1e-13)


def test_stretched():
    upper = {"halfspace": {"point": [0, 0, 0.5], "normal": "z"}, "relative": True}
    pulls = [{"where": upper, "offset": [0, 0, 19]}, {"where": {"all": True}, "offset": [1, 0, 0]}]
    found = start(kind="stretched", pulls=pulls)
    above = REST[:, 2] >= 0.5 * (LOW + HIGH)[2]
    np.testing.assert_array_equal(found, REST + np.outer(above, [0, 0, 19]) + [1, 0, 0])


def test_stretched_nothing():
    nowhere = {"sphere": {"center": [9, 9, 9], "radius": 1}}
    pulls = [{"where": {"all": True}, "offset": [0, 0, 1]}, {"where": nowhere, "offset": [0, 0, 1]}]
    with pytest.raises(SceneError) as error:
        start(kind="stretched", pulls=pulls)
    for part in ("a.toml", "bodies[0].initial.pulls[1].where: selects no vertex", "about (9, 9, 9)", "the body spans"):
        assert part in str(error.value)
