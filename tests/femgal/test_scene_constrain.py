# SPDX-License-Identifier: BSD-3-Clause
"""From constraints to motions.

1. A constraint without `body` looks at every body, a relative one in each body's own bounding box; one with `body`
   at that body only.
2. Refused: a selector that holds nothing (with the bounding boxes), a vertex in two constraints (naming both), and
   a scene in which nothing can move.
3. `none = true` switches a constraint off.
4. Fewer than three held vertices are warned about.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.scene.constrain import constraint_warnings, make_motions
from femgal.scene.model import Constraint
from femgal.scene.problems import SceneError

CUBE = np.stack(np.meshgrid(*(np.arange(3.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
POINTS = np.vstack([CUBE, CUBE * 0.1 + 5.0])
BODIES = np.repeat(np.arange(2, dtype=np.int32), 27)
TOP = {"halfspace": {"point": [0, 0, 1], "normal": "z"}, "relative": True}
BOTTOM = {"halfspace": {"point": [0, 0, 0], "normal": [0, 0, -1]}, "relative": True}


def motions(*tables):
    constraints = [Constraint.model_validate(table) for table in tables]
    return make_motions(constraints, POINTS, BODIES, "a.toml"), constraints


def test_all_bodies():
    (found,), _ = motions({"where": TOP})
    np.testing.assert_array_equal(found.vertices, np.flatnonzero((POINTS[:, 2] == 2.0) | (POINTS[:, 2] >= 5.2)))
    assert len(found.vertices) == 18


def test_one_body():
    (found,), _ = motions({"where": TOP, "body": 1})
    assert len(found.vertices) == 9
    assert (BODIES[found.vertices] == 1).all()
    np.testing.assert_array_equal(found.rest, POINTS[found.vertices])


def test_paths_reach_the_motion():
    path = {"times": [0, 1], "offsets": [[0, 0, 0], [0, 0, 1]]}
    (held, pulled), _ = motions({"where": BOTTOM}, {"where": TOP, "path": path})
    assert (held.is_fixed, pulled.is_fixed) == (True, False)
    np.testing.assert_allclose(pulled.positions(1.0) - pulled.rest, np.tile([0, 0, 1.0], (18, 1)), atol=1e-15)


def test_empty_selection():
    with pytest.raises(SceneError) as error:
        motions({"where": TOP}, {"where": {"sphere": {"center": [50, 0, 0], "radius": 1}}})
    for part in (
        "a.toml",
        "constraints[1].where: selects no vertex",
        "sphere of radius 1 about (50, 0, 0) [m]",
        "body 0 spans (0, 0, 0) to (2, 2, 2) [m]",
        "body 1 spans (5, 5, 5) to (5.2, 5.2, 5.2) [m]",
        "move or enlarge the region",
    ):
        assert part in str(error.value)


def test_two_constraints_on_a_vertex():
    side = {"halfspace": {"point": [1, 0, 0], "normal": "x"}, "relative": True}
    with pytest.raises(SceneError) as error:
        motions({"where": BOTTOM}, {"where": TOP}, {"where": side, "body": 0})
    for part in (
        "constraints[2]: shares vertices with constraints[0]",
        "3 vertices are in constraints[0] too",
        "the first at (2, 0, 0) [m]",
        "one constraint per vertex",
    ):
        assert part in str(error.value)


def test_nothing_can_move():
    with pytest.raises(SceneError, match="nothing is left to move\n    found:   all 54 vertices are constrained"):
        motions({"where": {"all": True}})


def test_switched_off():
    found, _ = motions({"where": {"none": True}}, {"where": TOP})
    assert len(found) == 1


def test_warnings():
    corner = {"box": {"min": [0, 0, 0], "max": [0, 0, 0]}}
    found, constraints = motions({"where": {"none": True}}, {"where": TOP}, {"where": corner})
    (warning,) = constraint_warnings(constraints, found)
    assert warning.startswith("constraints[2] holds 1 vert")
