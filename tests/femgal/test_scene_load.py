# SPDX-License-Identifier: BSD-3-Clause
"""Reading scenes from names, files and text.

1. A scene is found by built-in name or by path; what is not found lists the built-in scenes and the nearest name.
2. A file that is not TOML gives line, column and the line itself; one that is not text or not readable says so.
3. `vertices` goes to every body, `frames` and dotted overrides replace what the file says, and are checked like it.
4. Relative mesh paths count from the scene file's folder, catalogue names stay as they are.
5. A scene without a name has that of its file.
"""

from __future__ import annotations

import pytest

from femgal.scene.load import load_scene, parse_scene
from femgal.scene.problems import SceneError

BODY = '[[bodies]]\nmesh = "cube"\nE = 1e6\nnu = 0.4\nrho = 1000.0\n'


def write(folder, text, name="mine.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_by_path_and_by_name(tmp_path):
    path = write(tmp_path, BODY)
    assert load_scene(path) == load_scene(str(path)) == parse_scene(BODY, "mine.toml")
    assert load_scene(path).name == "mine"
    assert load_scene("rabbit-drape").name == "rabbit-drape"


def test_unknown_scene():
    with pytest.raises(SceneError) as error:
        load_scene("rabit-drape")
    for part in ("no such scene", "beam-stretch", "cube-random", "did you mean rabbit-drape?"):
        assert part in str(error.value)


def test_missing_file(tmp_path):
    with pytest.raises(SceneError, match=r"gone\.toml") as error:
        load_scene(tmp_path / "gone.toml")
    assert "the path of a TOML file" in str(error.value)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("frames = 3\ngravity = [0, 0,, 1]\n", ["line 2, column 17", "gravity = [0, 0,, 1]", "not valid TOML"]),
        ("frames 3\n", ["line 1, column 8", "Expected '='"]),
        ("frames = 3\nframes = 4\n", ["line 2", "Cannot overwrite a value"]),
        ("frames = " + "9" * 5000, ["not valid TOML", "4300"]),
        ("name = " + "[" * 5000, ["not valid TOML"]),
        ("frames = 3\nname = [1,\n", ["line 3, at the end of the file", "not valid TOML"]),
    ],
)
def test_not_toml(tmp_path, text, parts):
    with pytest.raises(SceneError) as error:
        load_scene(write(tmp_path, text))
    for part in ["mine.toml: 1 problem", *parts]:
        assert part in str(error.value)


def test_not_text(tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(b"frames = 3\n\xff\xfe")
    with pytest.raises(SceneError, match=r"not a text file\n    found:   byte 11 is not UTF-8"):
        load_scene(path)


def test_folder_instead_of_file(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path)


def test_byte_order_mark(tmp_path):
    assert load_scene(write(tmp_path, "\ufeff" + BODY)).bodies[0].E == 1e6


def test_vertices_and_frames():
    scene = load_scene("beam-stretch", vertices=99, frames=7)
    assert [body.vertices for body in scene.bodies] == [99, 99, 99, 99]
    assert scene.frames == 7


def test_overrides():
    scene = load_scene("beam-stretch", overrides={"bodies.0.rho": 1, "solver.name": "jacobi", "output.every": 5})
    assert [body.rho for body in scene.bodies] == [1.0, 2600.0, 2600.0, 2600.0]
    assert (scene.solver.name, scene.output.every) == ("jacobi", 5)


def test_overrides_are_checked():
    with pytest.raises(SceneError) as error:
        load_scene("rabbit-drape", vertices=2, frames=0, overrides={"bodies.0.E": -1.0, "solver.nam": "fas"})
    keys = {problem.key for problem in error.value.problems}
    assert keys == {"bodies[0].vertices", "frames", "bodies[0].E", "solver.nam"}


def test_mesh_paths(tmp_path):
    text = BODY.replace('"cube"', '"parts/cube.msh"') + BODY
    found = [body.mesh for body in load_scene(write(tmp_path, text)).bodies]
    assert found == [str(tmp_path.resolve() / "parts" / "cube.msh"), "cube"]


def test_absolute_mesh_path(tmp_path):
    absolute = str(tmp_path.resolve() / "cube.msh")
    assert (
        parse_scene(BODY.replace('"cube"', f'"{absolute}"'), "x", folder=tmp_path / "other").bodies[0].mesh == absolute
    )
