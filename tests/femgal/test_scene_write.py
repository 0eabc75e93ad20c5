# SPDX-License-Identifier: BSD-3-Clause
"""Writing scenes as TOML.

1. Reading what was written gives an equal scene: built-in scenes, and one that uses every kind of value.
"""

from __future__ import annotations

import pytest

from femgal.scene import builtin
from femgal.scene.load import load_scene, parse_scene
from femgal.scene.write import scene_to_toml

EVERYTHING = r"""
name = "quote \" backslash \\ tab \t delete \u007f smile \U0001F600"
description = '''two
lines'''
frames = 3
frames_per_second = 29.97
gravity = [0.1, 1e-300, -9.81]
damping = 0.30000000000000004
[[bodies]]
mesh = "some-name"
vertices = 100
size = 0.1
up = "x"
rotate = [{ axis = "y", degrees = 12.5 }, { axis = [1, 2, 3], degrees = -7 }]
translate = [1, 2, 3]
E = 123456.789
nu = -0.2
rho = 1e-3
regions = [{ id = 3, E = 1e9 }, { where = { all = true }, nu = 0.1, rho = 2.0 }]
[bodies.initial]
kind = "stretched"
pulls = [{ where = { sphere = { center = [0, 0, 0], radius = 0.5 }, relative = true }, offset = [1, 0, 0] }]
[[bodies]]
mesh = "other"
E = 1.0
nu = 0.0
rho = 1.0
initial = { kind = "sphere", placement = "projected", radius = 2.0 }
[[bodies]]
mesh = "other"
E = 1.0
nu = 0.0
rho = 1.0
initial = { kind = "flat", normal = "x", thickness = 0.01 }
[[constraints]]
where = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
path = { times = [0.0, 0.1], offsets = [[0, 0, 0], [0.1, 0.2, 0.3]] }
rotation = { times = [0, 1], degrees = [0, 90], axis = "z", center = [0, 0, 0] }
[[constraints]]
body = 1
where = { none = true }
[solver]
name = "verlet"
tolerance = 1e-9
layers = 2
steps = [0.25, 0.5]
threads = 1
[output]
fields = ["J"]
format = "vtu"
"""


@pytest.mark.parametrize("name", builtin.names())
def test_builtin_scenes_survive(name):
    scene = load_scene(name, vertices=500)
    assert parse_scene(scene_to_toml(scene), "again.toml") == scene


def test_the_ratio_of_the_linear_transfer_survives():
    scene = load_scene("rabbit-drape", overrides={"solver.transfer": "linear"})
    text = scene_to_toml(scene)
    assert "ratio = 8" in text
    assert parse_scene(text, "again.toml") == scene


def test_every_kind_of_value_survives():
    scene = parse_scene(EVERYTHING, "everything.toml")
    text = scene_to_toml(scene)
    assert parse_scene(text, "again.toml") == scene
    assert scene_to_toml(parse_scene(text, "again.toml")) == text
