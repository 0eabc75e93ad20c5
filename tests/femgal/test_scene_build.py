# SPDX-License-Identifier: BSD-3-Clause
"""From a scene to arrays.

1. Bodies are joined one after the other, each in the order of its mesh, with its own material, regions, velocity
   and start; what is recorded of each mesh says where it came from.
2. Constrained vertices start where their motion has them and move with its slope, whatever the body's start is.
3. A mesh that cannot be made is refused with the body's key and what the mesh room said.
4. Bodies that ask for the same mesh share the work of making it.
5. Every built-in scene builds at other vertex counts, with the held vertices that it is about; the drapes hold one
   ear tip only.
6. Building twice gives the same arrays, bit for bit.
7. Slivers are planted in the body that asks for them and nowhere else; angles that its mesh cannot have are refused.
"""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import meshes.store
from femgal.scene.build import build_world
from femgal.scene.load import load_scene, parse_scene
from femgal.scene.problems import SceneError
from meshes.generators import box
from meshes.quality import dihedrals
from meshes.types import Origin, TetMesh

needs_surfaces = pytest.mark.skipif(
    not os.environ.get("FEMGAL_MESH_PATH"), reason="FEMGAL_MESH_PATH names no folder of surfaces"
)

TWO = """
name = "two"
[[bodies]]
mesh = "first"
vertices = 100
E = 1e6
nu = 0.4
rho = 1000.0
velocity = [1, 0, 0]
regions = [{ id = 1, E = 2e6 }]
[[bodies]]
mesh = "second"
E = 5e6
nu = -0.1
rho = 10.0
translate = [0, 0, 5]
initial = { kind = "random", seed = 77777777 }
"""
TOP = "[[constraints]]\nbody = 0\nwhere = { box = { min = [0, 0, 1], max = [1, 1, 1] } }\n"


@pytest.fixture
def calls(monkeypatch):
    """Stand-ins for meshes: a box whose tetrahedra alternate between regions 0 and 1."""
    made = []

    def make_tets(name, vertices=None):
        made.append((name, vertices))
        mesh = box(cells=(2, 2, 2))
        origin = Origin(name, f"{name}.msh", "abc", "free")
        mesh = TetMesh(mesh.points, mesh.cells, origin, np.arange(48) % 2)
        return SimpleNamespace(mesh=mesh, surface=None, report={"h": 0.5}, messages=["repaired"])

    monkeypatch.setattr(meshes.store, "make_or_find_tets", make_tets)
    return made


def test_two_bodies(calls):
    world = build_world(parse_scene(TWO, "two.toml"))
    one = box(cells=(2, 2, 2))
    assert calls == [("first", 100), ("second", None)]
    np.testing.assert_array_equal(world.mesh.points, np.vstack([one.points, one.points + np.array([0, 0, 5])]))
    np.testing.assert_array_equal(world.mesh.cells, np.vstack([one.cells, one.cells + 27]))
    np.testing.assert_array_equal(world.mesh.regions, np.arange(96) % 2)
    np.testing.assert_array_equal(world.body, np.repeat([0, 1], 48))
    np.testing.assert_array_equal(world.vertex_body, np.repeat([0, 1], 27))
    assert world.body.dtype == world.vertex_body.dtype == np.int32
    np.testing.assert_array_equal(world.E, np.r_[np.tile([1e6, 2e6], 24), np.full(48, 5e6)])
    np.testing.assert_array_equal(world.nu, np.repeat([0.4, -0.1], 48))
    np.testing.assert_array_equal(world.rho, np.repeat([1000.0, 10.0], 48))
    np.testing.assert_array_equal(world.v0, np.repeat([[1.0, 0, 0], [0, 0, 0]], 27, axis=0))


def test_starts(calls):
    world = build_world(parse_scene(TWO, "two.toml"))
    np.testing.assert_array_equal(world.x0[:27], world.mesh.points[:27])
    random = world.x0[27:] - [0.5, 0.5, 5.5]
    assert 0.5 < np.abs(random).max() <= 1.0


def test_what_is_recorded(calls):
    world = build_world(parse_scene(TWO, "two.toml"))
    assert world.origins[1] == {
        "name": "second",
        "source": "second.msh",
        "sha256": "abc",
        "terms": "free",
        "vertices": 27,
        "tets": 48,
        "messages": ["repaired"],
        "stuffing": {"h": 0.5},
    }
    assert world.warnings[:2] == ("bodies[0].mesh: repaired", "bodies[1].mesh: repaired")
    assert world.warnings[2].startswith("bodies[1].nu = -0.1: for nu <= 0")


