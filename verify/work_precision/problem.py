# SPDX-License-Identifier: BSD-3-Clause
"""The scenes of a grid, one for each size and material."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from femgal.scene.load import load_scene
from femgal.scene.model import Scene, SolverSettings
from verify.work_precision.grid import Grid


@dataclass(frozen=True)
class Problem:
    """What every solver is asked to solve.

    Parameters
    ----------
    id : Name of the scene, and values of the grid's axes.
    scene : Without a solver of its own.
    axes : vertices, slivers, E, nu and rho as the grid gives them; None where the scene has its own.
    """

    id: str
    scene: Scene
    axes: tuple[tuple[str, float | None], ...]

    @property
    def is_chaotic(self) -> bool:
        """Whether the motion is too sensitive for a comparison frame by frame: a random start."""
        return any(body.initial.kind == "random" for body in self.scene.bodies)


def problems(grid: Grid) -> list[Problem]:
    """Every scene with every size, mesh quality and material, the small ones first.

    Raises
    ------
    SceneError
        No such scene, or one that cannot have these values.
    """
    found = []
    sizes: list[int | None] = [*sorted(grid.vertices)] or [None]
    lists: dict[str, tuple[float, ...]] = {"slivers": grid.slivers, "E": grid.E, "nu": grid.nu, "rho": grid.rho}
    meshes, values = itertools.product(sizes, grid.scenes), itertools.product(*(v or [None] for v in lists.values()))
    for (vertices, name), keys in itertools.product(meshes, values):
        found.append(_problem(grid, name, vertices, dict(zip(lists, keys, strict=True))))
    return found


def _problem(grid: Grid, name: str, vertices: int | None, keys: dict[str, float | None]) -> Problem:
    plain = load_scene(name, vertices=vertices, overrides=grid.set)
    given = {key: value for key, value in keys.items() if value is not None}
    overrides = {f"bodies.{body}.{key}": value for body in range(len(plain.bodies)) for key, value in given.items()}
    scene = load_scene(name, vertices=vertices, overrides={**grid.set, **overrides})
    words = [scene.name, *([str(vertices)] if vertices else []), *(f"{key}={value:g}" for key, value in given.items())]
    bare = scene.model_copy(update={"solver": SolverSettings()})
    return Problem(" ".join(words), bare, (("vertices", vertices), *keys.items()))
