# SPDX-License-Identifier: BSD-3-Clause
"""`femgal mesh`.

1. make reports counts and quality, writes to --out only, and the file reads back as the same mesh.
2. --json prints one JSON object and nothing else on standard output.
3. info describes tetrahedra, surfaces and procedural meshes, and lists the catalogue without a name.
4. convert keeps the mesh; tetrahedra and surfaces do not mix.
5. Nothing is overwritten without --force, and impossible targets are refused before any work.
6. download shows credit and terms before and after.
7. Loading the command loads no heavy package.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from femgal.commands.mesh import command
from meshes.errors import InputError, MeshError
from meshes.generators import icosphere
from meshes.io.surfaces import read_surface, write_surface
from meshes.io.tets import read_tets


def run(*arguments: object) -> Result:
    """Run without an error; the result has stdout and stderr."""
    return CliRunner().invoke(command, [str(a) for a in arguments], catch_exceptions=False)


def refusal(*arguments: object) -> str:
    with pytest.raises(InputError) as caught:
        run(*arguments)
    return str(caught.value)


@pytest.fixture
def ball(tmp_path) -> Path:
    path = tmp_path / "ball.ply"
    write_surface(path, icosphere(3))
    return path


def test_make_writes_what_it_reports(tmp_path):
    out = tmp_path / "rabbit.vtu"
    result = run("make", "rabbit", "--vertices", 1500, "--out", out)
    mesh, _ = read_tets(out)
    assert len(mesh.points) == pytest.approx(1500, rel=0.05)
    for part in (f"{len(mesh.points):,}", f"{len(mesh.cells):,}", "dihedral", "volume [m^3]", "closed 2-manifold"):
        assert part in result.stdout
    assert f"wrote {out}" in result.stdout.replace("\n", "")
    assert list(tmp_path.iterdir()) == [out]


def test_make_json_is_one_object(ball):
    result = run("make", ball, "--vertices", 800, "--json")
    content = json.loads(result.stdout)
    assert content["quality"]["vertices"] == pytest.approx(800, rel=0.05)
    assert content["tetrahedralisation"]["asked"] == 800
    assert content["source"] == str(ball)
    assert len(content["sha256"]) == len(content["content_hash"]) == 64
    assert content["out"] is None


def test_info_on_tetrahedra(tmp_path):
    run("make", "beam", "--out", tmp_path / "beam.msh")
    content = json.loads(run("info", tmp_path / "beam.msh", "--json").stdout)
    assert content["quality"]["tets"] == 6 * 15 * 5 * 5
    assert content["quality"]["volume"] == pytest.approx(3.0)
    assert "2,250" in run("info", "beam").stdout


def test_info_on_surfaces(ball):
    content = json.loads(run("info", ball, "--json").stdout)
    assert content["surface"]["triangles"] == 1280
    assert content["surface"]["closed"] is True
    assert content["enclosed_volume"] == pytest.approx(0.519, abs=1e-3)
    assert "enclosed volume [m^3]" in run("info", ball).stdout


def test_info_on_open_surfaces(tmp_path):
    path = tmp_path / "half.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    result = run("info", path)
    assert "cannot be filled" in result.stderr
    assert json.loads(run("info", path, "--json").stdout)["enclosed_volume"] is None


def test_info_lists_the_catalogue():
    names = {entry["name"] for entry in json.loads(run("info", "--json").stdout)["meshes"]}
    assert {"rabbit", "sphere", "cube", "beam", "ipc_bunny"} <= names
    assert "rabbit" in run("info").stdout


def test_convert_keeps_the_mesh(tmp_path, ball):
    run("make", "cube", "--vertices", 64, "--out", tmp_path / "cube.vtu")
    run("convert", tmp_path / "cube.vtu", tmp_path / "cube.t")
    assert read_tets(tmp_path / "cube.t")[0].content_hash == read_tets(tmp_path / "cube.vtu")[0].content_hash
    run("convert", ball, tmp_path / "ball.obj")
    assert read_surface(tmp_path / "ball.obj").content_hash == read_surface(ball).content_hash
    assert "surfaces cannot be written" in refusal("convert", ball, tmp_path / "ball.vtu")
    assert "tetrahedra cannot be written" in refusal("convert", tmp_path / "cube.t", tmp_path / "cube.ply")


def test_messages_go_to_standard_error(tmp_path):
    path = tmp_path / "a.t"
    path.write_text("Vertex 0 0 0 0\nVertex 1 1 0 0\nVertex 2 0 1 0\nVertex 3 0 0 1\nTet 0 1 0 2 3\n")
    result = run("convert", path, tmp_path / "a.vtu")
    assert "winding repaired: 1 of 1" in result.stderr
    assert "winding" not in result.stdout
    content = json.loads(run("info", path, "--json").stdout)
    assert content["messages"][0].startswith("winding repaired")


def test_targets_are_checked_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr("meshes.make.make_tets", lambda *_: pytest.fail("worked in vain"))
    existing = tmp_path / "there.vtu"
    existing.write_text("mine")
    assert "exists already" in refusal("make", "rabbit", "--out", existing)
    assert existing.read_text() == "mine"
    assert "folder does not exist" in refusal("make", "rabbit", "--out", tmp_path / "no" / "a.vtu")
    assert "tetrahedra cannot be written" in refusal("make", "rabbit", "--out", tmp_path / "a.ply")
    assert "is a folder" in refusal("make", "rabbit", "--out", tmp_path)


def test_force_overwrites(tmp_path):
    out = tmp_path / "beam.vtu"
    out.write_text("old")
    run("make", "beam", "--out", out, "--force")
    assert len(read_tets(out)[0].points) == 576


def test_unwritable_target():
    assert "cannot be written" in refusal("make", "beam", "--out", "/proc/beam.vtu")


def test_unknown_mesh():
    with pytest.raises(MeshError, match="did you mean rabbit"):
        run("make", "rabit")


def test_download_shows_terms(monkeypatch, tmp_path):
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path))
    message = refusal("download", "ipc_bunny")
    assert "credit: github.com/ipc-sim/IPC" in message
    assert "--accept-terms" in message
    monkeypatch.setattr("meshes.remote.download", lambda name, accept_terms: tmp_path / name)
    result = run("download", "ipc_bunny", "--accept-terms")
    assert result.stdout.startswith(str(tmp_path / "ipc_bunny"))
    assert "terms: repository under the MIT licence" in result.stdout


def test_loading_the_command_is_light():
    code = (
        "import sys, femgal.commands.mesh\n"
        "print({'numpy', 'numba', 'scipy', 'meshio', 'rich', 'h5py'} & set(sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
