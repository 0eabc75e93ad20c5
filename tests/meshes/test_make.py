# SPDX-License-Identifier: BSD-3-Clause
"""From a name to tetrahedra.

1. Procedural names give the wanted count within 5%, Morton ordered, with their origin.
2. A closed surface is filled: report, surface and origin (name, path, digest) come along; an inward one is turned.
3. A tetrahedral file comes as it is, with repairs and sliver warnings as messages, regions carried through the
   ordering; a wanted number of vertices is refused.
4. A mesh format that holds only triangles counts as a surface.
5. Open surfaces, unknown names and impossible counts are refused; thin features are warned about.
6. The same call gives the same bytes.
7. The distance from the boundary to the surface is that of the finished mesh; grids have none.
"""

from __future__ import annotations

import hashlib
import logging
from dataclasses import replace

import numpy as np
import pytest

from meshes.errors import InputError, MeshError
from meshes.generators import box, icosphere
from meshes.io.surfaces import write_surface
from meshes.io.tets import write_tets
from meshes.make import make_tets
from meshes.ordering import morton_order
from meshes.types import TriMesh


def assert_morton(mesh) -> None:
    np.testing.assert_array_equal(morton_order(mesh.points), np.arange(len(mesh.points)))


@pytest.mark.parametrize("name", ["rabbit", "sphere", "cube", "beam"])
def test_procedural_names(name):
    made = make_tets(name, 5000)
    assert len(made.mesh.points) == pytest.approx(5000, rel=0.05)
    assert (made.mesh.origin.name, made.mesh.origin.source, made.mesh.origin.sha256) == (name, "procedural", "")
    assert_morton(made.mesh)
    assert made.messages == []


def test_defaults():
    assert len(make_tets("beam").mesh.points) == 16 * 6 * 6
    assert len(make_tets("cube").mesh.points) == pytest.approx(5000, rel=0.05)


def test_grids_that_cannot_meet_the_count_say_so():
    made = make_tets("cube", 14)
    assert made.messages == [f"asked for 14 vertices: the nearest grid has {len(made.mesh.points)}"]


def test_lost_features_are_warned_about():
    made = make_tets("rabbit", 1000)
    assert made.report["lost_share"] > 0.01
    assert made.messages == [made.report["warning"]]
    assert "vertices should keep all but 1%" in made.messages[0]


@pytest.mark.parametrize("inward", [False, True])
def test_closed_surface_is_filled(tmp_path, inward):
    path = tmp_path / "ball.ply"
    ball = icosphere(3)
    write_surface(path, TriMesh(ball.points, ball.cells[:, ::-1]) if inward else ball)
    made = make_tets(path, 1500)
    assert len(made.mesh.points) == pytest.approx(1500, rel=0.05)
    assert made.mesh.volumes.sum() == pytest.approx(ball.enclosed_volume, rel=0.02)
    assert made.surface.enclosed_volume == pytest.approx(ball.enclosed_volume)
    assert made.report["asked"] == 1500
    origin = made.mesh.origin
    assert (origin.name, origin.source) == ("ball", str(path))
    assert origin.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert_morton(made.mesh)


def test_tetrahedral_file_comes_as_it_is(tmp_path):
    mesh = box(cells=(3, 3, 3), jitter=0.1)
    mesh = replace(mesh, regions=np.where(mesh.points[mesh.cells].mean(axis=1)[:, 0] < 0.5, 3, 8).astype(np.int32))
    path = tmp_path / "block.vtu"
    write_tets(path, mesh)
    made = make_tets(str(path))
    assert (made.surface, made.report) == (None, None)
    assert made.messages == ["regions from 'region': 2 (3, 8)"]
    assert sorted(map(tuple, made.mesh.points)) == sorted(map(tuple, mesh.points))
    left = made.mesh.points[made.mesh.cells].mean(axis=1)[:, 0] < 0.5
    np.testing.assert_array_equal(made.mesh.regions, np.where(left, 3, 8))
    assert_morton(made.mesh)
    with pytest.raises(InputError) as caught:
        make_tets(path, 500)
    for part in ("used as it is", "vertices = 500, the file has 64", "leave the number out"):
        assert part in str(caught.value)


def test_slivers_are_warned_about(tmp_path):
    path = tmp_path / "a.t"
    path.write_text("Vertex 0 0 0 0\nVertex 1 1 0 0\nVertex 2 0 1 0\nVertex 3 .3 .3 1e-4\nTet 0 0 1 2 3\n")
    assert any("dihedral" in message for message in make_tets(path).messages)


def test_triangles_in_a_mesh_format_are_a_surface(tmp_path):
    meshio = pytest.importorskip("meshio")
    ball = icosphere(2)
    meshio.vtu.write(str(tmp_path / "ball.vtu"), meshio.Mesh(ball.points, [("triangle", ball.cells)]))
    made = make_tets(tmp_path / "ball.vtu", 800)
    assert len(made.mesh.points) == pytest.approx(800, rel=0.05)


def test_refusals(tmp_path):
    ball = icosphere(2)
    write_surface(tmp_path / "open.ply", TriMesh(ball.points, ball.cells[:-1]))
    with pytest.raises(MeshError, match=r"(?s)open\.ply.*not closed.*3 open edges"):
        make_tets(tmp_path / "open.ply", 800)
    with pytest.raises(MeshError, match="no such mesh"):
        make_tets("no-such-animal", 800)
    for wrong in (7, 10**10):
        with pytest.raises(InputError, match=str(wrong)):
            make_tets("rabbit", wrong)


def test_real_bunny_keeps_its_volume(real_surface):
    made = make_tets(real_surface("bunny"), 5000)
    assert len(made.mesh.points) == pytest.approx(5000, rel=0.05)
    assert made.mesh.volumes.sum() == pytest.approx(made.surface.enclosed_volume, rel=0.02)


def test_published_mesh_is_reordered_only(real_surface):
    made = make_tets(real_surface("ipc_bunny"))
    assert (len(made.mesh.points), len(made.mesh.cells)) == (4670, 19379)
    assert any("below 1 degree" in message for message in made.messages)


def test_result_is_reproducible_and_logged(caplog):
    with caplog.at_level(logging.INFO, logger="meshes"):
        first, second = make_tets("rabbit", 1500), make_tets("rabbit", 1500)
    assert first.mesh.content_hash == second.mesh.content_hash
    counts = f"{len(first.mesh.points)} vertices, {len(first.mesh.cells)} tetrahedra"
    assert f"mesh rabbit: {counts} from procedural" in caplog.messages


def test_distance():
    made = make_tets("rabbit", 2000)
    distance = made.distance()
    assert distance.maximum < 0.5 * made.report["spacing"]
    finer = make_tets("rabbit", 8000).distance()
    assert finer.mean < 0.5 * distance.mean
    assert make_tets("cube", 100).distance() is None
