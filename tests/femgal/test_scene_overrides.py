# SPDX-License-Identifier: BSD-3-Clause
"""Single keys set from outside a scene file.

1. ``KEY=VALUE`` is split at the first ``=`` and the value read as TOML, else as text.
2. A dotted key reaches into tables and lists; missing tables are made, missing list entries are refused.
"""

from __future__ import annotations

import pytest

from femgal.scene.overrides import apply_override, parse_override
from femgal.scene.problems import SceneError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bodies.0.rho=1.5", ("bodies.0.rho", 1.5)),
        ("frames = 3", ("frames", 3)),
        ("solver.name=jacobi", ("solver.name", "jacobi")),
        ('solver.name="jacobi"', ("solver.name", "jacobi")),
        ("solver.steps=[0.25, 0.5]", ("solver.steps", [0.25, 0.5])),
        ("bodies.0.mesh=a=b.msh", ("bodies.0.mesh", "a=b.msh")),
        ("constraints.0.where={ none = true }", ("constraints.0.where", {"none": True})),
        ("frames=" + "9" * 5000, ("frames", "9" * 5000)),
        ("a=" + "[" * 5000, ("a", "[" * 5000)),
    ],
)
def test_parse(text, expected):
    assert parse_override(text) == expected


@pytest.mark.parametrize("text", ["frames", "=3", ""])
def test_not_an_override(text):
    with pytest.raises(SceneError, match="KEY=VALUE"):
        parse_override(text)


def test_apply():
    data = {"bodies": [{"E": 1.0}, {"E": 2.0, "initial": {"kind": "rest"}}]}
    apply_override(data, "bodies.1.E", 3.0, "x")
    apply_override(data, "bodies[1].initial.kind", "flat", "x")
    apply_override(data, "solver.name", "fas", "x")
    expected = {"bodies": [{"E": 1.0}, {"E": 3.0, "initial": {"kind": "flat"}}], "solver": {"name": "fas"}}
    assert data == expected


@pytest.mark.parametrize(
    ("key", "parts"),
    [
        ("bodies.2.E", ["bodies.2.E: no such key to override", "found:   2", "0 to 1"]),
        ("bodies.first.E", ["found:   first"]),
        ("bodies.7", ["0 to 1"]),
        ("empty.0", ["the list is empty"]),
        ("frames.count", ["count in a single value"]),
        ("frames.count.x", ["count in a single value"]),
    ],
)
def test_refused(key, parts):
    data = {"bodies": [{}, {}], "empty": [], "frames": 3}
    with pytest.raises(SceneError) as error:
        apply_override(data, key, 1.0, "x.toml")
    for part in ["x.toml", *parts]:
        assert part in str(error.value)
