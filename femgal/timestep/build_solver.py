# SPDX-License-Identifier: BSD-3-Clause
"""From the settings of a scene to a solver of implicit steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.hierarchy import Hierarchy
from femgal.hierarchy.layer import Layer, free_parts
from femgal.kernels.backend import Backend
from femgal.scene.model import Scene, SolverSettings
from femgal.scene.plan import Plan
from femgal.solvers.chebyshev import Chebyshev, Iteration
from femgal.solvers.cycle import Cycle
from femgal.solvers.explicit_jacobi import ExplicitJacobi
from femgal.solvers.explicit_vbd import ExplicitVBD
from femgal.solvers.fas import FAS
from femgal.solvers.jacobi import Jacobi, ScalarJacobi
from femgal.solvers.lattice_vcycle import LatticeVCycle
from femgal.solvers.layer_cycle import LayerCycle
from femgal.solvers.mas import MAS
from femgal.solvers.newton import Newton
from femgal.solvers.preconditioner import LayerBlocks, Preconditioner
from femgal.solvers.smoother import LU2025_STEPS, StepRule
from femgal.solvers.solver import Budget, Solver
from femgal.solvers.vbd import VBD

# Where an accuracy is asked for, each step's residual falls to this many times it. Unsolved residuals add up over the
# steps: reductions of 0.05 left 0.1 to 0.3 % of the motions of five scenes wrong, 0.01 some 0.05 %.
REDUCTION_PER_ACCURACY = 2.0


@dataclass(frozen=True, eq=False)
class _Parts:
    """What solvers are made of.

    Parameters
    ----------
    layers : Layers, finest first; the finest alone for solvers without others.
    free : Layer of the parts that no constraint holds, or None.
    keeps_blocks : Whether blocks may be kept over several substeps.
    gravity : g [m/s^2], shape [3].
    """

    settings: SolverSettings
    backend: Backend
    layers: tuple[Layer, ...]
    free: Layer | None
    keeps_blocks: bool
    gravity: NDArray[np.float64]

    @property
    def budget(self) -> Budget:
        return Budget(self.settings.iterations, self.settings.tolerance)

    @property
    def steps(self) -> StepRule:
        steps = self.settings.steps
        if steps in ("spectral", "exact", "backtracking"):
            return steps
        return LU2025_STEPS if steps == "lu2025" else steps


def build_solver(scene: Scene, plan: Plan, backend: Backend, hierarchy: Hierarchy | None) -> Solver:
    """The solver that the scene asks for, with the stages that the plan says run.

    Raises
    ------
    InputError
        A setting that this solver cannot work with.
    """
    settings, gravity = scene.solver, np.asarray(scene.gravity, np.float64)
    layers = hierarchy.layers if hierarchy else (backend.vertices,)
    free = free_parts(backend.disc) if plan.runs("momentum of free parts") else None
    parts = _Parts(settings, backend, layers, free, plan.runs("kept blocks"), gravity)
    if settings.name == "newton-multigrid":
        made = _PRECONDITIONERS[settings.preconditioner](parts)
        return Newton(backend, made, parts.budget, _reduction(settings), settings.linear_iterations, free)
    solver = _SMOOTHERS[settings.name](parts)
    return solver if settings.chebyshev is None else Chebyshev(solver, settings.chebyshev)


def _reduction(settings: SolverSettings) -> float:
    """What a step's residual falls to: what is asked for, or less where an accuracy needs it."""
    if settings.accuracy is None:
        return settings.reduction
    return min(settings.reduction, REDUCTION_PER_ACCURACY * settings.accuracy)


def _fas(parts: _Parts) -> FAS:
    settings = parts.settings
    cycle = Cycle(settings.cycle, settings.pre, settings.post)
    return FAS(parts.backend, parts.layers, parts.steps, parts.budget, parts.free, parts.keeps_blocks, cycle=cycle)


def _jacobi(kind: type[Jacobi]) -> Callable[[_Parts], Jacobi]:
    return lambda parts: kind(
        parts.backend, parts.layers, parts.steps, parts.budget, parts.free, keep_blocks=parts.keeps_blocks
    )


def _vbd(parts: _Parts) -> VBD:
    return VBD(parts.backend, parts.budget, parts.free, parts.settings.relaxation, "adaptive", parts.gravity)


def _explicit_jacobi(parts: _Parts) -> ExplicitJacobi:
    return ExplicitJacobi(parts.backend, parts.budget, parts.free, parts.settings.sweeps, steps=parts.steps)


def _explicit_vbd(parts: _Parts) -> ExplicitVBD:
    settings = parts.settings
    return ExplicitVBD(parts.backend, parts.budget, parts.free, settings.sweeps, w=settings.relaxation)


_SMOOTHERS: dict[str, Callable[[_Parts], Iteration]] = {
    "fas": _fas,
    "jacobi": _jacobi(Jacobi),
    "scalar-jacobi": _jacobi(ScalarJacobi),
    "jacobi-explicit": _explicit_jacobi,
    "vbd": _vbd,
    "vbd-explicit": _explicit_vbd,
}

_PRECONDITIONERS: dict[str, Callable[[_Parts], Preconditioner]] = {
    "blocks": lambda parts: LayerBlocks(parts.layers),
    "layers": lambda parts: LayerBlocks(parts.layers),
    "cycle": lambda parts: LayerCycle(parts.layers),
    "mas": lambda parts: MAS(parts.backend),
    "v-cycle": lambda parts: LatticeVCycle(parts.backend),
}
