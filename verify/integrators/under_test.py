# SPDX-License-Identifier: BSD-3-Clause
"""One step of any solver as a plain function, so that the same cases judge all of them.

    def step(mesh: TetMesh, material: Material, state: State, h: float) -> State:
        x, v = ...
        return dataclasses.replace(state, x=x, v=v)

`mesh` is at rest, `state` holds positions, velocities, the vertices that must stay where they are, and gravity. The
body is discretised by linear tetrahedra with lumped mass, a quarter of rho V of each element to each of its vertices;
its energy density is Psi = mu/2 (I_C - 3) - mu (J - 1) + lam/2 (J - 1)^2. No damping.

What a solver promises is what it is held to:

* every one: a body at rest stays at rest, constrained vertices do not move, linear momentum is kept, turning the whole
  start turns the whole motion, the frequency of a small vibration is that of the body to second order in h omega, a
  strongly strained body moves as it should to 5 % in 64 short steps, and a motion goes on from a saved state as if it
  had not stopped. A solver that leaves moving bodies where they are fails all of these. Implicit ones have to solve
  each step to about 1e-12 of the body's size for that. Steps of all these cases are below the stable step of explicit
  integration.
* ``step.order = 1`` or ``2``: the error at a fixed time falls with that power of h.
* ``step.method = "backward-euler"`` (order 1): x_{n+1} minimises |x - x_n - h v_n - h^2 g|^2_M / (2 h^2) + E(x),
  v_{n+1} = (x_{n+1} - x_n) / h. Then the discrete fall, the loss of angular momentum, the energy inequality, the decay
  of a vibration and single steps against Newton's method are judged too.
* ``step.method = "verlet"`` (order 2): velocity Verlet, velocities at the same times as the positions. Then the
  discrete fall, angular momentum, reversibility, the vibration and the order of the energy's error are judged too.
* ``step.method = "bdf2"`` (order 2): BDF2 with a first step of backward Euler; the discrete fall is judged too.
* ``step.method = "tr-bdf2"`` (order 2): TR-BDF2, gamma = 2 - sqrt(2), whose first step begins with one of backward
  Euler that is gamma h / 2 long; the discrete fall is judged too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.materials.stable_neo_hookean import parameters
from meshes.types import TetMesh
from verify.suite.case import Skip
from verify.suite.use import Use

Floats = NDArray[np.float64]
Method = Literal["backward-euler", "bdf2", "tr-bdf2", "verlet"]
METHODS: tuple[Method, ...] = get_args(Method)
ORDERS: Mapping[Method, int] = {"backward-euler": 1, "bdf2": 2, "tr-bdf2": 2, "verlet": 2}

# The name of a solver that a user has plugged in.
OWN_SOLVER = "own"


class SolverError(Exception):
    """A solver has returned what no state can be, or has not solved its step."""


@dataclass(frozen=True, eq=False)
class Material:
    """What each of m tetrahedra is made of.

    Parameters
    ----------
    E, nu, rho : Young's modulus [Pa], Poisson's ratio [-], density [kg/m^3], each of shape [m].
    mu, lam : Parameters [Pa] of the energy density above, shape [m]; lam = lam_Lame + mu_Lame.
    """

    E: Floats
    nu: Floats
    rho: Floats
    mu: Floats
    lam: Floats

    @classmethod
    def of(cls, mesh: TetMesh, E: ArrayLike, nu: ArrayLike, rho: ArrayLike) -> Material:
        """From scalars or one value per tetrahedron."""
        E, nu, rho = (np.broadcast_to(np.asarray(a, np.float64), len(mesh.cells)).copy() for a in (E, nu, rho))
        return cls(E, nu, rho, *parameters(E, nu))


@dataclass(frozen=True, eq=False)
class State:
    """A moving body of n vertices at one time.

    Parameters
    ----------
    x, v : Positions [m] and velocities [m/s], shape [n, 3].
    constrained : Indices of the vertices that must stay where they are; their velocity is zero.
    gravity : g [m/s^2], shape [3].
    memory : Arrays by name that the solver wants to find again in the next step; empty before the first one.
    """

    x: Floats
    v: Floats
    constrained: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    gravity: Floats = field(default_factory=lambda: np.zeros(3))
    memory: Mapping[str, NDArray] = field(default_factory=dict)


Step = Callable[[TetMesh, Material, State, float], State]


@dataclass(frozen=True, eq=False)
class SolverUnderTest:
    """A step with what it promises.

    Parameters
    ----------
    name : For messages.
    function : One step of h seconds.
    method : What it says it is; None for something else.
    order : Order in time; None when nothing is said.
    """

    name: str
    function: Step
    method: Method | None = None
    order: int | None = None

    def step(self, mesh: TetMesh, material: Material, state: State, h: float) -> State:
        """One step, on copies, with its result checked.

        Raises
        ------
        SolverError
            Not a state, arrays of other shapes, or values that are not finite.
        """
        given = replace(state, x=state.x.copy(), v=state.v.copy())
        after = self.function(mesh, material, given, h)
        if not (hasattr(after, "x") and hasattr(after, "v")):
            raise SolverError(f"{self.name} returned {type(after).__name__}, needed a State")
        x, v = (self._checked(name, getattr(after, name), state.x.shape) for name in ("x", "v"))
        return replace(state, x=x, v=v, memory=dict(getattr(after, "memory", {})))

    def _checked(self, name: str, values: ArrayLike, shape: tuple[int, ...]) -> Floats:
        array = np.array(values, np.float64)
        if array.shape != shape:
            raise SolverError(f"{self.name} returned {name} of shape {array.shape}, needed {shape}")
        lost = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if len(lost):
            raise SolverError(
                f"{self.name} returned {name} that is not finite, at vertex {lost[0]} and {len(lost)} in all"
            )
        return array

    def promises(self, *methods: Method) -> Method:
        """The method of the solver, for cases about these methods only.

        Raises
        ------
        Skip
            The solver does not say that it is one of them.
        """
        if self.method not in methods:
            raise Skip(
                f"only for solvers with method = {' or '.join(methods)}; this one says {self.method}: set step.method"
            )
        return self.method

    def promised_order(self) -> int:
        """Order in time.

        Raises
        ------
        Skip
            The solver says nothing about it.
        """
        if self.order is None:
            raise Skip("the solver says nothing about its order in time: set step.order")
        return self.order


def discretised(mesh: TetMesh, material: Material, constrained: ArrayLike) -> Discretisation:
    """The body as femgal's own solvers see it."""
    return discretise(mesh, material.E, material.nu, material.rho, constrained)


@cache
def solver_under_test(name: str, use: Use) -> SolverUnderTest:
    """A solver by name: one of femgal's, a reference, or the one that was plugged in.

    Raises
    ------
    Skip
        No solver was plugged in, or the device cannot be used.
    """
    from verify.integrators.of_femgal import PRODUCTION, production
    from verify.reference import stepping

    if name == OWN_SOLVER:
        return own_solver()
    if name in PRODUCTION:
        return production(name, use)
    return stepping.REFERENCES[name]()


_own: list[SolverUnderTest] = []


def own_solver() -> SolverUnderTest:
    """The solver that was plugged in.

    Raises
    ------
    Skip
        There is none.
    """
    if not _own:
        raise Skip("no solver of one's own was given")
    return _own[-1]


def use_own_solver(solver: SolverUnderTest) -> None:
    """Make a solver the one that "own" stands for."""
    solver_under_test.cache_clear()
    _own[:] = [solver]
