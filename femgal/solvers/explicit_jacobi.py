# SPDX-License-Identifier: BSD-3-Clause
"""Vertex-block Jacobi on an assembled matrix (Lu et al. 2025, Fig. 2)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from femgal.solvers.linearised import Linearised
from femgal.solvers.smoother import LINE_SEARCHES, StepRule, step_lengths
from femgal.solvers.solver import SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.errors import InputError

Floats = NDArray[np.float64]


@dataclass(eq=False)
class ExplicitJacobi(Linearised):
    """One iteration moves all free vertices at once: d += w D^-1 (b - A d), D the blocks on the diagonal of A.

    Parameters
    ----------
    steps : "spectral" (`femgal.solvers.smoother.step_lengths`), or (coarse, finest) step lengths as other solvers take
        them, of which the second is meant here.

    Raises
    ------
    InputError
        A rule that searches along corrections, or not a single sweep per system.
    """

    steps: StepRule = "spectral"
    _w: float = field(default=0.0, init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.steps in LINE_SEARCHES:
            raise InputError(
                "a linear system is not searched along its corrections",
                where="steps",
                found=self.steps,
                allowed="'spectral' or step lengths",
            )

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Estimate the step length for steps of this length, unless the state remembers it."""
        memory = state.memory
        if "step_lengths" not in memory or memory["step_lengths_for"][0] != potential.h:
            w = step_lengths(self.steps, potential, (self.backend.vertices,))
            memory = memory | {"step_lengths": w, "step_lengths_for": np.array([potential.h])}
        return replace(state, memory=memory)

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """Start from the prediction."""
        self._w = float(memory["step_lengths"][0])
        return super().init(potential, memory)

    def linearise(self, potential: IncrementalPotential, x: Floats) -> None:
        """Assemble the system and take its diagonal."""
        super().linearise(potential, x)
        self._D = self.matrix.diagonal_blocks().astype(np.float64)

    def sweep(self, d: Floats) -> Floats:
        """What a sweep adds to d [m], shape [k, 3]."""
        return self.backend.solve(self.matrix.product(d) - self._b, self._D, self._w)