def test_constrained_vertices_start_with_their_motion(calls):
    path = "path = { times = [0, 0.5], offsets = [[0, 0, 3], [0, 0, 4]] }\n"
    bottom = "[[constraints]]\nbody = 1\nwhere = { box = { min = [0, 0, 5], max = [1, 1, 5] } }\n"
    world = build_world(parse_scene(TWO + TOP + path + bottom, "two.toml"))
    pulled, held = world.motions
    assert (len(pulled.vertices), len(held.vertices)) == (9, 9)
    np.testing.assert_allclose(world.x0[pulled.vertices], world.mesh.points[pulled.vertices] + [0, 0, 3], rtol=1e-15)
    np.testing.assert_allclose(world.v0[pulled.vertices], np.tile([0, 0, 2.0], (9, 1)), rtol=1e-15)
    np.testing.assert_array_equal(world.x0[held.vertices], world.mesh.points[held.vertices])
    np.testing.assert_array_equal(world.v0[held.vertices], 0.0)


def test_free_vertices_keep_the_velocity_of_the_body(calls):
    world = build_world(parse_scene(TWO + TOP, "two.toml"))
    free = np.setdiff1d(np.arange(27), world.motions[0].vertices)
    np.testing.assert_array_equal(world.v0[free], np.tile([1.0, 0, 0], (18, 1)))


def test_regions_and_selectors_that_hold_nothing(calls):
    with pytest.raises(
        SceneError, match=r"two: 1 problem.*\n  bodies\[0\]\.regions\[0\]\.id: .*\n    found:   7\n.*0, 1"
    ):
        build_world(parse_scene(TWO.replace("id = 1", "id = 7"), "two.toml"))
    nowhere = "[[constraints]]\nbody = 1\nwhere = { box = { min = [0, 0, 0], max = [1, 1, 1] } }\n"
    with pytest.raises(SceneError, match=r"constraints\[0\]\.where: selects no vertex\n.*body 1 spans \(0, 0, 5\)"):
        build_world(parse_scene(TWO + nowhere, "two.toml"))


def test_same_mesh_is_made_once(calls):
    build_world(parse_scene(TWO.replace("second", "first").replace('"first"\nE', '"first"\nvertices = 100\nE'), "x"))
    assert calls == [("first", 100)]


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("rabit", ["x: 1 problem", "bodies[0].mesh: ", "rabbit"]),
        ("gone.msh", ["bodies[0].mesh: ", "gone.msh"]),
    ],
)
def test_missing_mesh(tmp_path, name, parts):
    text = f'[[bodies]]\nmesh = "{name}"\nE = 1.0\nnu = 0.4\nrho = 1.0\n'
    with pytest.raises(SceneError) as error:
        build_world(parse_scene(text, "x", folder=tmp_path))
    for part in parts:
        assert part in str(error.value)


def test_slivers(calls):
    good = build_world(parse_scene(TWO, "two.toml"))
    bad = build_world(parse_scene(TWO.replace('mesh = "second"', 'mesh = "second"\nslivers = 0.5'), "two.toml"))
    assert dihedrals(bad.mesh.points, bad.mesh.cells).minimum == pytest.approx(0.5, rel=1e-3)
    moved = (bad.mesh.points != good.mesh.points).any(axis=1)
    assert moved.sum() == 1
    assert bad.vertex_body[moved] == 1
    assert calls == 2 * [("first", 100), ("second", None)]
    with pytest.raises(SceneError) as caught:
        build_world(parse_scene(TWO.replace('mesh = "second"', 'mesh = "second"\nslivers = 60'), "two.toml"))
    assert "bodies[1].slivers" in str(caught.value)
    assert "angle of 60 degrees" in str(caught.value)


def test_impossible_vertex_count():
    text = '[[bodies]]\nmesh = "cube"\nvertices = 1000000000\nE = 1.0\nnu = 0.4\nrho = 1.0\n'
    with pytest.raises(SceneError, match=r"bodies\[0\]\.mesh: impossible vertex count"):
        build_world(parse_scene(text, "x"))


def build(name, vertices):
    world = build_world(load_scene(name, vertices=vertices))
    scene = load_scene(name)
    for number in range(len(scene.bodies)):
        assert abs((world.vertex_body == number).sum() - vertices) <= 0.15 * vertices
    assert np.isfinite(world.x0).all()
    assert np.isfinite(world.v0).all()
    return world


