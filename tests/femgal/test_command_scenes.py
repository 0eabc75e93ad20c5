# SPDX-License-Identifier: BSD-3-Clause
"""``femgal scenes``.

1. The list names every built-in scene with description, vertices and frames, as a table and as JSON.
2. ``--show`` prints the scene file and nothing else; what it prints loads as the scene.
3. An unknown name, or options that exclude one another, are refused.
"""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from femgal.commands.scenes import command
from femgal.scene import builtin
from femgal.scene.load import load_scene, parse_scene
from femgal.scene.problems import SceneError


def run(*arguments):
    return CliRunner().invoke(command, arguments, catch_exceptions=True)


def test_table():
    result = run()
    assert result.exit_code == 0
    for name in builtin.names():
        assert name in result.output
    for column in ("scene", "description", "vertices", "frames"):
        assert column in result.output


def test_json():
    rows = json.loads(run("--json").output)
    assert [row["name"] for row in rows] == list(builtin.names())
    assert rows[0]["vertices"] == 5000
    assert rows[0]["frames"] == 60
    assert rows[0]["bodies"] == [{"mesh": "rabbit", "vertices": 5000}]


@pytest.mark.parametrize("name", builtin.names())
def test_show(name):
    output = run("--show", name).output
    assert output == builtin.text(name)
    assert parse_scene(output, "saved.toml") == load_scene(name)


def test_refusals():
    assert isinstance(run("--show", "rabit-drape").exception, SceneError)
    result = run("--show", "rabbit-drape", "--json")
    assert result.exit_code == 2
    assert "leave --json out" in result.output
