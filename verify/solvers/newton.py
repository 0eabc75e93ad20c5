# SPDX-License-Identifier: BSD-3-Clause
"""Newton's method with an exchangeable solver of its linear systems: the baselines that solvers are compared with.

Lu et al. 2025 (section 7) run their baselines "with adaptive Newton iterations and a fixed relative error tolerance of
5e-3" and say no more. Read here as

1. every linear system is solved to |b - A d| <= eta |b|, or as far as 2. asks for where that is less;
2. Newton's iteration ends when |grad phi| <= 2 eta |grad phi at its start|: with eta itself the last digit, which the
   linear solver leaves undone, would cost a second system in every step;
3. it starts where phi is least on the line from the state before the step to the prediction, so that phi never grows;
4. steps are halved until phi falls by a fair share of what the slope promises (Armijo 1966). phi along a line is a
   polynomial, so all trial steps together cost one energy pass;
5. the Hessian is the exact one. Where it turns out not to be positive definite, the system is made anew with the
   positive semi-definite part of every element's (Smith et al. 2019), and so are all those that follow in the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.solvers.line_search import backtrack, first_minimum
from femgal.solvers.solver import Outcome, SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from verify.solvers.conjugate_gradients import LinearSolution
from verify.solvers.system import LinearSystem

Floats = NDArray[np.float64]

# Of the body's size: a correction below is rounding.
_ROUNDING = 1e-14


@dataclass(eq=False)
class Effort:
    """What a solver has done since it was made.

    Parameters
    ----------
    newton : Linear systems solved.
    linear : Iterations in all of them.
    definite : Systems with the positive semi-definite parts.
    """

    newton: int = 0
    linear: int = 0
    definite: int = 0


@dataclass(eq=False)
class NewtonState(SolverState):
    """An iterate with its forces.

    Parameters
    ----------
    g : grad phi(x) at the free vertices [N], shape [k, 3].
    start : |g| at the first iterate [N].
    definite : Whether the step has met an indefinite Hessian.
    whole : Largest |component| [m] of the last Newton step before its line search.
    """

    g: Floats = field(default_factory=lambda: np.empty((0, 3)))
    start: float = 0.0
    definite: bool = False
    whole: float = 0.0


@dataclass(eq=False)
class Newton:
    """Minimises phi.

    Parameters
    ----------
    backend : Element passes.
    system : Linear systems.
    tolerance : eta.
    iterations : Newton iterations at most.
    """

    backend: Backend
    system: LinearSystem
    tolerance: float = 5e-3
    iterations: int = 20
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        self._size = float(np.ptp(self.backend.disc.mesh.points, axis=0).max())

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Nothing depends on the length of the step."""
        return state

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> NewtonState:
        """Start where phi is least on the line from the last state to the prediction."""
        backend, x = self.backend, potential.xhat.copy()
        if potential.x_n is not None:
            x, d = potential.x_n.copy(), backend.difference(potential.xhat, potential.x_n)
            backend.add_scaled(x, first_minimum(potential.along(backend.vertices, x, d)), d)
        g = self._forces(potential, x)
        return NewtonState(x, g=g, start=self._norm(g))

    def step(self, potential: IncrementalPotential, state: SolverState) -> NewtonState:
        """One Newton iteration."""
        assert isinstance(state, NewtonState)
        backend, x = self.backend, state.x
        solution, definite = self._solve(potential, state)
        d = np.zeros_like(x)
        backend.prolong(backend.vertices, solution.d, d)
        coefficients = potential.along(backend.vertices, x, d)
        # The same number as the one it replaces, but free of the rounding in a sum over elements.
        coefficients[0] = backend.dot(state.g, solution.d)
        t = backtrack(coefficients)
        backend.add_scaled(x, t, d)
        whole, g = float(backend.largest(solution.d)), self._forces(potential, x)
        return NewtonState(x, state.iteration + 1, (t * whole,), g=g, start=state.start, definite=definite, whole=whole)

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        assert isinstance(state, NewtonState)
        left = self._norm(state.g)
        if not math.isfinite(left):
            return Outcome.DIVERGED
        if left == 0.0 or (state.iteration > 0 and self._is_solved(left, state)):
            return Outcome.CONVERGED
        # A step of no length would be followed by the same one again.
        stuck = state.iteration > 0 and state.corrections[0] == 0.0
        return Outcome.NOT_CONVERGED if stuck or state.iteration >= self.iterations else None

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """Nothing to remember."""
        return state

    def _is_solved(self, left: float, state: NewtonState) -> bool:
        return left <= 2.0 * self.tolerance * state.start or 0.0 < state.whole <= _ROUNDING * self._size

    def _solve(self, potential: IncrementalPotential, state: NewtonState) -> tuple[LinearSolution, bool]:
        """d with A d = -g, and whether the definite part of A was needed."""
        b = self.backend.difference(np.zeros_like(state.g), state.g)
        tolerance = min(0.5, max(self.tolerance, self.tolerance * state.start / self._norm(b)))
        for definite in (False, True)[int(state.definite) :]:
            solution = self._attempt(potential, state.x, b, tolerance, definite)
            self.effort.newton, self.effort.linear = self.effort.newton + 1, self.effort.linear + solution.iterations
            self.effort.definite += definite
            if solution.definite:
                break
        return solution, definite

    def _attempt(
        self, potential: IncrementalPotential, x: Floats, b: Floats, tolerance: float, definite: bool
    ) -> LinearSolution:
        try:
            self.system.linearise(potential, x, definite=definite)
            return self.system.solve(b, tolerance)
        except np.linalg.LinAlgError:
            # Cholesky's method on a coarse level.
            return LinearSolution(np.zeros_like(b), 0, 1.0, definite=False)

    def _forces(self, potential: IncrementalPotential, x: Floats) -> Floats:
        return self.backend.nodal_gradient(self.backend.vertices, x, potential.xhat, potential.inverse_h2)

    def _norm(self, g: Floats) -> float:
        return math.sqrt(self.backend.dot(g, g))
