# SPDX-License-Identifier: BSD-3-Clause
"""What a key accepts, in words.

1. Every key of every table has words for what it accepts, and those of a number give its bounds and unit.
2. Bounds in words are the bounds that are checked: the type and the words come from one declaration.
"""

from __future__ import annotations

import pytest

from femgal.scene.allowed import allowed_text, tables
from femgal.scene.model import Body, Scene, SolverSettings
from femgal.scene.shapes import Random, Selector, Turn


def every_table(model):
    yield model
    for field in model.model_fields.values():
        for inner in tables(field.annotation):
            yield from every_table(inner)


def test_every_key_has_words():
    keys = [(name, field) for model in set(every_table(Scene)) for name, field in model.model_fields.items()]
    assert len(keys) > 60
    for name, field in keys:
        words = allowed_text((name,), field)
        assert words
        assert words != "a list", name


@pytest.mark.parametrize(
    ("model", "name", "words"),
    [
        (Body, "E", "0 < E [Pa]"),
        (Body, "nu", "-1 < nu < 0.5"),
        (Body, "vertices", "8 <= vertices, an integer"),
        (Body, "height", "0 < height <= 1e+09 [m]"),
        (Body, "translate", "three finite numbers, [x, y, z] [m]"),
        (Body, "up", '"x", "y", "z"'),
        (Body, "mesh", "a catalogue name or the path of a mesh file"),
        (Body, "rotate", "a table with keys from: axis, degrees"),
        (Scene, "damping", "0 <= damping [1/s]"),
        (SolverSettings, "safety", "0 < safety <= 1"),
        (SolverSettings, "tolerance", "0 < tolerance [m]"),
        (Selector, "relative", "true or false"),
        (Turn, "degrees", "a number [degrees]"),
        (Random, "seed", "0 <= seed, an integer"),
    ],
)
def test_words(model, name, words):
    assert allowed_text((name,), model.model_fields[name]) == words
