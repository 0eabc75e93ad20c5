# SPDX-License-Identifier: BSD-3-Clause
"""Standing waves of finite amplitude, and production's solvers and time stepping to move them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.backend import Backend
from femgal.solvers.chebyshev import Chebyshev
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi
from femgal.solvers.solver import Budget, Solver
from femgal.timestep.state import MotionState, TimeStepper
from femgal.timestep.velocity_verlet import VelocityVerlet
from meshes.generators import box
from verify.problems.bodies import rng, uniform
from verify.reference.straight_motion import lattice_frequency

Floats = NDArray[np.float64]

WAVES = ("longitudinal", "shear")
SOLVERS = ("fas", "chebyshev")

# Largest displacement of a wave [m]; its steepest slope is 0.38.
AMPLITUDE = 0.12

# Residual [m] at which the solvers stop.
STOP: dict[str, float] = {"float64": 1e-13, "float32": 1e-8}


@dataclass(frozen=True, eq=False)
class Wave:
    """A standing wave of half a wavelength between two walls, of 38 % strain, at rest at time zero.

    Parameters
    ----------
    disc : A regular grid, held at both walls.
    shape : Displacement over amplitude, shape [n, 3].
    speed : Of the wave [m/s].
    omega : Frequency of the mesh [1/s].
    """

    disc: Discretisation
    shape: Floats
    speed: float
    omega: float

    @property
    def start(self) -> Floats:
        """Positions at time zero [m], shape [n, 3]."""
        return self.disc.mesh.points + AMPLITUDE * self.shape


@cache
def standing_wave(kind: str) -> Wave:
    """Motion along x, between walls across x or across y; eight cells of 0.125 m between the walls."""
    along = WAVES.index(kind)
    size, cells = [0.4, 0.4, 0.3], [3, 3, 3]
    size[along], cells[along] = 1.0, 8
    mesh = box((size[0], size[1], size[2]), (cells[0], cells[1], cells[2]))
    s = mesh.points[:, along]
    disc = uniform(mesh, np.flatnonzero((s < 1e-9) | (s > 1.0 - 1e-9)))
    speed = math.sqrt((disc.mu[0] + (disc.lam[0] if along == 0 else 0.0)) / 1000.0)
    shape = np.sin(np.pi * s)[:, None] * [1.0, 0.0, 0.0]
    return Wave(disc, shape, speed, lattice_frequency(speed, 1.0, 8))


def build_solver(name: str, backend: Backend, stop: float) -> Solver:
    """FAS, or block Jacobi accelerated by Chebyshev, that iterates until the residual is below `stop` [m]."""
    budget = Budget(3000, stop)
    if name == "fas":
        return FAS(backend, build_constant_hierarchy(backend.disc, 8).layers, "exact", budget)
    return Chebyshev(Jacobi(backend, (backend.vertices,), "spectral", budget))


def motion(stepper: TimeStepper, start: Floats, h: float, steps: int) -> list[MotionState]:
    """States of a motion from rest: the first one and those after each step of h seconds."""
    state, _ = stepper.begin_frame(stepper.init(start, np.zeros_like(start)), h, 1)
    states = [state]
    for _ in range(steps):
        states.append(stepper.step(states[-1], h))
    return states


def verlet(backend: Backend) -> VelocityVerlet:
    """Velocity Verlet without gravity, one step a frame."""
    return VelocityVerlet(backend, np.zeros(3), substeps=1)


def straight_line_state(disc: Discretisation) -> Floats:
    """Positions [m] of a body moved along x by random numbers that turn some elements over, shape [n, 3]."""
    moved = rng(401).standard_normal((disc.n_vertices, 1)) * disc.free[:, None]
    edge = float(np.cbrt(6.0 * disc.V.mean()))
    return disc.mesh.points + edge * moved * [1.0, 0.0, 0.0]
