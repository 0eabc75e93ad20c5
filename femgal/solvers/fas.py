# SPDX-License-Identifier: BSD-3-Clause
"""Full-approximation-scheme multigrid with layers that all connect to the finest mesh (Lu et al. 2025, Algorithm 4)."""

from __future__ import annotations

from dataclasses import dataclass

from femgal.solvers.smoother import Relaxation
from femgal.solvers.solver import SolverState
from femgal.timestep.potential import IncrementalPotential


@dataclass(eq=False)
class FAS(Relaxation):
    """One iteration is one pass over the layers from coarse to fine, with fresh gradients and blocks on each."""

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One coarse-to-fine pass, then the momentum of free parts."""
        corrections = [self.smooth_layer(potential, state.x, number) for number in reversed(range(len(self.layers)))]
        self.restore_momentum(potential, state.x)
        return SolverState(state.x, state.iteration + 1, tuple(corrections[::-1]))
