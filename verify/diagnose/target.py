# SPDX-License-Identifier: BSD-3-Clause
"""The bodies that are looked at: those of a scene, or a mesh with a material that had to be assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.cpu.backend import CpuBackend
from femgal.scene.build import World, build_world
from femgal.scene.load import load_scene, parse_scene
from femgal.scene.model import Scene
from femgal.scene.problems import SceneError
from meshes.catalogue import resolve
from meshes.errors import InputError
from meshes.make import Made, load
from meshes.ordering import reorder

Integers = NDArray[np.int64]

# A soft rubber; what is said about shape and step scales with it, what is said about locking does not.
ASSUMED = {"E": 1e6, "nu": 0.4, "rho": 1000.0}


@dataclass(frozen=True, eq=False)
class Target:
    """A scene with its arrays.

    Parameters
    ----------
    scene : What the user described.
    world : Mesh, material, start and constraints of all bodies.
    disc : The discretised bodies, without scaled mass.
    assumed : Whether the material is an assumption.
    """

    scene: Scene
    world: World
    disc: Discretisation
    assumed: bool = False

    @property
    def frame(self) -> float:
        """Seconds from frame to frame."""
        return 1.0 / self.scene.frames_per_second

    @cached_property
    def backend(self) -> CpuBackend:
        """Element passes in double precision."""
        return CpuBackend(self.disc, self.scene.solver.threads)

    @property
    def numbers(self) -> Integers:
        """Index of each tetrahedron in the user's own file, or in the mesh as made where it was filled, shape [m]."""
        return self._orders[1]

    @property
    def vertex_numbers(self) -> Integers:
        """The same of each vertex, shape [n]."""
        return self._orders[0]

    @cached_property
    def _orders(self) -> tuple[Integers, Integers]:
        vertices, cells, starts = [], [], (0, 0)
        for body, origin in zip(self.scene.bodies, self.world.origins, strict=True):
            entry = resolve(body.mesh)
            loaded = load(entry) if entry.path is not None else None
            orders = np.arange(origin["vertices"]), np.arange(origin["tets"])
            if isinstance(loaded, Made):
                orders = reorder(loaded.mesh)[1:]
            vertices.append(starts[0] + orders[0])
            cells.append(starts[1] + orders[1])
            starts = starts[0] + len(orders[0]), starts[1] + len(orders[1])
        return np.concatenate(vertices), np.concatenate(cells)

    @property
    def from_file(self) -> bool:
        """Whether `numbers` are those of a single file that the user can look into."""
        return len(self.scene.bodies) == 1 and self.world.origins[0]["stuffing"] is None


def find_target(mesh: str | None, scene: str | None, overrides: Mapping[str, object] | None = None) -> Target:
    """The bodies that a mesh file, a scene or both describe.

    Parameters
    ----------
    mesh : File or catalogue name; replaces the mesh of the scene's first body.
    scene : File or built-in name; an assumed material and no constraint when None.
    overrides : Dotted keys and values, as in `load_scene`.

    Raises
    ------
    InputError
        Either cannot be used.
    """
    if scene is None:
        described = parse_scene(_alone(str(mesh)), Path(str(mesh)).name, overrides=overrides)
    else:
        described = load_scene(scene, overrides=overrides)
        if mesh is not None:
            body = described.bodies[0].model_copy(update={"mesh": mesh, "vertices": None})
            described = described.model_copy(update={"bodies": (body, *described.bodies[1:])})
    try:
        target = target_of(described)
    except SceneError as error:
        # Who gave a mesh and no scene wants to read what the mesh's reader says.
        if scene is None and isinstance(error.__cause__, InputError):
            raise error.__cause__ from None
        raise
    named = any(key.startswith("bodies.0.") and key.split(".")[-1] in ASSUMED for key in overrides or {})
    return replace(target, assumed=scene is None and not named)


def target_of(scene: Scene) -> Target:
    """The bodies of a scene."""
    world = build_world(scene)
    held = np.concatenate([np.empty(0, np.int64), *(motion.vertices for motion in world.motions)])
    return Target(scene, world, discretise(world.mesh, world.E, world.nu, world.rho, held))


def _alone(mesh: str) -> str:
    import json

    material = "\n".join(f"{key} = {value!r}" for key, value in ASSUMED.items())
    return f"[[bodies]]\nmesh = {json.dumps(mesh)}\n{material}\n"
