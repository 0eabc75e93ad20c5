# SPDX-License-Identifier: BSD-3-Clause
"""Implicit time stepping as a minimisation: what backward Euler, BDF2 and TR-BDF2 have in common.

A formula for x' = v, M v' = M g - grad E(x) reads

    x_{n+1} = y + h_e v_{n+1},    v_{n+1} = w + h_e (g - M^-1 grad E(x_{n+1}))

with y and w from the states before it and an effective step h_e. So x_{n+1} minimises the incremental potential with
h_e in place of h and xhat = y + h_e w + h_e^2 g (Lu et al. 2025, Eq. 1, where y = x_n, w = v_n, h_e = h).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.solvers.solver import Outcome, Solver, minimise
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import Motion, MotionState, least_substeps, place

Floats = NDArray[np.float64]

# Share of the substeps of a frame taken again that the next frame begins with.
CAUTION_KEPT = 0.8


@dataclass(frozen=True, eq=False)
class Past:
    """What a formula takes from the states before a step.

    Parameters
    ----------
    y : [m], shape [n, 3].
    w : [m/s], shape [n, 3].
    h_e : Effective step [s].
    """

    y: Floats
    w: Floats
    h_e: float


@dataclass(eq=False)
class ImplicitMethod(ABC):
    """x_{n+1} = argmin phi, then v_{n+1} = (x_{n+1} - y) / h_e; a subclass says what y, w and h_e are.

    Parameters
    ----------
    backend : Element passes.
    solver : Minimises phi.
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

    # See IncrementalPotential.
    least_response: ClassVar[float]

    @abstractmethod
    def past(self, state: MotionState, h: float) -> Past:
        """y, w and h_e of a step of h seconds that follows a state."""

    @abstractmethod
    def effective_step(self, h: float) -> float:
        """h_e [s] of steps of h seconds that follow each other."""

    def memory(self, state: MotionState, h: float) -> dict[str, NDArray]:
        """What the step after the next needs of the state before the next, a step of h seconds."""
        return {}

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero."""
        x, v = self.backend.to_device(x0.copy()), self.backend.to_device(v0.copy())
        place(self.backend, self.motions, 0.0, x)
        return MotionState(0.0, x, v)

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """The given number of substeps, or more after a frame that had to be taken again.

        The solver may prepare for their length. Damping is left out there: it adds to the inertia, which makes every
        system easier.
        """
        if substeps is None:
            taken = int(state.memory.get("substeps", (0,))[0])
            substeps = max(self.substeps, least_substeps(state), math.ceil(CAUTION_KEPT * taken))
        h_e = self.effective_step(duration / substeps)
        potential = IncrementalPotential(self.backend, state.x, h_e, least_response=self.least_response)
        return self.solver.prepare(state, potential), substeps

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """Ask for more substeps when the motion was lost, and remember those that were needed.

        Solved well enough an implicit step has no stability limit; few sweeps with fixed step lengths have one.
        """
        if not self.backend.is_finite(state.x):
            return state, 2 * substeps
        memory = {name: array for name, array in state.memory.items() if name != "substeps"}
        if substeps > max(self.substeps, least_substeps(state)):
            memory["substeps"] = np.array([substeps])
        return replace(state, memory=memory), None

    def step(self, state: MotionState, h: float) -> MotionState:
        """Minimise the incremental potential of one step."""
        after = self.solve(state, self.past(state, h), state.time + h)
        return replace(after, memory=after.memory | self.memory(state, h))

    def solve(self, state: MotionState, past: Past, time: float) -> MotionState:
        """The state at a time, from what the formula takes from those before it.

        Parameters
        ----------
        state : The state before, where the solver may begin.
        past : y, w and h_e.
        time : [s]; prescribed vertices are where they have to be then.
        """
        potential = self._potential(state, past, time)
        result = minimise(self.solver, potential, state.memory)
        self._last = potential
        v = self.backend.difference(result.x, past.y, 1.0 / past.h_e)
        converged = None if result.outcome is Outcome.ITERATIONS else result.outcome is Outcome.CONVERGED
        memory = state.memory if result.memory is None else result.memory
        return MotionState(time, result.x, v, memory, result.corrections, converged)

    def potential(self, state: MotionState, h: float) -> IncrementalPotential:
        """The incremental potential of the step that follows a state."""
        return self._potential(state, self.past(state, h), state.time + h)

    def _potential(self, state: MotionState, past: Past, time: float) -> IncrementalPotential:
        # Completing the square in x of the damping (see IncrementalPotential) divides w and g by 1 + alpha h_e.
        inertia = 1.0 + self.damping * past.h_e
        xhat = self.backend.predict(past.y, past.w, past.h_e, self.gravity, inertia)
        x_n = state.x
        if self.motions:
            place(self.backend, self.motions, time, xhat)
            x_n = self.backend.copy(state.x)
            place(self.backend, self.motions, time, x_n)
        return IncrementalPotential(self.backend, xhat, past.h_e, inertia, x_n, self.least_response, time)

    def residual(self, state: MotionState) -> Floats | None:
        """(x - xhat) + h_e^2 M^-1 grad E [m] of the last step, shape [n, 3]; None before the first."""
        return None if self._last is None else self._last.residual(state.x)
