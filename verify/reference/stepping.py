# SPDX-License-Identifier: BSD-3-Clause
"""Single steps of backward Euler and BDF2, each solved by the reference Newton, in NumPy alone.

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

from femgal.discretisation import Discretisation
from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.solver import Outcome, minimise
from femgal.timestep.potential import IncrementalPotential
from meshes.types import TetMesh
from verify.integrators.under_test import Material, SolverError, SolverUnderTest, State, discretised
from verify.reference.newton import ReferenceNewton

Floats = NDArray[np.float64]


@dataclass(eq=False)
class NewtonMinimiser:
    """Minimises the potential of a step of one body; Newton's method sees inertia and scikit-fem's energy only."""

    disc: Discretisation

    def __post_init__(self) -> None:
        self._newton = ReferenceNewton(self.disc)
        self._backend = PlainBackend(self.disc, 1)

    def __call__(self, xhat: Floats, h: float) -> Floats:
        """argmin |x - xhat|^2_M / (2 h^2) + E(x) over the free vertices [m], shape [n, 3].

        Raises
        ------
        SolverError
            Newton's method has not converged.
        """
        result = minimise(self._newton, IncrementalPotential(self._backend, xhat, h), {})
        if result.outcome is not Outcome.CONVERGED:
            raise SolverError(f"Newton's method has not converged in {result.iteration} iterations")
        return result.x


def newton_backward_euler() -> SolverUnderTest:
    """Backward Euler, solved by the reference Newton."""
    return SolverUnderTest("newton", _Steps(_backward_euler), "backward-euler", 1)


def newton_bdf2() -> SolverUnderTest:
    """BDF2, solved by the reference Newton."""
    return SolverUnderTest("newton-bdf2", _Steps(_bdf2), "bdf2", 2)


@dataclass(eq=False)
class _Steps:
    """A rule of stepping, with the minimiser of the body that it was last asked about."""

    rule: Callable[[NewtonMinimiser, State, float], State]
    _built: tuple[tuple[object, ...], NewtonMinimiser] | None = field(default=None, init=False)

    def __call__(self, mesh: TetMesh, material: Material, state: State, h: float) -> State:
        key = (mesh, material, state.constrained.tobytes())
        if self._built is None or self._built[0] != key:
            self._built = (key, NewtonMinimiser(discretised(mesh, material, state.constrained)))
        return self.rule(self._built[1], state, h)


def _backward_euler(minimise: NewtonMinimiser, state: State, h: float) -> State:
    xhat = _held(state, state.x + h * state.v + h * h * state.gravity)
    x = minimise(xhat, h)
    return replace(state, x=x, v=(x - state.x) / h)


def _bdf2(minimise: NewtonMinimiser, state: State, h: float) -> State:
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
