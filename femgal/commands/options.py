# SPDX-License-Identifier: BSD-3-Clause
"""Options that `run` and `plan` share: they change a scene before it is validated."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from femgal.scene.model import Scene

_OPTIONS = (
    click.argument("scene", required=False),
    click.option("--vertices", type=click.IntRange(min=8), help="Vertices of every body."),
    click.option("--frames", type=click.IntRange(min=1), help="Number of frames."),
    click.option("--accuracy", help="Relative error of the motion, 1% or 0.01; chooses solver and substeps."),
    click.option("--solver", help="auto, fas, newton-multigrid, verlet, vbd, jacobi ..., with its own defaults."),
    click.option("--substeps", type=click.IntRange(min=1), help="Time steps per frame."),
    click.option("--iterations", type=click.IntRange(min=1), help="Cycles, sweeps or Newton iterations per substep."),
    click.option("--device", help="cpu, or cuda for a GPU; see femgal doctor."),
    click.option("--threads", type=click.IntRange(min=1), help="CPU threads; all by default."),
    click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Any key: --set bodies.0.rho=1"),
)


def scene_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the scene argument and the options that change it."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def scene_from_options(
    scene: str | None,
    vertices: int | None,
    frames: int | None,
    settings: tuple[str, ...],
    **solver: str | int | None,
) -> Scene:
    """Load the scene that the options describe; the default one when none is named.

    Raises
    ------
    InputError
        The scene, or a value given, cannot be used.
    """
    from femgal.scene.builtin import DEFAULT
    from femgal.scene.load import load_scene
    from femgal.scene.overrides import parse_override

    overrides: dict[str, object] = dict(parse_override(text) for text in settings)
    if solver.get("accuracy") is not None and solver.get("solver") is None:
        overrides.setdefault("solver.name", "auto")
    names = {"solver": "solver.name"}
    overrides |= {names.get(k, f"solver.{k}"): v for k, v in solver.items() if v is not None}
    return load_scene(scene or DEFAULT, vertices=vertices, frames=frames, overrides=overrides)
