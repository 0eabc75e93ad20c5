# SPDX-License-Identifier: BSD-3-Clause
"""Materials of tetrahedra.

1. Without regions every tetrahedron has the body's values.
2. Regions by id and by selector change what they name and nothing else; later ones override earlier ones.
3. Ids that the mesh does not have and selectors that hold nothing are refused with what there is.
4. nu <= 0 is warned about, in bodies and regions, and allowed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.scene.material import material, material_warnings
from femgal.scene.model import Body
from femgal.scene.problems import SceneError
from meshes.generators import box

MESH = box(cells=(4, 2, 2))
CENTROIDS = MESH.points[MESH.cells].mean(axis=1)
LEFT = {"halfspace": {"point": [0.5, 0, 0], "normal": [-1, 0, 0]}, "relative": True}


def body(**keys):
    return Body.model_validate({"mesh": "cube", "E": 1e6, "nu": 0.4, "rho": 1000.0, **keys})


def test_uniform():
    E, nu, rho = material(body(), MESH, "bodies[0]", "a")
    assert E.shape == nu.shape == rho.shape == (96,)
    assert (set(E), set(nu), set(rho)) == ({1e6}, {0.4}, {1000.0})


def test_by_selector():
    E, nu, rho = material(body(regions=[{"where": LEFT, "E": 5e6, "rho": 1}]), MESH, "bodies[0]", "a")
    left = CENTROIDS[:, 0] <= 0.5
    assert left.sum() == 48
    np.testing.assert_array_equal(E, np.where(left, 5e6, 1e6))
    np.testing.assert_array_equal(rho, np.where(left, 1.0, 1000.0))
    assert set(nu) == {0.4}


def test_by_id_and_in_order():
    mesh = replace(MESH, regions=np.arange(96, dtype=np.int32) % 3)
    regions = [{"id": 1, "E": 2.0}, {"id": 2, "E": 3.0}, {"where": LEFT, "E": 4.0}]
    E, _, _ = material(body(regions=regions), mesh, "bodies[0]", "a")
    by_id = np.array([1e6, 2.0, 3.0])[mesh.regions]
    np.testing.assert_array_equal(E, np.where(CENTROIDS[:, 0] <= 0.5, 4.0, by_id))


def test_unknown_id():
    with pytest.raises(SceneError) as error:
        material(body(regions=[{"id": 0, "E": 1.0}, {"id": 7, "E": 1.0}]), MESH, "bodies[2]", "a.toml")
    for part in ("a.toml", "bodies[2].regions[1].id: the mesh has no such region", "found:   7", "one of: 0"):
        assert part in str(error.value)


def test_selects_nothing():
    region = {"where": {"sphere": {"center": [5, 5, 5], "radius": 1}}, "E": 1.0}
    with pytest.raises(SceneError) as error:
        material(body(regions=[region]), MESH, "bodies[0]", "a.toml")
    for part in ("bodies[0].regions[0].where: selects no tetrahedron", "about (5, 5, 5)", "(0, 0, 0) to (1, 1, 1) [m]"):
        assert part in str(error.value)


def test_warnings():
    assert material_warnings(body(), "bodies[0]") == []
    soft = body(nu=0.0, regions=[{"id": 0, "nu": -0.5}, {"id": 0, "nu": 0.3}])
    first, second = material_warnings(soft, "bodies[0]")
    assert first.startswith("bodies[0].nu = 0: for nu <= 0")
    assert second.startswith("bodies[0].regions[0].nu = -0.5")
