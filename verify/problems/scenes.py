# SPDX-License-Identifier: BSD-3-Clause
"""Scenes that cases run as a user would: through plan, hierarchy and solver of `femgal.simulation`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.frame import Frame
from femgal.scene.model import Scene
from femgal.simulation import Simulation
from femgal.timestep.potential import eps18
from meshes.errors import InputError
from meshes.types import TetMesh
from verify.integrators.under_test import Material, State
from verify.suite.case import Skip
from verify.suite.use import Use, unavailable

Floats = NDArray[np.float64]

# Catalogue name and vertices of each mesh, and where it is held, as a share of its extent along x.
BODIES = {
    "bar": ("beam", 60, 0.0),
    "beam": ("beam", 200, 0.0),
    "rabbit": ("rabbit", 700, 0.1),
    "bunny": ("bunny", 600, 0.1),
    "bunny-2000": ("bunny", 2000, 0.1),
}


def hanging(mesh: str, frames: int, *, E: float = 1e5, **solver: Any) -> Scene:
    """A body of one metre, held at the low end of x, that starts to sag at rest.

    Parameters
    ----------
    mesh : A key of `BODIES`.
    solver : Keys of the scene's solver table.
    """
    name, vertices, end = BODIES[mesh]
    selector = {"halfspace": {"point": [end, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}, "relative": True}
    body = {"mesh": name, "vertices": vertices, "size": 1.0, "E": E, "nu": 0.4, "rho": 1000.0}
    table = {"frames": frames, "bodies": [body], "constraints": [{"where": selector}], "solver": solver}
    return Scene.model_validate({"name": f"{mesh} that sags", **table})


def simulation(scene: Scene, use: Use, threads: int | None = None) -> Simulation:
    """A scene ready to run, with the threads of the run or others.

    Raises
    ------
    Skip
        The mesh is not on this machine, or the device cannot be used, or not for this scene.
    """
    if reason := unavailable(use.device):
        raise Skip(reason)
    settings = scene.solver.model_copy(update={"threads": threads or use.threads, "device": use.device})
    try:
        return Simulation.prepare(scene.model_copy(update={"solver": settings}))
    except InputError as error:
        if use.device != "cpu" and (error.where or "").startswith("solver."):
            raise Skip(f"{error.where} = {error.found} is {error.what}") from error
        if any(body.mesh == "bunny" for body in scene.bodies):
            raise Skip(f"bunny.ply is not in a folder of FEMGAL_MESH_PATH ({error.what})") from error
        raise


@dataclass(frozen=True, eq=False)
class Run:
    """Frames of a scene.

    Parameters
    ----------
    simulation : What was run.
    displacements : x - X [m] after each frame, shape [frames, n, 3].
    residuals : eps18 [m] of the last substep of each frame; NaN where no equation is solved.
    """

    simulation: Simulation
    displacements: Floats
    residuals: Floats


def steps_alone(simulation: Simulation) -> Run:
    """Run a scene frame by frame as its method steps, whatever becomes of its energy: no frame is taken again."""
    stepper, T, X = simulation.stepper, simulation.frame_duration, simulation.disc.mesh.points
    state, displacements, residuals = simulation.start(), [], []
    for _ in range(simulation.scene.frames):
        state, substeps = stepper.begin_frame(state, T)
        for _ in range(substeps):
            state = stepper.step(state, T / substeps)
        residual = stepper.residual(state)
        residuals.append(np.nan if residual is None else eps18(residual))
        displacements.append(state.x - X)
        state, _ = stepper.end_frame(state, T, substeps)
    return Run(simulation, np.stack(displacements), np.array(residuals))


def frames_of(simulation: Simulation) -> list[Frame]:
    """All frames of a scene, frame 0 the start, with energy check and retakes."""
    return list(simulation.frames())


def displacements_of(simulation: Simulation) -> Floats:
    """x - X [m] after each frame, shape [frames, n, 3]."""
    return np.stack([frame.state.x for frame in frames_of(simulation)[1:]]) - simulation.disc.mesh.points


def as_problem(simulation: Simulation) -> tuple[TetMesh, Material, State]:
    """What a plain step is given to solve the same scene: mesh, material, start."""
    world = simulation.world
    constrained = np.concatenate([np.empty(0, np.int64), *(motion.vertices for motion in world.motions)])
    material = Material.of(world.mesh, world.E, world.nu, world.rho)
    return world.mesh, material, State(world.x0, world.v0, constrained, simulation.gravity)
