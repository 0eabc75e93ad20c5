# SPDX-License-Identifier: BSD-3-Clause
"""Meshes kept on disk.

1. A mesh that is found is the one that was made: arrays, regions, surface, report, messages and origins; nothing is
   filled the second time.
2. Another number of vertices, another name, another surface, another file name or other sources are another mesh.
3. A kept file that is cut short, altered in one byte, empty or of another kind is not used but made anew and replaced.
4. Grids and tetrahedral files are not kept; errors are not kept; a folder that cannot be written is no error.
5. The kept files never take more than MOST_BYTES: those used longest ago go first, the newest last.
6. Many writers of one mesh leave one whole file and no parts.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from meshes import store
from meshes.errors import MeshError
from meshes.generators import box, icosphere
from meshes.io.surfaces import write_surface
from meshes.io.tets import write_tets
from meshes.make import Made
from meshes.store import make_or_find_tets, mesh_folder
from meshes.types import TriMesh


@pytest.fixture
def ball(tmp_path, monkeypatch) -> str:
    """File of a surface, and a cache that is empty."""
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path / "cache"))
    write_surface(tmp_path / "ball.ply", icosphere(2, radius=0.4))
    return str(tmp_path / "ball.ply")


@pytest.fixture
def made(monkeypatch) -> list[str]:
    """Names of the meshes that are really made."""
    names: list[str] = []

    def counted(name, vertices=None, original=store.make_tets) -> Made:
        names.append(os.path.basename(name))
        return original(name, vertices)

    monkeypatch.setattr(store, "make_tets", counted)
    return names


def kept() -> list:
    return sorted(mesh_folder().iterdir())


def assert_same(one: Made, other: Made) -> None:
    assert one.mesh.content_hash == other.mesh.content_hash
    assert one.mesh.origin == other.mesh.origin
    assert (one.report, one.messages) == (other.report, other.messages)
    if one.surface is None or other.surface is None:
        assert one.surface is other.surface
    else:
        assert one.surface.content_hash == other.surface.content_hash
        assert one.surface.origin == other.surface.origin


@pytest.mark.parametrize("name", ["ball", "rabbit", "sphere"])
def test_found_is_what_was_made(ball, made, name):
    name = ball if name == "ball" else name
    first, second = make_or_find_tets(name, 600), make_or_find_tets(name, 600)
    assert_same(first, second)
    assert len(made) == 1
    assert len(kept()) == 1


def test_what_makes_another_mesh(ball, made, monkeypatch, tmp_path):
    make_or_find_tets(ball, 300)
    make_or_find_tets(ball, 310)
    write_surface(tmp_path / "other.ply", icosphere(2, radius=0.4))
    make_or_find_tets(str(tmp_path / "other.ply"), 300)  # the same bytes, but its origin says otherwise
    write_surface(ball, icosphere(2, radius=0.5))
    assert make_or_find_tets(ball, 300).mesh.points.max() > 0.45
    monkeypatch.setattr(store, "_sources", lambda: "edited")
    make_or_find_tets(ball, 300)
    assert made == ["ball.ply", "ball.ply", "other.ply", "ball.ply", "ball.ply"]
    assert len(kept()) == 5


@pytest.mark.parametrize("harm", ["short", "byte", "empty", "other"])
def test_spoilt_files_are_made_anew(ball, made, harm):
    first = make_or_find_tets(ball, 300)
    (file,) = kept()
    content = bytearray(file.read_bytes())
    at = content.find(first.mesh.points.tobytes()) + 1000
    assert at >= 1000
    content[at] ^= 1
    spoilt = {"short": content[:-200], "byte": content, "empty": b"", "other": b"no archive"}[harm]
    file.write_bytes(spoilt)
    assert_same(first, make_or_find_tets(ball, 300))
    assert_same(first, make_or_find_tets(ball, 300))
    assert len(made) == 2


def test_meshes_quick_to_make_are_not_kept(ball, made, tmp_path):
    write_tets(tmp_path / "grid.vtu", box((1.0, 1.0, 1.0), (2, 2, 2)))
    for name in ("beam", str(tmp_path / "grid.vtu")):
        assert_same(make_or_find_tets(name), make_or_find_tets(name))
    assert len(made) == 4
    assert not mesh_folder().exists()


def test_errors_are_not_kept(ball, made, tmp_path):
    surface = icosphere(2, radius=0.4)
    write_surface(tmp_path / "open.ply", TriMesh(surface.points, surface.cells[1:]))
    for _ in range(2):
        with pytest.raises(MeshError, match="not closed"):
            make_or_find_tets(str(tmp_path / "open.ply"), 300)
    with pytest.raises(MeshError, match="no such mesh"):
        make_or_find_tets("unicorn")
    assert len(made) == 2


def test_folder_that_cannot_be_written(ball, made, tmp_path):
    (tmp_path / "cache").write_text("a file where the folder should be")
    assert_same(make_or_find_tets(ball, 300), make_or_find_tets(ball, 300))
    assert len(made) == 2


def test_room(ball, made, monkeypatch):
    make_or_find_tets(ball, 300)
    (first,) = kept()
    monkeypatch.setattr(store, "MOST_BYTES", int(2.7 * first.stat().st_size))
    make_or_find_tets(ball, 310)
    (second,) = (file for file in kept() if file != first)
    for age, file in ((30.0, second), (20.0, first)):
        os.utime(file, (file.stat().st_mtime - age,) * 2)
    make_or_find_tets(ball, 300)  # the older file, used now
    make_or_find_tets(ball, 320)
    assert first in kept()
    assert second not in kept()
    assert sum(file.stat().st_size for file in kept()) <= store.MOST_BYTES
    monkeypatch.setattr(store, "MOST_BYTES", 10)
    make_or_find_tets(ball, 330)
    assert kept() == []


def test_many_writers(ball):
    with ThreadPoolExecutor(8) as pool:
        meshes = list(pool.map(lambda _: make_or_find_tets(ball, 300), range(8)))
    assert len({one.mesh.content_hash for one in meshes}) == 1
    assert len(kept()) == 1
    assert np.load(kept()[0])["cells"].shape == meshes[0].mesh.cells.shape
