# SPDX-License-Identifier: BSD-3-Clause
"""Minimiser of the incremental potential by Newton's method with a sparse direct solver: the solution of one step.

Energies, gradients, Hessians and, in the verification suite, masses come from scikit-fem, and 1 / h^2 is formed here:
of femgal a converged step takes the mesh, and nothing else that the caller does not hand over. Where the Hessian of the
potential is not positive definite its diagonal is raised until it is.
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
from meshes.types import TetMesh
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
class StepMinimiser:
    """Minimises |x - xhat|^2_M / (2 h^2) + E(x) over the free vertices; n vertices, m tetrahedra.

    Parameters
    ----------
    mesh : Rest configuration.
    mu, lam : Material parameters [Pa], shape [m].
    mass : Lumped masses [kg], shape [n].
    free : Vertices that may move, shape [n], bool.
    tolerance : Converged when a whole Newton step moves no vertex by more than this share of the body's size.
    iterations : At most this many.
    """

    mesh: TetMesh
    mu: Floats
    lam: Floats
    mass: Floats
    free: NDArray[np.bool_]
    tolerance: float = 1e-12
    iterations: int = 60

    def __post_init__(self) -> None:
        self.elasticity = AssembledElasticity(self.mesh, self.mu, self.lam)
        self._at = np.flatnonzero(np.repeat(self.free, 3))
        self._size = float(np.ptp(self.mesh.points, axis=0).max())

    def __call__(self, xhat: Floats, h: float) -> Floats:
        """The minimiser [m], shape [n, 3], from the prediction xhat, for a step of h seconds.

        Raises
        ------
        ArithmeticError
            Newton's method has not converged.
        """
        x = xhat.copy()
        for _ in range(self.iterations):
            x, whole = self.step(x, xhat, 1.0 / (h * h))
            if self.ends(whole):
                return x
        raise ArithmeticError(
            f"Newton's method has not converged in {self.iterations} steps, the last of {whole:.2g} m"
        )

    def ends(self, whole: float) -> bool:
        """Whether a whole step of this length [m] is short enough."""
        return whole <= self.tolerance * self._size

    def step(self, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, float]:
        """One Newton step with backtracking, and the largest |component| [m] of the whole step."""
        inertia, at = inverse_h2 * self.mass, self._at

        def value(t: float) -> float:
            y = x + t * d
            return 0.5 * float(inertia @ ((y - xhat) ** 2).sum(axis=1)) + self.elasticity.energy(y)

        g = (inertia[:, None] * (x - xhat) + self.elasticity.gradient(x)).ravel()[at]
        A = (mass_matrix(inertia) + self.elasticity.hessian(x)).tocsr()[at][:, at]
        d = np.zeros_like(x)
        d.ravel()[at] = -solve_definite(A, g)
        whole = float(np.abs(d).max())
        t = 1.0 if self.ends(whole) else backtrack(value, float(g @ d.ravel()[at]), self.elasticity.rounding)
        return x + t * d, whole


@dataclass(eq=False)
class ReferenceNewton:
    """A solver like production's, for tests of what surrounds solvers: init / step / finished.

    Parameters
    ----------
    disc : The discretised bodies, whose masses and material parameters it takes as they are.
    tolerance, iterations : As of `StepMinimiser`.
    """

    disc: Discretisation
    tolerance: float = 1e-12
    iterations: int = 60

    def __post_init__(self) -> None:
        disc = self.disc
        self._newton = StepMinimiser(
            disc.mesh, disc.mu, disc.lam, disc.mass, disc.free, self.tolerance, self.iterations
        )
        self.elasticity = self._newton.elasticity

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Nothing depends on the length of the step."""
        return state

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """Start from the prediction."""
        return SolverState(potential.xhat.copy())

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One Newton step with backtracking; equal to the minimiser once quadratic convergence has set in."""
        weight = potential.inertia / (potential.h * potential.h)
        x, whole = self._newton.step(state.x, potential.xhat, weight)
        return SolverState(x, state.iteration + 1, (whole,))

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        if state.corrections and self._newton.ends(float(state.corrections[0])):
            return Outcome.CONVERGED
        return Outcome.ITERATIONS if state.iteration >= self.iterations else None

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """Nothing to remember."""
        return state


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


def backtrack(value: Callable[[float], float], slope: float, rounding: float = 0.0) -> float:
    """Largest of 1, 1/2, 1/4, ... that decreases `value` by a fair share of what its slope (< 0) at 0 promises.

    Parameters
    ----------
    rounding : What `value` may be wrong by, beside its own rounding; 1 where the slope promises no more.
    """
    start = value(0.0)
    if abs(slope) <= _ROUNDING * abs(start) + rounding:
        return 1.0
    t = 1.0
    while value(t) > start + _SUFFICIENT * t * slope and t > 1e-9:
        t *= 0.5
    return t
