# SPDX-License-Identifier: BSD-3-Clause
"""Chebyshev semi-iteration over whole iterations of another solver (Wang 2015).

With x_hat_{k+1} the iterate that the solver makes of x_k, and rho the spectral radius of its error propagation,

    x_{k+1} = x_{k-1} + omega_{k+1} (x_hat_{k+1} - x_{k-1}),
    omega_1 = 1,  omega_2 = 2 / (2 - rho^2),  omega_{k+1} = 4 / (4 - rho^2 omega_k).

After k iterations the error is reduced by the factor 1 / T_k(1 / rho) with the Chebyshev polynomial T_k, asymptotically
by rho / (1 + sqrt(1 - rho^2)) at each, where the plain iteration has rho. That holds for real eigenvalues in
[-rho, rho], as of sweeps and symmetric V and W cycles. Where it departs from the published method:

1. With rho = "auto", and where a line search promises that the potential never grows, the extrapolation ends at the
   first minimum of the potential on the way, for one energy pass; the weights are only bounds, those of rho = 1 with
   "auto". That makes rho needless. Fixed weights spread the error evenly over all modes, so that until it is small
   they are worse than none: one of 1 / T_k(1 / rho) is left in motions that the plain iteration has right at once.
   For equal work shorter steps are about as good (reports/published/motion-cycles.txt): extrapolation is for steps
   that have to be long, or solved to a tolerance.
2. Momentum of free parts is put right after the extrapolation: the first iterate of a line search does not have it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.solvers.line_search import LineSearch, first_minimum
from femgal.solvers.solver import Outcome, Solver, SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# Signs of t, t^2, ..., t^6 when the direction is turned round.
_TURNED = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])


class Iteration(Solver, Protocol):
    """A solver whose iterates can be extrapolated."""

    @property
    def search(self) -> LineSearch | None:
        """The search that lets the potential never grow; None where step lengths are given beforehand."""

    def restore_momentum(self, potential: IncrementalPotential, x: Floats) -> None:
        """Put the centre of mass of every free part where its momentum takes it, in place."""


@dataclass(eq=False)
class AcceleratedState(SolverState):
    """An iterate with what the next extrapolation needs.

    Parameters
    ----------
    previous : The iterate before x [m], shape [n, 3]; None before the first iteration.
    omega : Weight of the last extrapolation.
    """

    previous: Floats | None = None
    omega: float = 1.0


@dataclass(eq=False)
class Chebyshev:
    """A solver whose iterates are extrapolated.

    Parameters
    ----------
    solver : Makes the iterates; its budget counts iterations and sets the tolerance.
    rho : Spectral radius of one iteration, 0 < rho < 1, or "auto" for the minimum along each extrapolation.
    """

    solver: Iteration
    rho: float | Literal["auto"] = "auto"

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Whatever the solver prepares."""
        return self.solver.prepare(state, potential)

    @property
    def searches(self) -> bool:
        """Whether the extrapolation ends at a minimum."""
        return self.rho == "auto" or self.solver.search is not None

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> AcceleratedState:
        """The solver's first iterate."""
        return AcceleratedState(self.solver.init(potential, memory).x)

    def step(self, potential: IncrementalPotential, state: SolverState) -> AcceleratedState:
        """One iteration of the solver and its extrapolation."""
        assert isinstance(state, AcceleratedState)
        rho = 1.0 if self.rho == "auto" else self.rho
        kept, omega = potential.backend.copy(state.x), next_weight(rho, state.iteration, state.omega)
        after = self.solver.step(potential, SolverState(state.x, state.iteration))
        if state.previous is not None:
            self._extrapolate(potential, after.x, state.previous, omega - 1.0)
            self.solver.restore_momentum(potential, after.x)
        return AcceleratedState(after.x, after.iteration, after.corrections, previous=kept, omega=omega)

    def _extrapolate(self, potential: IncrementalPotential, x: Floats, previous: Floats, t: float) -> None:
        """x += t (x - previous) in place, or up to the minimum on the way; `previous` is used up."""
        backend = potential.backend
        backend.add_scaled(previous, -1.0, x)
        if self.searches:
            coefficients = _TURNED * potential.along(backend.vertices, x, previous)
            # In this order min hands on a minimum that is not a number.
            t = min(first_minimum(coefficients), t)
        backend.add_scaled(x, -t, previous)

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The solver's reason to stop, or None to go on."""
        return self.solver.finished(potential, state)

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """What the solver wants to remember."""
        return self.solver.conclude(potential, state)


def next_weight(rho: float, iteration: int, omega: float) -> float:
    """omega_{k+1} from omega_k after k = `iteration` iterations."""
    if iteration == 0:
        return 1.0
    return 2.0 / (2.0 - rho**2) if iteration == 1 else 4.0 / (4.0 - rho**2 * omega)


def largest_stable_radius(iterations: int) -> float:
    """The rho up to which so many iterations with fixed weights keep a stiff motion bounded.

    A step that maps the prediction to x = T xhat gives x_{n+1} = T (2 x_n - x_{n-1}), bounded for -1/3 <= T <= 1. On
    stiff modes, whose minimum is near zero, T is the factor of the error, anywhere between +- 1 / T_k(1 / rho) after k
    iterations: T_k(1 / rho) >= 3 is needed.
    """
    return 1.0 / math.cosh(math.acosh(3.0) / iterations)
