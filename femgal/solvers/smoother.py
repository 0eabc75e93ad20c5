# SPDX-License-Identifier: BSD-3-Clause
"""Matrix-free block-Jacobi smoothing of one layer, its step length, and what FAS and Jacobi have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.solver import Budget, Outcome, SolverState
from femgal.solvers.spectrum import largest_block_jacobi_eigenvalue
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# "spectral", or the steps (coarse layers, finest layer) themselves.
StepRule = Literal["spectral"] | tuple[float, float]

# The constants that Lu et al. 2025 use. A fixed w applies only the share w of the elastic force as h -> 0, so the
# motion does not converge; they are here to reproduce the paper.
LU2025_STEPS = (0.25, 0.5)


def smooth(potential: IncrementalPotential, layer: Layer, x: Floats, w: float, *, scalar: bool = False) -> float:
    """x += P dx with dx_i = -w H_i^-1 g_i (Lu et al. 2025, Eq. 6), in place; returns max |dx| [m].

    With `scalar` only the diagonal of each block is used.
    """
    backend = potential.backend
    g, H = backend.gradient_and_blocks(layer, x, potential.xhat, potential.inverse_h2)
    dx = backend.solve(g, H, w, scalar=scalar)
    backend.prolong(layer, dx, x)
    return max(float(dx.max()), -float(dx.min()))


def step_lengths(
    rule: StepRule, potential: IncrementalPotential, layers: tuple[Layer, ...], *, scalar: bool = False
) -> Floats:
    """Step length w of each layer, finest first.

    Spectral: w_l = 2 / (1 + lambda_max(D_l^-1 A_l)) at the rest state. lambda_max -> 1 and so w -> 1 as h -> 0, which
    makes one pass per step consistent with the equation of motion.
    """
    if rule != "spectral":
        coarse, fine = rule
        return np.array([fine] + [coarse] * (len(layers) - 1))
    X = potential.backend.disc.mesh.points
    lambdas = [largest_block_jacobi_eigenvalue(potential, layer, X, scalar=scalar) for layer in layers]
    return 2.0 / (1.0 + np.array(lambdas))


@dataclass(eq=False)
class Relaxation(ABC):
    """Solvers that smooth layers with fixed step lengths; a subclass says which layers, in which order.

    Parameters
    ----------
    backend : Element passes.
    layers : Layers, finest first.
    steps : "spectral", or (coarse, finest) step lengths.
    budget : When to stop.
    """

    backend: CpuBackend
    layers: tuple[Layer, ...]
    steps: StepRule = "spectral"
    budget: Budget = field(default_factory=Budget)
    _w: Floats = field(default_factory=lambda: np.empty(0), init=False, repr=False)

    scalar: ClassVar[bool] = False

    def prepare(self, state: MotionState, h: float) -> MotionState:
        """Estimate the step lengths for steps of h seconds, unless the state remembers them."""
        memory = state.memory
        if "step_lengths" not in memory or memory["step_lengths_for"][0] != h:
            potential = IncrementalPotential(self.backend, state.x, h)
            w = step_lengths(self.steps, potential, self.layers, scalar=self.scalar)
            memory = memory | {"step_lengths": w, "step_lengths_for": np.array([h])}
        return replace(state, memory=memory)

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """Start from the prediction."""
        self._w = memory["step_lengths"]
        return SolverState(potential.xhat.copy())

    @abstractmethod
    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One iteration."""

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        return self.budget.outcome(potential, state)
