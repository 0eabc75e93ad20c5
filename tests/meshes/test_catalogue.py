# SPDX-License-Identifier: BSD-3-Clause
"""The catalogue.

1. Names resolve in the documented order: path, FEMGAL_MESH_PATH with its sub-folder, procedural, downloaded.
2. An unknown name is an error with the places looked at, the known names and close matches; nothing stands in.
3. A remote mesh is never fetched by resolving it; the error names the command that does.
4. The log names mesh and origin.
5. The packaged registry is complete: addresses pinned to a commit, digests, sizes, credit and terms.
"""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from meshes import catalogue
from meshes.catalogue import known, resolve
from meshes.errors import MeshError
from meshes.remote import registry


@pytest.fixture
def folders(tmp_path, monkeypatch) -> Path:
    """Two search folders, an empty cache, and an empty working folder."""
    for name in ("one/tets", "two", "cache", "work"):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.setenv("FEMGAL_MESH_PATH", f"{tmp_path / 'one'}:{tmp_path / 'missing'}:{tmp_path / 'two'}")
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path


def test_order_of_places(folders):
    for place in ("two/a.ply", "two/b.obj", "one/tets/b.msh", "one/a.vtu", "one/a.stl", "two/rabbit.ply"):
        (folders / place).touch()
    assert resolve("a").path == folders / "one/a.stl", "first folder first, and .stl before .vtu"
    assert resolve("b").path == folders / "one/tets/b.msh"
    assert resolve("b.obj").path == folders / "two/b.obj"
    assert resolve("rabbit").path == folders / "two/rabbit.ply", "a file of the user's comes before the formula"
    assert resolve("cube").kind == "procedural"
    (folders / "work/a.ply").touch()
    assert resolve("a").path == folders / "one/a.stl"
    assert resolve("a.ply").path == Path("a.ply"), "an existing path comes first"
    assert resolve(folders / "two/a.ply").name == "a"


def test_bare_names_are_not_files_without_suffix(folders):
    (folders / "work/rabbit").write_text("not a mesh")
    assert resolve("rabbit").kind == "procedural"
    assert resolve("./rabbit").kind == "file"


def test_unknown_names_say_where_was_looked(folders):
    (folders / "two/armadillo.ply").touch()
    with pytest.raises(MeshError) as caught:
        resolve("armadilo")
    message = str(caught.value)
    for part in (
        *("armadilo: no such mesh", str(folders / "one"), str(folders / "one/tets"), str(folders / "cache/meshes")),
        *("rabbit, sphere, cube, beam", "did you mean armadillo"),
    ):
        assert part in message
    with pytest.raises(MeshError, match=r"no such file"):
        resolve("somewhere/armadillo.ply")
    with pytest.raises(MeshError, match="no such mesh"):
        resolve("")


def test_without_search_folders(monkeypatch, tmp_path):
    monkeypatch.delenv("FEMGAL_MESH_PATH", raising=False)
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path))
    with pytest.raises(MeshError, match=r"FEMGAL_MESH_PATH \(not set\)"):
        resolve("bunny")


def test_remote_meshes_are_known_but_not_fetched(folders, monkeypatch):
    monkeypatch.setattr("meshes.remote.urlopen", lambda *_, **__: pytest.fail("the network was used"))
    with pytest.raises(MeshError) as caught:
        resolve("ipc_bunny")
    assert "is known but not downloaded" in str(caught.value)
    assert "femgal mesh download ipc_bunny" in str(caught.value)
    file = registry()["ipc_bunny"].file
    assert f"a folder that holds {file} in FEMGAL_MESH_PATH" in str(caught.value)
    entry = next(entry for entry in known() if entry.name == "ipc_bunny")
    assert entry.kind == "remote"
    assert "MIT" in entry.terms
    cached = registry()["ipc_bunny"].cached
    cached.parent.mkdir(parents=True)
    cached.touch()
    assert resolve("ipc_bunny").path == cached
    assert resolve("ipc_bunny").terms == entry.terms
    (folders / "two" / file).touch()
    assert resolve("ipc_bunny").path == folders / "two" / file


def test_known_lists_each_name_once(folders):
    for place in ("one/a.ply", "one/a.msh", "two/a.ply", "two/note.txt", "one/tets/t.msh"):
        (folders / place).touch()
    entries = known()
    names = [entry.name for entry in entries]
    assert len(names) == len(set(names))
    assert {"a", "t", *catalogue.PROCEDURAL, *registry()} == set(names)
    assert next(entry.path for entry in entries if entry.name == "a") == folders / "one/a.ply"
    for entry in entries:
        assert entry.kind == "remote" or resolve(entry.name).source == entry.source


def test_log_names_the_mesh(folders, caplog):
    with caplog.at_level(logging.INFO, logger="meshes"):
        resolve("cube")
    assert caplog.messages == ["mesh cube: procedural"]


def test_packaged_registry_is_complete():
    for entry in registry().values():
        assert entry.address.startswith("https://")
        assert any(len(part) == 40 for part in entry.address.split("/")), "pinned to a commit"
        assert len(bytes.fromhex(entry.sha256)) == 32
        assert entry.bytes > 0
        assert entry.credit
        assert entry.terms


def test_packaged_digests_are_those_of_the_files(real_surface):
    import hashlib

    for entry in registry().values():
        data = Path(real_surface(entry.name)).read_bytes()
        assert (len(data), hashlib.sha256(data).hexdigest()) == (entry.bytes, entry.sha256)
