# SPDX-License-Identifier: BSD-3-Clause
"""The production solvers as plain steps, implicit ones driven to a tight tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.hierarchy.layer import free_parts
from femgal.kernels.backend import Backend
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi, ScalarJacobi
from femgal.solvers.smoother import Relaxation
from femgal.solvers.solver import Budget
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.state import Motion, MotionState, TimeStepper
from femgal.timestep.velocity_verlet import VelocityVerlet
from meshes.types import TetMesh
from verify.integrators.under_test import (
    ORDERS,
    Floats,
    Material,
    Method,
    SolverError,
    SolverUnderTest,
    State,
    discretised,
)
from verify.problems.bodies import Moving
from verify.suite.use import Use

# eps18 of a solved step over the size of the body. The distance from the minimiser is no larger, in the norm that
# weights vertices by their mass, wherever the elastic energy is convex.
TOLERANCE = 1e-13
_MOST_ITERATIONS = 20_000

PRODUCTION = ("verlet", "fas", "fas-linear", "jacobi", "scalar-jacobi")


def production(name: str, use: Use) -> SolverUnderTest:
    """A production solver by name, with backends of the run."""
    method: Method = "verlet" if name == "verlet" else "backward-euler"
    return SolverUnderTest(name, _Production(name, use), method, ORDERS[method])


@dataclass(eq=False)
class _Production:
    """Keeps what it has built for as long as body, constraints and gravity stay the same."""

    name: str
    use: Use
    _built: tuple[tuple[object, ...], TimeStepper] | None = field(default=None, init=False)

    def __call__(self, mesh: TetMesh, material: Material, state: State, h: float) -> State:
        stepper = self._stepper(mesh, material, state)
        start = MotionState(0.0, state.x, state.v, dict(state.memory))
        if not state.memory:
            start = stepper.init(state.x, state.v)
        ready, _ = stepper.begin_frame(start, h, 1)
        after = stepper.step(ready, h)
        if after.converged is False:
            raise SolverError(f"{self.name} has not reached eps18 = {TOLERANCE:g} of the body's size")
        return replace(state, x=after.x, v=after.v, memory=after.memory)

    def _stepper(self, mesh: TetMesh, material: Material, state: State) -> TimeStepper:
        held = state.x[state.constrained]
        key = (mesh, material, state.constrained.tobytes(), held.tobytes(), state.gravity.tobytes())
        if self._built is None or self._built[0] != key:
            disc = discretised(mesh, material, state.constrained)
            motions = (Moving(state.constrained, held),) if len(held) else ()
            self._built = (key, self._build(disc, state.gravity, motions))
        return self._built[1]

    def _build(self, disc: Discretisation, gravity: Floats, motions: tuple[Motion, ...]) -> TimeStepper:
        backend = self.use.backend(disc)
        if self.name == "verlet":
            return VelocityVerlet(backend, gravity, motions=motions, substeps=1)
        return BackwardEuler(backend, _SOLVERS[self.name](disc, backend), 1, gravity, motions=motions)


def _budget(disc: Discretisation) -> Budget:
    return Budget(_MOST_ITERATIONS, TOLERANCE * float(np.ptp(disc.mesh.points, axis=0).max()))


def _fas(disc: Discretisation, backend: Backend) -> Relaxation:
    layers = build_constant_hierarchy(disc, 8).layers
    return FAS(backend, layers, "spectral", _budget(disc), free_parts(disc))


def _fas_linear(disc: Discretisation, backend: Backend) -> Relaxation:
    layers = build_linear_hierarchy(disc).layers
    return FAS(backend, layers, "exact", _budget(disc), free_parts(disc), keep_blocks=True)


def _jacobi(disc: Discretisation, backend: Backend) -> Relaxation:
    return Jacobi(backend, (backend.vertices,), "spectral", _budget(disc), free_parts(disc))


def _scalar_jacobi(disc: Discretisation, backend: Backend) -> Relaxation:
    return ScalarJacobi(backend, (backend.vertices,), "backtracking", _budget(disc), free_parts(disc))


_SOLVERS: dict[str, Callable[[Discretisation, Backend], Relaxation]] = {
    "fas": _fas,
    "fas-linear": _fas_linear,
    "jacobi": _jacobi,
    "scalar-jacobi": _scalar_jacobi,
}
