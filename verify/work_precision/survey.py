# SPDX-License-Identifier: BSD-3-Clause
"""What has to be known of a scene before it is solved: its size, its arrays' digest, and how slowly it swings."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from femgal.scene.build import World, build_world
from femgal.scene.model import Scene
from meshes.quality import dihedrals
from verify.work_precision.lowest_mode import lowest_excited_frequency

# The lowest mode is that of a coarse mesh, for every size of a scene the same.
COARSE = 3000

# Times at which prescribed motions are looked at for the digest.
_SAMPLES = 64


def survey(scene: Scene) -> dict[str, Any]:
    """JSON-ready: size, smallest dihedral angle [degrees], digests, materials, and period of the lowest mode [s].

    Raises
    ------
    InputError
        The scene cannot be built.
    """
    world = build_world(scene)
    frequency = lowest_excited_frequency(_coarse_world(scene, world), scene)
    return {
        "vertices": len(world.mesh.points),
        "tets": len(world.mesh.cells),
        "dihedral": dihedrals(world.mesh.points, world.mesh.cells).minimum,
        "mesh": world.mesh.content_hash,
        "physics": physics_digest(scene, world),
        "E": _span(world.E),
        "nu": _span(world.nu),
        "rho": _span(world.rho),
        "period": None if frequency is None else 1.0 / frequency,
        "failure_kind": None,
    }


def physics_digest(scene: Scene, world: World) -> str:
    """Digest of all that the exact motion depends on, 16 hexadecimal digits; how long it is looked at is left out."""
    digest = hashlib.sha256(world.mesh.content_hash.encode())
    for array in (world.E, world.nu, world.rho, world.x0, world.v0):
        digest.update(np.ascontiguousarray(array, np.float64).tobytes())
    for motion in world.motions:
        digest.update(motion.vertices.tobytes())
        for time in _times(scene):
            digest.update(motion.positions(time).tobytes())
    digest.update(repr((scene.gravity, scene.damping)).encode())
    return digest.hexdigest()[:16]


def _times(scene: Scene) -> list[float]:
    seconds = scene.frames / scene.frames_per_second
    return [float(time) for time in np.linspace(0.0, seconds, _SAMPLES)]


def _coarse_world(scene: Scene, world: World) -> World:
    few = tuple(
        body.model_copy(update={"vertices": COARSE}) if body.vertices and body.vertices > COARSE else body
        for body in scene.bodies
    )
    return world if few == scene.bodies else build_world(scene.model_copy(update={"bodies": few}))


def _span(values: Any) -> tuple[float, float]:
    return float(values.min()), float(values.max())
