# SPDX-License-Identifier: BSD-3-Clause
"""A small step that every minimiser can be asked for: a beam held at its left end and thrown down."""

from __future__ import annotations

from functools import cache

import numpy as np

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.solver import Solver, SolverState, minimise
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from verify.problems.bodies import distorted_box, left_end, rng
from verify.reference.newton import ReferenceNewton

MESH = distorted_box((12, 6, 6))
X = MESH.points
H = 1.0 / 60.0


@cache
def body(E: float = 1e5, rho: float = 1000.0, held: bool = True) -> Discretisation:
    """The beam of one material."""
    return discretise(MESH, E, 0.4, rho, left_end(MESH) if held else ())


@cache
def thrown(E: float = 1e5, rho: float = 1000.0, held: bool = True) -> IncrementalPotential:
    """A step that bends it enough to need several Newton iterations."""
    disc = body(E, rho, held)
    velocity = np.zeros_like(X)
    velocity[:, 2] = -2.0 * X[:, 0]
    moved = X + H * velocity + 0.002 * rng(320).standard_normal(X.shape)
    return IncrementalPotential(CpuBackend(disc, 1), np.where(disc.free[:, None], moved, X), H, x_n=X)


@cache
def minimiser(E: float = 1e5, rho: float = 1000.0, held: bool = True) -> np.ndarray:
    """Where the step ends."""
    return minimise(ReferenceNewton(body(E, rho, held)), thrown(E, rho, held), {}).x


def solved(solver: Solver, phi: IncrementalPotential) -> SolverState:
    """The last iterate of a solver."""
    state = MotionState(0.0, X, np.zeros_like(X))
    return minimise(solver, phi, solver.prepare(state, phi).memory)


def distance(x: np.ndarray, phi: IncrementalPotential, exact: np.ndarray) -> float:
    """Distance from the minimiser over that of the prediction."""
    return float(np.linalg.norm(x - exact) / np.linalg.norm(phi.xhat - exact))
