# SPDX-License-Identifier: BSD-3-Clause
"""The production solvers as plain steps, implicit ones driven to a tight tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.hierarchy.layer import free_parts
from femgal.kernels.backend import Backend
from femgal.solvers.explicit_jacobi import ExplicitJacobi
from femgal.solvers.explicit_vbd import ExplicitVBD
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi, ScalarJacobi
from femgal.solvers.newton import Newton
from femgal.solvers.preconditioner import LayerBlocks
from femgal.solvers.smoother import Relaxation
from femgal.solvers.solver import Budget, Solver
from femgal.solvers.vbd import VBD
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.bdf2 import BDF2
from femgal.timestep.implicit import ImplicitMethod
from femgal.timestep.state import Motion, MotionState, TimeStepper
from femgal.timestep.tr_bdf2 import TRBDF2
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


def production(name: str, use: Use) -> SolverUnderTest:
    """A production solver by name, with backends of the run."""
    method: Method = "verlet" if name == "verlet" else _IMPLICIT[name][0]
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
            self._built = (key, stepper(self.name, self.use, disc, state.gravity, motions))
        return self._built[1]


def stepper(name: str, use: Use, disc: Discretisation, gravity: Floats, motions: tuple[Motion, ...]) -> TimeStepper:
    """The time stepping of a production solver, one step a frame."""
    backend = use.backend(disc)
    if name == "verlet":
        return VelocityVerlet(backend, gravity, motions=motions, substeps=1)
    method, build = _IMPLICIT[name]
    return _STEPPINGS[method](backend, build(disc, backend), 1, gravity, motions=motions)


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


def _newton(disc: Discretisation, backend: Backend) -> Newton:
    layers = build_constant_hierarchy(disc, 8).layers
    return Newton(backend, LayerBlocks(layers), _budget(disc), free_parts=free_parts(disc))


def _vbd(disc: Discretisation, backend: Backend) -> VBD:
    return VBD(backend, _budget(disc), free_parts(disc))


def _explicit_jacobi(disc: Discretisation, backend: Backend) -> ExplicitJacobi:
    return ExplicitJacobi(backend, _budget(disc), free_parts(disc))


def _explicit_vbd(disc: Discretisation, backend: Backend) -> ExplicitVBD:
    return ExplicitVBD(backend, _budget(disc), free_parts(disc))


_STEPPINGS: Mapping[str, type[ImplicitMethod]] = {"backward-euler": BackwardEuler, "bdf2": BDF2, "tr-bdf2": TRBDF2}

_IMPLICIT: Mapping[str, tuple[Method, Callable[[Discretisation, Backend], Solver]]] = {
    "fas": ("backward-euler", _fas),
    "fas-linear": ("backward-euler", _fas_linear),
    "fas-bdf2": ("bdf2", _fas),
    "newton-multigrid": ("tr-bdf2", _newton),
    "newton-multigrid-euler": ("backward-euler", _newton),
    "newton-multigrid-bdf2": ("bdf2", _newton),
    "vbd": ("backward-euler", _vbd),
    "vbd-explicit": ("backward-euler", _explicit_vbd),
    "jacobi": ("backward-euler", _jacobi),
    "jacobi-explicit": ("backward-euler", _explicit_jacobi),
    "scalar-jacobi": ("backward-euler", _scalar_jacobi),
}

PRODUCTION = ("verlet", *_IMPLICIT)
