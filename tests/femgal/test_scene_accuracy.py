# SPDX-License-Identifier: BSD-3-Clause
"""What a scene may say of its accuracy.

1. A share and a percentage mean the same; an accuracy alone means `auto`, and `auto` alone means 1%.
2. Values that mean nothing or cannot be reached are refused with what is allowed.
3. Solvers without a control of their error, and settings that contradict it, are refused.
4. On the command line an accuracy replaces the scene's own solver, and one that is named keeps its place.
5. A scene with an accuracy can be written and read back.
"""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from femgal.cli import main
from femgal.commands.options import scene_from_options
from femgal.scene.load import parse_scene
from femgal.scene.problems import SceneError
from femgal.scene.write import scene_to_toml

BODY = '[[bodies]]\nmesh = "cube"\nE = 1e6\nnu = 0.4\nrho = 1000.0\n'


def solver(text: str):
    return parse_scene(f"{BODY}[solver]\n{text}\n", "my.toml").solver


@pytest.mark.parametrize("text", ['"1%"', '"0.01"', "0.01", '" 1 % "', '"1.0e0%"'])
def test_a_share_and_a_percentage(text):
    assert solver(f"accuracy = {text}").accuracy == pytest.approx(0.01, rel=1e-15)


def test_an_accuracy_alone_chooses_and_auto_alone_keeps_one_per_cent():
    assert (solver('accuracy = "5%"').name, solver('name = "auto"').accuracy) == ("auto", 0.01)
    assert solver('name = "verlet"').accuracy is None
    assert solver('name = "newton-multigrid"\naccuracy = 0.1').name == "newton-multigrid"


@pytest.mark.parametrize(
    "text",
    ['"-1%"', '"200%"', "0", "-0.5", "1e-12", '"1e-7"', '"0.00001%"', "nan", '"nan"', '"%"', '""', "true", "[1]"],
)
def test_accuracies_that_mean_nothing(text):
    with pytest.raises(SceneError, match=r"solver.accuracy") as error:
        solver(f"accuracy = {text}")
    assert 'from 1e-06 to 0.5, as 0.01 or "1%"' in str(error.value)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('name = "fas"', ["solver.accuracy", 'name = "fas"', '"newton-multigrid"']),
        ('name = "verlet"\nsubsteps = 5', ["solver.substeps", "5", "none with accuracy"]),
        ('name = "auto"\nsubsteps = 5', ["solver.substeps", "the accuracy chooses them"]),
        ('name = "verlet"\nmass_scaling = 0.01', ["solver.mass_scaling", "another mass"]),
        ('name = "verlet"\nprecision = "float32"', ["solver.accuracy", "1e-05", "0.0001", "float64"]),
    ],
)
def test_settings_that_contradict_an_accuracy(text, parts):
    with pytest.raises(SceneError) as error:
        solver(f"{text}\naccuracy = 1e-5")
    assert all(part in str(error.value) for part in parts)


def test_on_the_command_line():
    scene = scene_from_options("beam-stretch", None, None, (), accuracy="2%")
    assert (scene.solver.name, scene.solver.accuracy, scene.solver.substeps) == ("auto", 0.02, None)
    scene = scene_from_options("beam-stretch", None, None, (), accuracy="0.02", solver="newton-multigrid")
    assert (scene.solver.name, scene.solver.accuracy) == ("newton-multigrid", 0.02)
    for text in ("200%", "1e-12", "soon"):
        result = CliRunner().invoke(main, ["plan", "beam-bend", f"--accuracy={text}"])
        assert result.exit_code == 2
        assert "solver.accuracy" in result.stderr


def test_written_and_read_back():
    scene = parse_scene(f'{BODY}[solver]\naccuracy = "1%"\n', "my.toml")
    assert parse_scene(scene_to_toml(scene), "my.toml") == scene
