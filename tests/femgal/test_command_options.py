# SPDX-License-Identifier: BSD-3-Clause
"""Options that change a scene.

1. Each option sets its key; ``--set`` reaches any, and the named options come after it.
2. What is no setting ends the command with exit code 2 and says what one looks like.
"""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from femgal.cli import main
from femgal.commands.options import scene_from_options
from femgal.scene.problems import SceneError


def test_options_set_their_keys():
    scene = scene_from_options(
        "beam-stretch",
        vertices=300,
        frames=3,
        settings=("bodies.0.rho = 500", "solver.name=fas", "solver.iterations=7"),
        solver="jacobi",
        substeps=5,
        iterations=None,
        threads=1,
    )
    assert (scene.bodies[0].vertices, scene.frames, scene.bodies[0].rho) == (300, 3, 500.0)
    assert (scene.solver.name, scene.solver.substeps) == ("jacobi", 5)
    assert (scene.solver.iterations, scene.solver.threads) == (7, 1)


@pytest.mark.parametrize("text", ["nonsense", "=3", ""])
def test_no_setting(text):
    with pytest.raises(SceneError, match="KEY=VALUE"):
        scene_from_options("beam-stretch", None, None, (text,))
    result = CliRunner().invoke(main, ["plan", "beam-stretch", "--set", text])
    assert result.exit_code == 2
    for part in ("--set", "not an override", text, "KEY=VALUE"):
        assert part in result.stderr
