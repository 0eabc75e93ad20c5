# SPDX-License-Identifier: BSD-3-Clause
"""A solver that is counted and watched while it works as it always does."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.solvers.solver import Outcome, Solver, SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]


@dataclass(eq=False)
class CountedSolver:
    """Hands everything on to a solver.

    Parameters
    ----------
    solver : Does the work.
    kept : Substeps whose potential and solution are kept.
    iterations : Iterations made so far.
    solutions : (potential, solution [m]) of the first substeps, as many as are to be kept.
    """

    solver: Solver
    kept: int = 0
    iterations: int = field(default=0, init=False)
    solutions: list[tuple[IncrementalPotential, Floats]] = field(default_factory=list, init=False)
    # femgal's Newton counts in the state of a step, those of verify over all steps.
    _products: int | None = field(default=None, init=False, repr=False)
    _linear_before: int = field(default=0, init=False, repr=False)

    @property
    def linear_iterations(self) -> int | None:
        """Iterations of the linear solver so far; None for a solver that does not count them."""
        effort: Any = getattr(self.solver, "effort", None)
        return self._products if effort is None else int(effort.linear) - self._linear_before

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """As the solver."""
        return self.solver.prepare(state, potential)

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """As the solver."""
        return self.solver.init(potential, memory)

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One iteration of the solver."""
        self.iterations += 1
        return self.solver.step(potential, state)

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """As the solver."""
        return self.solver.finished(potential, state)

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """As the solver."""
        products: int | None = getattr(state, "products", None)
        if products is not None:
            self._products = (self._products or 0) + products
        state = self.solver.conclude(potential, state)
        if len(self.solutions) < self.kept:
            self.solutions.append((potential, state.x.copy()))
        return state

    def forget(self) -> None:
        """Begin to count and to keep anew."""
        effort: Any = getattr(self.solver, "effort", None)
        self._linear_before = 0 if effort is None else int(effort.linear)
        self.iterations, self._products = 0, None
        self.solutions.clear()
