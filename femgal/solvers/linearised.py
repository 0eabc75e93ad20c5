# SPDX-License-Identifier: BSD-3-Clause
"""Relaxation of the assembled Newton system: what the "matrix-explicit" smoothers of Lu et al. 2025 have in common.

    A d = -grad phi(x_0),    A = d2 phi(x_0),    x = x_0 + d

A is assembled at the start of a step, stays as it is for a number of sweeps, and is then made anew where they have come
to. The paper (Fig. 2) does not say how old its matrices are; with one sweep per system each sweep sees the present one.
Elements whose Hessians are indefinite give their positive semi-definite part (Smith et al. 2019), so sweeps converge.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.hessian import HessianAssembly
from femgal.assembly.matrix import BlockMatrix
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend
from femgal.solvers.smoother import smooth
from femgal.solvers.solver import Budget, Outcome, SolverState
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.errors import InputError

Floats = NDArray[np.float64]

# Sweeps on one system. Fewer spend the time on assembly, which takes as long as ten sweeps or more.
SWEEPS = 20


@dataclass(eq=False)
class Linearised(ABC):
    """One iteration is one sweep on the present system; a subclass says what a sweep is.

    Parameters
    ----------
    backend : Of the bodies; the matrix has the precision of its element passes.
    budget : When to stop.
    free_parts : Layer of the parts that no constraint holds, corrected after each sweep; None when there is none.
    sweeps : Sweeps on one system, 1 or more. A step of no more sweeps than that is linear.

    Raises
    ------
    InputError
        Not a single sweep.
    """

    backend: Backend
    budget: Budget = field(default_factory=Budget)
    free_parts: Layer | None = None
    sweeps: int = SWEEPS
    matrix: BlockMatrix = field(init=False, repr=False)
    _x0: Floats = field(default_factory=lambda: np.empty((0, 3)), init=False, repr=False)
    _b: Floats = field(default_factory=lambda: np.empty((0, 3)), init=False, repr=False)

    # Nothing is searched along a correction: see `femgal.solvers.chebyshev`.
    search: None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.sweeps < 1:
            raise InputError("a system is for one sweep at least", where="sweeps", found=self.sweeps, allowed=">= 1")
        self._assembly = HessianAssembly(self.backend.disc, self.backend.precision, self.backend.threads)
        self.matrix = self._assembly.matrix()

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Nothing depends on the length of the step."""
        return state

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """Start from the prediction."""
        return SolverState(potential.xhat.copy())

    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One sweep, on a new system where the last one has served its time, then the momentum of free parts."""
        x, vertices = state.x, self.backend.vertices
        if state.iteration % self.sweeps == 0:
            self.linearise(potential, x)
        change = self.sweep(self.backend.restrict(vertices, self.backend.difference(x, self._x0)))
        self.backend.prolong(vertices, change, x)
        self.restore_momentum(potential, x)
        return SolverState(x, state.iteration + 1, (self.backend.largest(change),))

    def linearise(self, potential: IncrementalPotential, x: Floats) -> None:
        """Assemble the system at positions x [m], shape [n, 3]."""
        self._x0 = x.copy()
        self._assembly.assemble(x, potential.inverse_h2, out=self.matrix)
        g = self.backend.nodal_gradient(self.backend.vertices, x, potential.xhat, potential.inverse_h2)
        self._b = -g

    @abstractmethod
    def sweep(self, d: Floats) -> Floats:
        """What a sweep adds to d [m], shape [k, 3]; d may be overwritten."""

    def restore_momentum(self, potential: IncrementalPotential, x: Floats) -> None:
        """Put the centre of mass of every free part where its momentum takes it, in place."""
        if self.free_parts is not None:
            smooth(potential, self.free_parts, x, 1.0)

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        return self.budget.outcome(potential, state)

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """Nothing to remember."""
        return state