@pytest.mark.parametrize("vertices", [500, 2000])
def test_beam_stretch(vertices):
    world = build("beam-stretch", vertices)
    held, pulled = world.motions
    for motion in world.motions:
        assert set(world.vertex_body[motion.vertices]) == {0, 1, 2, 3}
    assert held.is_fixed
    np.testing.assert_allclose(np.unique(held.rest[:, 0]), -1.5, atol=1e-12)
    np.testing.assert_allclose(pulled.positions(1.0)[:, 0], 3.0, atol=1e-12)
    gaps = [np.ptp(world.mesh.points[world.vertex_body == k], axis=0) for k in range(4)]
    np.testing.assert_allclose(gaps, np.tile([3, 1, 1], (4, 1)), atol=1e-12)
    assert sorted(set(world.nu)) == [0.1, 0.2, 0.4, 0.49]


@pytest.mark.parametrize("vertices", [500, 2000])
def test_cube_random(vertices):
    world = build("cube-random", vertices)
    assert world.motions == ()
    assert np.ptp(world.x0, axis=0) == pytest.approx([2, 2, 2], rel=0.03)
    edges = world.x0[world.mesh.cells[:, 1:]] - world.x0[world.mesh.cells[:, :1]]
    inverted = (np.linalg.det(edges) < 0).mean()
    # Half of all random tetrahedra are inside out; 0.06 is more than four standard errors of 2000 tetrahedra.
    assert inverted == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize("vertices", [500, 2000, 5000, 10000])
@pytest.mark.parametrize(
    ("name", "tip"),
    [
        ("rabbit-drape", [0.07, 0.08, 1.0]),
        pytest.param("bunny-drape", [0.0, 0.12, 1.0], marks=needs_surfaces),
    ],
)
def test_drapes_hold_one_ear_tip(name, tip, vertices):
    world = build(name, vertices)
    (held,) = world.motions
    assert held.is_fixed
    assert 1 <= len(held.vertices) <= 0.02 * len(world.x0) + 3
    free = np.setdiff1d(np.arange(len(world.x0)), held.vertices)
    np.testing.assert_array_equal(world.v0[held.vertices], 0.0)
    np.testing.assert_array_equal(world.v0[free], np.tile([0, 0, -1.0], (len(free), 1)))
    if vertices >= 2000:  # coarser meshes cut thin ears off
        assert components(world.mesh.cells, held.vertices) == 1
        assert np.abs(held.rest - tip).max() < 0.2


def components(cells, vertices):
    """Number of pieces into which the edges between the chosen vertices join them."""
    pairs = np.concatenate([cells[:, [a, b]] for a in range(4) for b in range(a)])
    inside = pairs[np.isin(pairs, vertices).all(axis=1)]
    graph = coo_matrix((np.ones(len(inside)), inside.T), shape=(cells.max() + 1,) * 2)
    return len(np.unique(connected_components(graph, directed=False)[1][vertices]))


@needs_surfaces
@pytest.mark.parametrize("vertices", [500, 1500])
def test_bunny_stretch(vertices):
    world = build("bunny-stretch", vertices)
    feet, pulled, jumped = world.motions
    stretched = world.x0 - world.mesh.points
    assert set(world.vertex_body[feet.vertices]) == {0, 1, 2}
    assert [motion.is_fixed for motion in world.motions] == [True, False, True]
    np.testing.assert_array_equal(stretched[world.vertex_body == 0], 0.0)
    assert (stretched[world.vertex_body == 1][:, 2] == 19.0).sum() == len(pulled.vertices) == len(jumped.vertices)
    np.testing.assert_allclose(stretched[jumped.vertices], np.tile([0, 0, 19.0], (len(jumped.vertices), 1)))
    np.testing.assert_allclose(pulled.positions(9.0) - pulled.rest, np.tile([0, 0, 19.0], (len(pulled.rest), 1)))
    np.testing.assert_allclose(world.v0[pulled.vertices], np.tile([0, 0, 19 / 1.5], (len(pulled.vertices), 1)))


def test_same_scene_same_arrays():
    first, second = (build_world(load_scene("cube-random", vertices=500)) for _ in range(2))
    np.testing.assert_array_equal(first.x0, second.x0)
    assert first.mesh.content_hash == second.mesh.content_hash
