# SPDX-License-Identifier: BSD-3-Clause
"""Single steps of backward Euler, BDF2 and TR-BDF2, each solved by the reference Newton.

Masses, material parameters and 1 / h^2 are computed here and by scikit-fem; with femgal's solvers these steps share the
mesh and the state that they start from.

All minimise |x - xhat|^2_M / (2 h_e^2) + E(x):

    backward Euler   h_e = h, xhat = x_n + h v_n + h^2 g, v_{n+1} = (x_{n+1} - x_n) / h
    BDF2             h_e = 2h/3, xhat = (4 x_n - x_{n-1})/3 + h_e (4 v_n - v_{n-1})/3 + h_e^2 g,
                     v_{n+1} = (x_{n+1} - (4 x_n - x_{n-1})/3) / h_e; the first step is one of backward Euler
    TR-BDF2          two stages with h_e = d h, d = 1 - 1/sqrt(2): the rows (d, d) and (w, w, d), w = sqrt(2)/4, of its
                     Runge-Kutta tableau; of the first step the first d h seconds are one of backward Euler

(Hairer & Wanner 1996, section V.1, and Hosea & Shampine 1996, table 1, applied to x' = v, M v' = M g - grad E.) BDF2
with steps of varying lengths is written by the derivative of the parabola through the last two states and the new one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from meshes.types import TetMesh
from verify.integrators.under_test import Material, SolverError, SolverUnderTest, State
from verify.reference.elasticity import lumped_mass, material_parameters
from verify.reference.newton import StepMinimiser

Floats = NDArray[np.float64]

# Coefficients of TR-BDF2.
_D, _W = 1.0 - np.sqrt(0.5), 0.25 * np.sqrt(2.0)


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


def newton_tr_bdf2() -> SolverUnderTest:
    """TR-BDF2, solved by the reference Newton."""
    return SolverUnderTest("newton-tr-bdf2", _Steps(_tr_bdf2), "tr-bdf2", 2)


REFERENCES: Mapping[str, Callable[[], SolverUnderTest]] = {
    "newton": newton_backward_euler,
    "newton-bdf2": newton_bdf2,
    "newton-tr-bdf2": newton_tr_bdf2,
}


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
    memory = {"x": state.x, "v": state.v, "h": np.array([h])}
    if not state.memory:
        return replace(_backward_euler(minimise, state, h), memory=memory)
    before, last, new = _derivative_of_parabola(-float(state.memory["h"][0]), h)
    h_e = 1.0 / new
    x_bar = -h_e * (last * state.x + before * state.memory["x"])
    v_bar = -h_e * (last * state.v + before * state.memory["v"])
    x = minimise(_held(state, x_bar + h_e * v_bar + h_e * h_e * state.gravity), h_e)
    v = (x - x_bar) / h_e
    v[state.constrained] = 0.0
    return replace(state, x=x, v=v, memory=memory)


def _derivative_of_parabola(before: float, after: float) -> Floats:
    """Weights of the values at the times `before`, 0 and `after` in the derivative at `after`, shape [3]."""
    # Exact for 1, t and t^2.
    times = np.array([before, 0.0, after]) / after
    weights = np.linalg.solve(np.vander(times, increasing=True).T, np.array([0.0, 1.0, 2.0]))
    return np.asarray(weights / after, np.float64)


def _tr_bdf2(minimise: StepMinimiser, state: State, h: float) -> State:
    if not state.memory:
        short = _backward_euler(minimise, state, _D * h)
        state = replace(short, memory={"a": (short.v - state.v) / (_D * h)})
        h -= _D * h
    v, a = [state.v], [state.memory["a"]]
    for row in ((_D,), (_W, _W)):
        x_bar = state.x + h * sum(c * one for c, one in zip(row, v, strict=True))
        v_bar = state.v + h * sum(c * one for c, one in zip(row, a, strict=True))
        h_e = _D * h
        x = minimise(_held(state, x_bar + h_e * v_bar + h_e * h_e * state.gravity), h_e)
        v.append((x - x_bar) / h_e)
        a.append((v[-1] - v_bar) / h_e)
    return replace(state, x=x, v=v[-1], memory={"a": a[-1]})


def _held(state: State, xhat: Floats) -> Floats:
    xhat[state.constrained] = state.x[state.constrained]
    return xhat
