# SPDX-License-Identifier: BSD-3-Clause
"""Inexact Newton with matrix-free products: `newton-multigrid`.

Each iteration solves A d = -g, A = d2 phi(x), by conjugate gradients (`femgal.solvers.pcg`) to a share of the residual
that the step began with, and goes along d to the first minimum of phi. phi(x + t d) is a polynomial of degree 6 whose
coefficients cost one energy pass, so the line search is exact, and the polynomial tells how nonlinear the step was:

    nu = |sum_{k >= 3} k c_k t^(k-1)| / |c_1|

is the share of the slope along d that Newton's model of phi does not know of. Where both the linear residual and nu are
below the reduction asked for, the step is done with one Newton iteration; else the next one begins with the residual
itself and stops there if that is small enough.

Residuals are measured by sqrt(g . M^-1 g), M the preconditioner: the square is twice the fall of phi that a step with M
promises [J].

A step starts where the accelerations of the last ones lead (`femgal.solvers.extrapolation`), and the preconditioner
serves as many steps as it is worth (`femgal.solvers.upkeep`). Tried and dropped: steps that trust those before them and
spare line searches and the last look at the residual make a third fewer passes in no less time, and one step per frame
drifted off by 30 % (bunny, 2,000 vertices).

Where conjugate gradients meet negative curvature they begin again with the positive semi-definite part of every
element's Hessian (Smith et al. 2019): with the matrix of a preconditioner that assembles it, made anew at x, or without
a matrix, where a product costs eight gradient passes. A direction that was found without meeting it is one of descent
whatever A is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend
from femgal.solvers.extrapolation import expected_offset, with_acceleration
from femgal.solvers.line_search import first_minimum
from femgal.solvers.pcg import Map, Solution, solve
from femgal.solvers.preconditioner import Assembled, Preconditioner
from femgal.solvers.smoother import smooth
from femgal.solvers.solver import Budget, Outcome, SolverState
from femgal.solvers.upkeep import Memory, Upkeep
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# The linear system need not be solved better than Newton's model is good: at most this share per Newton iteration.
LEAST_REDUCTION = 1e-3


# Accelerations have led to the end of a step where phi is least so near to there on the way, and every element keeps
# this share of its volume. From a start with an element inside out Newton's method finds a minimum where it still is: a
# soft bunny swinging in steps of 1/60 s blew up from there.
AIMED = 0.03
UPRIGHT = 0.2


@dataclass(eq=False)
class NewtonState(SolverState):
    """An iterate and how far it has come.

    Parameters
    ----------
    start : Residual at the first iterate [sqrt(J)].
    left : Residual at x over `start`: measured, or estimated from the last linear solve and nu.
    measured : Whether `left` was measured at x.
    products : Products with A so far.
    """

    start: float = 0.0
    left: float = math.inf
    measured: bool = False
    products: int = 0

    @property
    def recalled(self) -> dict[str, NDArray]:
        """The memory that the solver was given, with what it has added."""
        return self.memory or {}


@dataclass(eq=False)
class Newton:
    """Minimises phi by inexact Newton steps.

    Parameters
    ----------
    backend : Element passes.
    preconditioner : Of the linear systems.
    budget : Newton iterations at most, and an absolute tolerance where one is asked for.
    reduction : Converged when the residual has fallen to this share of that at the start of the step; with an absolute
        tolerance, when that is met, and the first linear system is solved to this share.
    linear_iterations : Conjugate gradient iterations of one Newton iteration, at most.
    free_parts : Layer of the parts that no constraint holds, put where their momentum takes them after each iteration;
        None when there is none. Conjugate gradients that stop early do not keep it.
    """

    backend: Backend
    preconditioner: Preconditioner
    budget: Budget = field(default_factory=lambda: Budget(20))
    reduction: float = 0.05
    linear_iterations: int = 500
    free_parts: Layer | None = None
    _upkeep: Upkeep = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._upkeep = Upkeep(self.preconditioner)

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Nothing: what depends on the step is made when it is needed."""
        return state

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> NewtonState:
        """Start where accelerations lead, if that is a good place on the way from x_n.

        Where the motion is faster than the steps its accelerations lead anywhere: then the start is the least on the
        line to xhat, and from there on along the acceleration, so phi is never above what xhat alone gives.
        """
        backend, offset = self.backend, expected_offset(potential, memory)
        if potential.x_n is None:
            return NewtonState(backend.copy(potential.xhat), memory=memory)
        inertial = backend.difference(potential.xhat, potential.x_n)
        if offset is None:
            return NewtonState(self._least(potential, potential.x_n, inertial)[0], memory=memory)
        whole = backend.copy(inertial)
        backend.add_scaled(whole, 1.0, offset)
        x, t = self._least(potential, potential.x_n, whole)
        if abs(t - 1.0) > AIMED or not self._upright(x):
            x, _ = self._least(potential, potential.x_n, inertial)
            x, _ = self._least(potential, x, offset)
        return NewtonState(x, memory=memory)

    def _upright(self, x: Floats) -> bool:
        """Whether no element is nearly turned inside out."""
        return self.backend.smallest(self.backend.energies(x)[1]) > UPRIGHT

    def _least(self, potential: IncrementalPotential, x: Floats, d: Floats) -> tuple[Floats, float]:
        """x + t d at the first minimum of phi, and t."""
        t = first_minimum(potential.along(self.backend.vertices, x, d))
        x = self.backend.copy(x)
        self.backend.add_scaled(x, t, d)
        return x, t

    def step(self, potential: IncrementalPotential, state: SolverState) -> NewtonState:
        """One Newton iteration, or none where the residual turns out to be small enough."""
        assert isinstance(state, NewtonState)
        backend, x = self.backend, state.x
        g = backend.nodal_gradient(backend.vertices, x, potential.xhat, potential.inverse_h2)
        memory = state.recalled
        if state.iteration == 0:
            # Not in the middle of a step, whose residuals are compared in one norm.
            memory = self._upkeep.make_ready(potential, x, memory)
        solution, start, memory = self._solve(potential, x, g, self._share(state), state, memory)
        start = start or solution.start
        if solution.iterations == 0:
            left = 0.0 if start == 0.0 else solution.start / start
            return NewtonState(x, state.iteration + 1, (0.0,), None, memory, start, left, measured=True)
        if state.iteration == 0:
            memory = self._upkeep.note(solution.iterations, memory)
        d = backend.zeros(len(x))
        backend.prolong(backend.vertices, solution.d, d)
        coefficients = potential.along(backend.vertices, x, d)
        coefficients[0] = backend.dot(g, solution.d)
        t = first_minimum(coefficients)
        backend.add_scaled(x, t, d)
        if self.free_parts is not None:
            smooth(potential, self.free_parts, x, 1.0)
        left = solution.start / start * math.hypot(solution.reduction, nonlinearity(coefficients, t))
        moved = t * float(backend.largest(solution.d))
        products = state.products + solution.iterations
        return NewtonState(x, state.iteration + 1, (moved,), None, memory, start, left, products=products)

    def _share(self, state: NewtonState) -> float | None:
        """Share of the residual that a linear solve may leave; None where that follows from the residual at x."""
        if self.budget.tolerance is not None:
            # Where the end of it is not known, each system is solved better than the last: the model gets better too.
            return self.reduction ** (state.iteration + 1)
        return self.reduction if state.start == 0.0 else None

    def _solve(
        self,
        potential: IncrementalPotential,
        x: Floats,
        g: Floats,
        reduction: float | None,
        state: NewtonState,
        memory: Memory,
    ) -> tuple[Solution, float, Memory]:
        """Conjugate gradients on A d = -g, with the definite part of A where that turns out to be needed.

        Returns
        -------
        solution, memory
        start : Residual at the first iterate, in the norm of the preconditioner there is now; 0 where this is it.
        """
        backend = self.backend
        b = backend.difference(backend.zeros(len(g)), g)
        if reduction is None:
            now = math.sqrt(max(0.0, backend.dot(b, self.preconditioner.apply(b))))
            if now <= self.reduction * state.start:
                return Solution(backend.zeros(len(b)), 0, now, 1.0), state.start, memory
            # A little more than what is missing: the model is better now than at the start.
            reduction = min(0.5, 0.5 * self.reduction * state.start / now)
        reduction = max(LEAST_REDUCTION, reduction)
        first = self._conjugate_gradients(lambda p: self._product(potential, x, p, definite=False), b, reduction)
        if first.curvature:
            return first, state.start, memory
        if isinstance(self.preconditioner, Assembled):
            # Making it anew takes as long as some four products with the definite part of every element.
            memory = self._upkeep.renew(potential, x, memory)
            solution = self._conjugate_gradients(self.preconditioner.product, b, reduction)
        else:
            solution = self._conjugate_gradients(lambda p: self._product(potential, x, p, definite=True), b, reduction)
        # Residuals of one step are compared in one norm, that of the preconditioner there is now.
        return solution, state.start * (solution.start / first.start if first.start > 0.0 else 1.0), memory

    def _conjugate_gradients(self, product: Map, b: Floats, reduction: float) -> Solution:
        return solve(self.backend, product, self.preconditioner.apply, b, reduction, self.linear_iterations)

    def _product(self, potential: IncrementalPotential, x: Floats, p: Floats, *, definite: bool) -> Floats:
        d = self.backend.zeros(len(x))
        self.backend.prolong(self.backend.vertices, p, d)
        return self.backend.nodal_product(self.backend.vertices, x, d, potential.inverse_h2, definite=definite)

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        assert isinstance(state, NewtonState)
        if state.iteration == 0:
            return None
        if not all(math.isfinite(float(size)) for size in state.corrections) or not math.isfinite(state.left):
            return Outcome.DIVERGED
        if self.budget.tolerance is not None:
            return self.budget.outcome(potential, state)
        if state.left <= self.reduction:
            return Outcome.CONVERGED
        return Outcome.NOT_CONVERGED if state.iteration >= self.budget.iterations else None

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """Remember the acceleration, from which the start of the next step follows."""
        state.memory = with_acceleration(potential, state.x, state.memory or {})
        return state


def nonlinearity(coefficients: Floats, t: float) -> float:
    """nu of a step of length t along a direction with these coefficients of phi; 0 where phi is quadratic."""
    slope = abs(float(coefficients[0]))
    if slope == 0.0:
        return 0.0
    k = np.arange(3, len(coefficients) + 1)
    return abs(float((k * coefficients[2:] * t ** (k - 1)).sum())) / slope
