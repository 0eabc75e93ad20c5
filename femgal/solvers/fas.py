# SPDX-License-Identifier: BSD-3-Clause
"""Full-approximation-scheme multigrid with layers that all connect to the finest mesh (Lu et al. 2025, section 5)."""

from __future__ import annotations

from dataclasses import dataclass, field

from femgal.kernels.deferred import Number, largest_of
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
        found: list[list[Number]] = [[] for _ in self.layers]
        for number in self.cycle.schedule(len(self.layers)):
            found[number].append(self.smooth_layer(potential, state.x, number))
        self.restore_momentum(potential, state.x)
        return SolverState(state.x, state.iteration + 1, tuple(largest_of(sizes) for sizes in found))
