# SPDX-License-Identifier: BSD-3-Clause
"""How problems of a scene are told.

1. All problems of a file come in one error, in one message, in the order of the file's tables.
2. A misspelt key lists the keys there are and names the nearest.
3. The error is an `InputError` whose attributes hold the first problem.
4. Values are shown as in a scene file and shortened.
"""

from __future__ import annotations

import pytest

from femgal.scene.allowed import shown
from femgal.scene.load import parse_scene
from femgal.scene.problems import Problem, SceneError, close_match, key_text
from meshes.errors import InputError

TWO_WRONG = """
frame = 3
[[bodies]]
mesh = "cube"
E = -1.0
nu = 0.4
rho = 1000.0
[[bodies]]
mesh = "cube"
E = 1.0
nu = 0.4
roh = 1000.0
"""


def test_all_problems_at_once():
    with pytest.raises(SceneError) as error:
        parse_scene(TWO_WRONG, "two.toml")
    assert [problem.key for problem in error.value.problems] == [
        "bodies[0].E",
        "bodies[1].rho",
        "bodies[1].roh",
        "frame",
    ]
    message = str(error.value)
    assert message.startswith("two.toml: 4 problems in the scene\n")
    for problem in error.value.problems:
        assert "\n".join(problem.lines()) in message


def test_misspelt_keys():
    with pytest.raises(SceneError) as error:
        parse_scene(TWO_WRONG, "two.toml")
    message = str(error.value)
    assert "bodies[1].roh: unknown key" in message
    assert "mesh, vertices, slivers, height" in message
    assert "did you mean rho?" in message
    assert "did you mean frames?" in message


def test_is_an_input_error():
    error = SceneError([Problem("bodies[0].E", "out of range", "-1.0", "0 < E [Pa]", "raise it")], source="a.toml")
    assert isinstance(error, InputError)
    assert (error.where, error.what, error.found, error.allowed) == ("a.toml", "out of range", "-1.0", "0 < E [Pa]")
    assert str(error) == (
        "a.toml: 1 problem in the scene\n"
        "  bodies[0].E: out of range\n"
        "    found:   -1.0\n"
        "    allowed: 0 < E [Pa]\n"
        "    do:      raise it"
    )


def test_key_text():
    assert key_text(("bodies", 0, "regions", 12, "E")) == "bodies[0].regions[12].E"
    assert key_text(()) == ""


def test_close_match():
    assert close_match("Velocty", ["velocity", "vertices"]) == "did you mean velocity?"
    assert close_match("e", ["E", "nu"]) == "did you mean E?"
    assert close_match("qqq", ["velocity", "vertices"]) == ""


def test_shown():
    assert shown({"a": True, "b": ["x", 1.5]}) == '{a = true, b = ["x", 1.5]}'
    assert len(shown(list(range(1000)))) == 100
    assert shown(list(range(1000))).endswith("...")
