# SPDX-License-Identifier: BSD-3-Clause
"""Minimiser of the incremental potential by Newton's method with a sparse direct solver: the solution of one step.

Energies, gradients and Hessians come from scikit-fem, so a converged step owes nothing to the passes that it checks.
Where the Hessian of the potential is not positive definite its diagonal is raised until it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.solvers.solver import Outcome, SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import mass_matrix

Floats = NDArray[np.float64]

# Armijo's share of the decrease that the slope promises.
_SUFFICIENT = 1e-4
# Below this share of |phi| a decrease drowns in the rounding of the energies, and Newton's step is taken as it is.
_ROUNDING = 1e-11
# First shift of an indefinite matrix, in units of its mean diagonal entry.
_SHIFT = 1e-3


@dataclass(eq=False)
class ReferenceNewton:
    """A solver like the others, for small problems: init / step / finished.

    Parameters
    ----------
    disc : The discretised bodies.
    tolerance : Stop when the last step moved no vertex by more than this share of the body's size.
    iterations : At most this many.
    """

    disc: Discretisation
    tolerance: float = 1e-12
    iterations: int = 60

    def __post_init__(self) -> None:
        self.elasticity = AssembledElasticity(self.disc.mesh, self.disc.mu, self.disc.lam)
        self._free = np.flatnonzero(np.repeat(self.disc.free, 3))
        self._size = float(np.ptp(self.disc.mesh.points, axis=0).max())

    def prepare(self, state: MotionState, h: float) -> MotionState:
        """Nothing depends on the length of the step."""
        return state

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """Start from the prediction."""
        return SolverState(potential.xhat.copy())

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One Newton step with backtracking; equal to the minimiser once quadratic convergence has set in."""
        x = state.x
        g = self._gradient(potential, x).ravel()[self._free]
        A = self._hessian(potential, x)[self._free][:, self._free]
        d = np.zeros(x.size)
        d[self._free] = -solve_definite(A, g)
        slope = float(g @ d[self._free])
        t = backtrack(lambda t: self._value(potential, x + t * d.reshape(-1, 3)), slope)
        return SolverState(x + t * d.reshape(-1, 3), state.iteration + 1, (t * float(np.abs(d).max()),))

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        if state.corrections and state.corrections[0] <= self.tolerance * self._size:
            return Outcome.CONVERGED
        return Outcome.ITERATIONS if state.iteration >= self.iterations else None

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """Nothing to remember."""
        return state

    def _value(self, potential: IncrementalPotential, x: Floats) -> float:
        moved = ((x - potential.xhat) ** 2).sum(axis=1)
        return 0.5 * potential.inverse_h2 * float(self.disc.mass @ moved) + self.elasticity.energy(x)

    def _gradient(self, potential: IncrementalPotential, x: Floats) -> Floats:
        return potential.inverse_h2 * self.disc.mass[:, None] * (x - potential.xhat) + self.elasticity.gradient(x)

    def _hessian(self, potential: IncrementalPotential, x: Floats) -> sp.csr_matrix:
        return (potential.inverse_h2 * mass_matrix(self.disc.mass) + self.elasticity.hessian(x)).tocsr()


def solve_definite(A: sp.csr_matrix, b: Floats) -> Floats:
    """Solve (A + s I) y = b with s = 0 where A is positive definite, else the first of a growing row that makes it so.

    Without pivoting the signs of U's diagonal are those of the eigenvalues (Sylvester's law of inertia).
    """
    factor, shift = _factorise(A), _SHIFT * float(np.abs(A.diagonal()).mean())
    while not ((factor.U.diagonal() > 0.0).all() and (factor.perm_r == factor.perm_c).all()):
        factor = _factorise(A + shift * sp.eye(A.shape[0]))
        shift *= 4.0
    return factor.solve(b)


def _factorise(A: sp.csr_matrix) -> spla.SuperLU:
    return spla.splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def backtrack(value: Callable[[float], float], slope: float) -> float:
    """Largest of 1, 1/2, 1/4, ... that decreases `value` by a fair share of what its slope (< 0) at 0 promises."""
    start = value(0.0)
    if abs(slope) <= _ROUNDING * abs(start):
        return 1.0
    t = 1.0
    while value(t) > start + _SUFFICIENT * t * slope and t > 1e-9:
        t *= 0.5
    return t
