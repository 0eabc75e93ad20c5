# SPDX-License-Identifier: BSD-3-Clause
"""Single-level relaxation: vertex-block Jacobi (Lu et al. 2025, section 4) and scalar Jacobi, both matrix-free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from femgal.solvers.smoother import Relaxation
from femgal.solvers.solver import SolverState
from femgal.timestep.potential import IncrementalPotential


@dataclass(eq=False)
class Jacobi(Relaxation):
    """One iteration smooths the finest layer once with its 3x3 vertex blocks."""

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One sweep over the vertices, then the momentum of free parts."""
        correction = self.smooth_layer(potential, state.x, 0)
        self.restore_momentum(potential, state.x)
        return SolverState(state.x, state.iteration + 1, (correction,))


@dataclass(eq=False)
class ScalarJacobi(Jacobi):
    """The same with the diagonal of each block only."""

    scalar: ClassVar[bool] = True
