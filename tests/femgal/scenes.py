# SPDX-License-Identifier: BSD-3-Clause
"""Small scenes for tests of whole runs."""

from __future__ import annotations

from femgal.scene.load import parse_scene
from femgal.scene.model import Scene

HANGING_BEAM = """
name = "hanging-beam"
frames = {frames}

[[bodies]]
mesh = "beam"
vertices = 400
E = 1e5
nu = 0.4
rho = 1000.0
velocity = [0.0, 0.0, -1.0]

[[constraints]]
where = {{halfspace = {{point = [0.1, 0.5, 0.5], normal = [-1, 0, 0]}}, relative = true}}
{path}

[solver]
name = "{solver}"
ratio = 8
{solver_lines}

[output]
fields = ["displacement", "velocity", "von_mises"]
format = "{format}"
checkpoint_every = {checkpoint_every}
"""


def hanging_beam_text(
    frames: int = 6,
    solver: str = "fas",
    solver_lines: str = "substeps = 10",
    path: str = "",
    format: str = "vtkhdf",
    checkpoint_every: int = 2,
) -> str:
    """TOML of a beam with one end held and the rest moving downwards."""
    return HANGING_BEAM.format(**locals())


def hanging_beam(**options: object) -> Scene:
    """The same, validated."""
    return parse_scene(hanging_beam_text(**options), "hanging-beam.toml")  # type: ignore[arg-type]
