# SPDX-License-Identifier: BSD-3-Clause
"""The scenes that come with femgal.

1. The default scene comes first; every file is valid, named as its file, described, and commented.
2. An unknown name is refused with the names there are.
3. The numbers that the scenes stand for: materials of the published table, 1.5 and 20 times the length.
"""

from __future__ import annotations

import pytest

from femgal.scene import builtin
from femgal.scene.load import load_scene
from femgal.scene.problems import SceneError


def test_names():
    expected = {"rabbit-drape", "bunny-drape", "beam-stretch", "bunny-stretch", "cube-random", "beam-bend"}
    assert builtin.names()[0] == builtin.DEFAULT == "rabbit-drape"
    assert expected <= set(builtin.names())


@pytest.mark.parametrize("name", builtin.names())
def test_files(name):
    scene = load_scene(name)
    assert scene.name == name
    assert scene.description
    assert all(body.vertices for body in scene.bodies)
    assert sum(line.startswith("#") for line in builtin.text(name).splitlines()) >= 2


def test_unknown_name():
    with pytest.raises(SceneError, match="did you mean cube-random"):
        builtin.text("cube-randm")


@pytest.mark.parametrize("name", ["rabbit-drape", "bunny-drape"])
def test_drapes(name):
    scene = load_scene(name)
    (body,) = scene.bodies
    assert (body.E, body.nu, body.rho, body.height) == (1e6, 0.4, 1000.0, 1.0)
    assert body.velocity == (0.0, 0.0, -1.0)
    assert scene.gravity == (0.0, 0.0, -9.81)
    assert (body.vertices, scene.frames) == (5000, 60)


def test_beam_stretch():
    scene = load_scene("beam-stretch")
    assert [body.nu for body in scene.bodies] == [0.1, 0.2, 0.4, 0.49]
    assert scene.gravity == (0.0, 0.0, 0.0)
    pull = scene.constraints[1].path
    assert pull.offsets[-1][0] == 0.5 * scene.bodies[0].size


def test_bunny_stretch():
    scene = load_scene("bunny-stretch")
    assert [body.initial.kind for body in scene.bodies] == ["rest", "stretched", "rest"]
    assert scene.bodies[1].initial.pulls[0].offset == (0.0, 0.0, 19.0)
    assert [c.path.offsets[-1][2] for c in scene.constraints[1:]] == [19.0, 19.0]
