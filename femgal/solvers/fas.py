# SPDX-License-Identifier: BSD-3-Clause
"""Full-approximation-scheme multigrid with layers that all connect to the finest mesh (Lu et al. 2025, section 5)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from femgal.solvers.cycle import Cycle
from femgal.solvers.smoother import Relaxation
from femgal.solvers.solver import SolverState
from femgal.timestep.potential import IncrementalPotential


@dataclass(eq=False)
class FAS(Relaxation):
    """One iteration is one cycle, with gradients and blocks of the present positions at every smoothing.

    Parameters
    ----------
    cycle : Order of the layers; from coarse to fine (Algorithm 4) when left out.
    """

    cycle: Cycle = field(default_factory=Cycle)

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One cycle, then the momentum of free parts."""
        largest = np.zeros(len(self.layers))
        for number in self.cycle.schedule(len(self.layers)):
            # np.maximum hands on what is not a number; max does not.
            largest[number] = np.maximum(largest[number], self.smooth_layer(potential, state.x, number))
        self.restore_momentum(potential, state.x)
        return SolverState(state.x, state.iteration + 1, tuple(largest.tolist()))
