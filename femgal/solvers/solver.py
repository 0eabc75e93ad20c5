# SPDX-License-Identifier: BSD-3-Clause
"""What every minimiser of the incremental potential offers: init / step / finished with an explicit state."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.deferred import Deferred, Number
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]


class Outcome(enum.Enum):
    """Why a solver stopped; the value says what happened and what to try."""

    CONVERGED = "The residual fell below the tolerance."
    ITERATIONS = "All iterations asked for were made; no tolerance was set."
    NOT_CONVERGED = "The residual is above the tolerance after all iterations. Try more of them, or more substeps."
    DIVERGED = "The iterate is no longer finite. Try more substeps, or steps = 'exact'."


@dataclass(eq=False)
class SolverState:
    """Iterate of a solver.

    Parameters
    ----------
    x : Positions [m], shape [n, 3]; the solver owns and overwrites it.
    iteration : Iterations made.
    corrections : Largest correction [m] of each layer in the last iteration, finest first.
    outcome : Why the iteration ended; None while it goes on.
    memory : Arrays that the solver hands on to the next step; None leaves those of the last one.
    """

    x: Floats
    iteration: int = 0
    corrections: tuple[Number, ...] = ()
    outcome: Outcome | None = None
    memory: dict[str, NDArray] | None = None


@dataclass(frozen=True)
class Budget:
    """When to stop: after a number of iterations, or earlier at a residual.

    Parameters
    ----------
    iterations : At most this many.
    tolerance : Stop when eps18 [m] is below; None spares the gradient pass that finding out costs.
    """

    iterations: int = 1
    tolerance: float | None = None

    def outcome(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        # What a device has not told yet is not waited for: the end of the frame looks at the positions.
        if not all(isinstance(size, Deferred) or math.isfinite(size) for size in state.corrections):
            return Outcome.DIVERGED
        if self.tolerance is not None and potential.eps18(state.x) <= self.tolerance:
            return Outcome.CONVERGED
        if state.iteration < self.iterations:
            return None
        return Outcome.ITERATIONS if self.tolerance is None else Outcome.NOT_CONVERGED


class Solver(Protocol):
    """A minimiser of the incremental potential."""

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Whatever depends on the length of the step, put into the state's memory; called before each frame.

        Parameters
        ----------
        potential : Like those of the steps to come; its prediction is the present state.
        """

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """First iterate."""

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One iteration."""

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """The state with what the solver wants to remember; called once, after the last iteration."""


def minimise(solver: Solver, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
    """Iterate until the solver says that it has finished; the state's outcome says why."""
    state = solver.init(potential, memory)
    while (outcome := solver.finished(potential, state)) is None:
        state = solver.step(potential, state)
    state.outcome = outcome
    return solver.conclude(potential, state)
