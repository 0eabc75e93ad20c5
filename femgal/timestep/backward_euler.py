# SPDX-License-Identifier: BSD-3-Clause
"""Backward Euler as the minimisation of an incremental potential (Lu et al. 2025, Eq. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.solvers.solver import Outcome, Solver, minimise
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import Motion, MotionState, place

Floats = NDArray[np.float64]

# Share of the substeps of a frame taken again that the next frame begins with.
CAUTION_KEPT = 0.8


@dataclass(eq=False)
class BackwardEuler:
    """x_{n+1} = argmin phi with xhat = x_n + h v_n + h^2 g, then v_{n+1} = (x_{n+1} - x_n) / h.

    Parameters
    ----------
    backend : Element passes.
    solver : Minimises phi, starting from xhat.
    substeps : Steps per frame.
    gravity : g [m/s^2], shape [3].
    damping : Mass-proportional Rayleigh coefficient alpha [1/s].
    motions : Prescribed motions of the constrained vertices.
    """

    backend: Backend
    solver: Solver
    substeps: int
    gravity: Floats
    damping: float = 0.0
    motions: Sequence[Motion] = ()
    _last: IncrementalPotential | None = field(default=None, init=False, repr=False)

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero."""
        x, v = x0.copy(), v0.copy()
        place(self.motions, 0.0, x)
        return MotionState(0.0, x, v)

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """The given number of substeps, or more after a frame that had to be taken again.

        The solver may prepare for their length.
        """
        if substeps is None:
            taken = int(state.memory.get("substeps", (0,))[0])
            substeps = max(self.substeps, math.ceil(CAUTION_KEPT * taken))
        return self.solver.prepare(state, duration / substeps), substeps

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """Ask for more substeps when the motion was lost, and remember those that were needed.

        Solved well enough an implicit step has no stability limit; few sweeps with fixed step lengths have one.
        """
        if not np.isfinite(state.x).all():
            return state, 2 * substeps
        memory = {name: array for name, array in state.memory.items() if name != "substeps"}
        if substeps > self.substeps:
            memory["substeps"] = np.array([substeps])
        return replace(state, memory=memory), None

    def step(self, state: MotionState, h: float) -> MotionState:
        """Minimise the incremental potential of one step."""
        potential = self.potential(state, h)
        result = minimise(self.solver, potential, state.memory)
        self._last = potential
        v = self.backend.difference(result.x, state.x, 1.0 / h)
        converged = None if result.outcome is Outcome.ITERATIONS else result.outcome is Outcome.CONVERGED
        memory = state.memory if result.memory is None else result.memory
        return MotionState(state.time + h, result.x, v, memory, result.corrections, converged)

    def potential(self, state: MotionState, h: float) -> IncrementalPotential:
        """The incremental potential of the step that follows a state."""
        # Completing the square in x of the damping (see IncrementalPotential) leaves (xhat + alpha h x_n) / inertia.
        inertia = 1.0 + self.damping * h
        xhat = self.backend.predict(state.x, state.v, h, self.gravity, inertia)
        x_n = state.x
        if self.motions:
            place(self.motions, state.time + h, xhat)
            x_n = state.x.copy()
            place(self.motions, state.time + h, x_n)
        return IncrementalPotential(self.backend, xhat, h, inertia, x_n)

    def residual(self, state: MotionState) -> Floats | None:
        """(x - xhat) + h^2 M^-1 grad E [m] of the last step, shape [n, 3]; None before the first."""
        return None if self._last is None else self._last.residual(state.x)
