# SPDX-License-Identifier: BSD-3-Clause
"""Single steps of backward Euler and BDF2, each solved by the reference Newton.

Masses, material parameters and 1 / h^2 are computed here and by scikit-fem; with femgal's solvers these steps share the
mesh and the state that they start from.

Both minimise |x - xhat|^2_M / (2 h_e^2) + E(x):

    backward Euler   h_e = h, xhat = x_n + h v_n + h^2 g, v_{n+1} = (x_{n+1} - x_n) / h
    BDF2             h_e = 2h/3, xhat = (4 x_n - x_{n-1})/3 + h_e (4 v_n - v_{n-1})/3 + h_e^2 g,
                     v_{n+1} = (x_{n+1} - (4 x_n - x_{n-1})/3) / h_e; the first step is one of backward Euler

(Hairer & Wanner 1996, section V.1, applied to x' = v, M v' = M g - grad E.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from meshes.types import TetMesh
from verify.integrators.under_test import Material, SolverError, SolverUnderTest, State
from verify.reference.elasticity import lumped_mass, material_parameters
from verify.reference.newton import StepMinimiser

Floats = NDArray[np.float64]


def step_minimiser(mesh: TetMesh, material: Material, constrained: NDArray[np.int64]) -> StepMinimiser:
    """Newton's method for the steps of a body."""
    free = np.ones(len(mesh.points), bool)
    free[constrained] = False
    return StepMinimiser(mesh, *material_parameters(material.E, material.nu), lumped_mass(mesh, material.rho), free)


def newton_backward_euler() -> SolverUnderTest:
    """Backward Euler, solved by the reference Newton."""
    return SolverUnderTest("newton", _Steps(_backward_euler), "backward-euler", 1)


def newton_bdf2() -> SolverUnderTest:
    """BDF2, solved by the reference Newton."""
    return SolverUnderTest("newton-bdf2", _Steps(_bdf2), "bdf2", 2)


@dataclass(eq=False)
class _Steps:
    """A rule of stepping, with the minimiser of the body that it was last asked about."""

    rule: Callable[[StepMinimiser, State, float], State]
    _built: tuple[tuple[object, ...], StepMinimiser] | None = field(default=None, init=False)

    def __call__(self, mesh: TetMesh, material: Material, state: State, h: float) -> State:
        key = (mesh, material, state.constrained.tobytes())
        if self._built is None or self._built[0] != key:
            self._built = (key, step_minimiser(mesh, material, state.constrained))
        try:
            return self.rule(self._built[1], state, h)
        except ArithmeticError as failed:
            raise SolverError(str(failed)) from failed


def _backward_euler(minimise: StepMinimiser, state: State, h: float) -> State:
    xhat = _held(state, state.x + h * state.v + h * h * state.gravity)
    x = minimise(xhat, h)
    return replace(state, x=x, v=(x - state.x) / h)


def _bdf2(minimise: StepMinimiser, state: State, h: float) -> State:
    memory = {"x": state.x, "v": state.v}
    if not state.memory:
        return replace(_backward_euler(minimise, state, h), memory=memory)
    h_e = 2.0 * h / 3.0
    x_bar = (4.0 * state.x - state.memory["x"]) / 3.0
    v_bar = (4.0 * state.v - state.memory["v"]) / 3.0
    x = minimise(_held(state, x_bar + h_e * v_bar + h_e * h_e * state.gravity), h_e)
    v = (x - x_bar) / h_e
    v[state.constrained] = 0.0
    return replace(state, x=x, v=v, memory=memory)


def _held(state: State, xhat: Floats) -> Floats:
    xhat[state.constrained] = state.x[state.constrained]
    return xhat
