# SPDX-License-Identifier: BSD-3-Clause
"""From the settings of a scene to a time-stepping method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import Hierarchy
from femgal.hierarchy.layer import free_parts
from femgal.kernels.backend import Backend
from femgal.kernels.cpu.threads import Workers
from femgal.scene.model import Scene, SolverSettings
from femgal.scene.plan import Plan
from femgal.timestep import tr_bdf2, velocity_verlet
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.bdf2 import BDF2
from femgal.timestep.bottleneck import find_bottleneck
from femgal.timestep.build_solver import build_solver
from femgal.timestep.control import AccuracyControl, ErrorEstimator
from femgal.timestep.frequency_shift import FrequencyShift
from femgal.timestep.implicit import ImplicitMethod
from femgal.timestep.mass_scaling import MassScaling, scale_mass
from femgal.timestep.repeated import repeated
from femgal.timestep.stable_step import element_stiffness, vertex_stiffness
from femgal.timestep.state import Motion, TimeStepper
from femgal.timestep.tr_bdf2 import TRBDF2
from femgal.timestep.velocity_verlet import VelocityVerlet

# With two steps in a frame da/dt was 0.3 of what it should be, just after a sudden start; with a single step of TR-BDF2
# at the start there is none at all, and 0.14 to 1.0 of the error was found.
FEWEST_OF_VERLET, FEWEST_AT_FIRST = 8, 2

_STEPPINGS: dict[str, type[ImplicitMethod]] = {"backward-euler": BackwardEuler, "bdf2": BDF2, "tr-bdf2": TRBDF2}


def build_stepper(
    scene: Scene, plan: Plan, backend: Backend, hierarchy: Hierarchy | None, motions: Sequence[Motion]
) -> TimeStepper:
    """The method that `scene.solver` asks for, with the stages that the plan says run."""
    settings, gravity = scene.solver, np.asarray(scene.gravity, np.float64)
    damping = scene.damping if plan.runs("damping") else 0.0
    motions = motions if plan.runs("fixed vertices") or plan.runs("moving vertices") else ()
    if settings.name == "verlet":
        verlet = VelocityVerlet(backend, gravity, damping, motions, settings.safety, settings.substeps)
        shift = FrequencyShift(backend, velocity_verlet.FREQUENCY_SHIFT, fewest=FEWEST_OF_VERLET)
        return _controlled(scene, verlet, backend, shift)
    substeps = plan.substeps
    assert substeps is not None

    solver = build_solver(scene, plan, backend, hierarchy)
    method = _STEPPINGS[settings.stepping]
    if settings.accuracy is None:
        return repeated(method(backend, solver, substeps, gravity, damping, motions), backend)
    euler = 0.5 * tr_bdf2.GAMMA
    shift = FrequencyShift(backend, tr_bdf2.FREQUENCY_SHIFT, fewest=1, euler_share=euler)
    controlled = method(backend, solver, 1, gravity, damping, motions)
    return _controlled(scene, controlled, backend, shift, max(substeps, FEWEST_AT_FIRST))


def _controlled(
    scene: Scene, method: TimeStepper, backend: Backend, estimator: ErrorEstimator, substeps: int = 1
) -> TimeStepper:
    """The method, with its error under control where the scene gives an accuracy."""
    accuracy, stepper = scene.solver.accuracy, repeated(method, backend)
    if accuracy is None:
        return stepper
    free = free_parts(backend.disc) is not None
    return AccuracyControl(stepper, estimator, accuracy, scene.frames, backend, free, substeps)


def prepare_mass(
    settings: SolverSettings, disc: Discretisation
) -> tuple[Discretisation, MassScaling | None, tuple[str, ...]]:
    """The bodies with the mass that the method steps with, what was added to it, and what to warn of.

    Only an explicit method that chooses its own step has anything to do here.
    """
    if settings.name != "verlet" or settings.substeps is not None:
        return disc, None, ()
    stiffness = element_stiffness(disc, Workers(settings.threads))
    k = vertex_stiffness(disc, stiffness)
    if settings.mass_scaling is None:
        bottleneck = find_bottleneck(disc, stiffness, k)
        return disc, None, (str(bottleneck),) if bottleneck else ()
    disc, scaling = scale_mass(disc, k, settings.mass_scaling)
    return disc, scaling, (scaling.warning,) if scaling.warning else ()
