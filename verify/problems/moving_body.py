# SPDX-License-Identifier: BSD-3-Clause
"""Bodies in motion, for cases about solvers: where they start, and what mechanics says about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from meshes.types import TetMesh
from verify.integrators.under_test import Material, SolverError, SolverUnderTest, State
from verify.problems import bodies
from verify.reference.elasticity import AssembledElasticity, lumped_mass

Floats = NDArray[np.float64]

GRAVITY = np.array([1.5, -2.5, -9.81])


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A body at the start of its motion; mechanics of it by scikit-fem.

    Parameters
    ----------
    mesh, material : The body.
    start : Its first state.
    """

    mesh: TetMesh
    material: Material
    start: State

    @cached_property
    def mass(self) -> Floats:
        """Lumped masses [kg], shape [n]."""
        return lumped_mass(self.mesh, self.material.rho)

    @cached_property
    def elasticity(self) -> AssembledElasticity:
        """Elastic energy and its derivatives."""
        return AssembledElasticity(self.mesh, self.material.mu, self.material.lam)

    @cached_property
    def size(self) -> float:
        """Longest side of the bounding box [m]."""
        return float(np.ptp(self.mesh.points, axis=0).max())

    def momentum(self, state: State) -> Floats:
        """sum m v [kg m/s], shape [3]."""
        return self.mass @ state.v

    def centre(self, state: State) -> Floats:
        """Centre of mass [m], shape [3]."""
        return self.mass @ state.x / self.mass.sum()

    def angular_momentum(self, state: State) -> Floats:
        """sum m x cross v about the origin [kg m^2/s], shape [3]."""
        return self.mass @ np.cross(state.x, state.v)

    def kinetic(self, v: Floats) -> float:
        """1/2 sum m v^2 [J], of velocities or differences of them."""
        return 0.5 * float(self.mass @ (v**2).sum(axis=1))

    def energy(self, state: State) -> float:
        """Kinetic and elastic energy [J]."""
        return self.kinetic(state.v) + self.elasticity.energy(state.x)

    def states(self, solver: SolverUnderTest, h: float, steps: int) -> Sequence[State]:
        """The start and the states after each step; several cases look at one motion.

        Raises
        ------
        SolverError
            The solver leaves a body that moves where it is, or its velocities as they are.
        """
        return _states(solver, self, h, steps)

    def end(self, solver: SolverUnderTest, h: float, steps: int) -> State:
        """The state after so many steps."""
        state = self.start
        for _ in range(steps):
            state = solver.step(self.mesh, self.material, state, h)
        return state


@cache
def _states(solver: SolverUnderTest, body: MovingBody, h: float, steps: int) -> tuple[State, ...]:
    states = [body.start]
    for _ in range(steps):
        states.append(solver.step(body.mesh, body.material, states[-1], h))
    _check_motion(solver, body, h, states)
    return tuple(states)


def _check_motion(solver: SolverUnderTest, body: MovingBody, h: float, states: Sequence[State]) -> None:
    """Laws of conservation hold for a solver that does nothing; hold them against none that does not move."""
    start, moving = states[0], body.kinetic(states[0].v)
    if moving == 0.0:
        return
    if body.kinetic(states[1].x - start.x) < 0.01 * h * h * moving:
        raise SolverError(f"{solver.name} left a moving body where it was: it moved by less than a tenth of h v")
    if body.kinetic(states[-1].v - start.v) < 1e-6 * moving:
        raise SolverError(f"{solver.name} left the velocities as they were, although forces act on the body")


def uneven(mesh: TetMesh) -> Material:
    """Another material in every tetrahedron: E and rho over a factor of ten and of four, nu from 0 to 0.45."""
    m, random = len(mesh.cells), bodies.rng(51)
    E, nu = 10.0 ** random.uniform(4.5, 5.5, m), random.uniform(0.0, 0.45, m)
    return Material.of(mesh, E, nu, random.uniform(500.0, 2000.0, m))


@cache
def falling() -> MovingBody:
    """At rest in its own frame, thrown, under gravity."""
    mesh = bodies.mesh("box")
    v = np.broadcast_to([0.7, -0.4, 1.1], mesh.points.shape).copy()
    return MovingBody(mesh, uneven(mesh), State(mesh.points.copy(), v, gravity=GRAVITY))


@cache
def resting(held: bool) -> MovingBody:
    """At rest without gravity, free or held at one end."""
    mesh = bodies.mesh("box")
    constrained = bodies.left_end(mesh) if held else np.empty(0, np.int64)
    return MovingBody(mesh, uneven(mesh), State(mesh.points.copy(), np.zeros_like(mesh.points), constrained))


@cache
def tumbling() -> MovingBody:
    """Twisted by half a radian, spinning, flying and trembling; no force from outside."""
    mesh = bodies.mesh("box")
    x = twisted(mesh.points, 0.5)
    noise = 0.3 * bodies.rng(52).standard_normal(x.shape)
    spin = np.cross([3.0, -5.0, 8.0], x - x.mean(axis=0))
    return MovingBody(mesh, uneven(mesh), State(x, np.array([0.7, -0.4, 1.1]) + spin + noise))


@cache
def held_and_loaded() -> MovingBody:
    """Held at one end, twisted, trembling, under gravity."""
    mesh = bodies.mesh("box")
    constrained = bodies.left_end(mesh)
    v = 0.3 * bodies.rng(53).standard_normal(mesh.points.shape)
    v[constrained] = 0.0
    return MovingBody(mesh, uneven(mesh), State(twisted(mesh.points, 0.5), v, constrained, GRAVITY))


def twisted(X: Floats, angle: float) -> Floats:
    """Cross-sections turned about the x axis through the mean point, by up to `angle` [rad] at the far end."""
    centre = X.mean(axis=0)
    phi = angle * (X[:, 0] - X[:, 0].min()) / np.ptp(X[:, 0])
    _, y, z = (X - centre).T
    turned = np.stack([np.zeros_like(y), np.cos(phi) * y - np.sin(phi) * z, np.sin(phi) * y + np.cos(phi) * z], axis=1)
    return np.where([True, False, False], X, centre + turned)


def turned(body: MovingBody, Q: Floats, d: Floats) -> MovingBody:
    """The same body, started from positions Q x + d and velocities Q v."""
    start = replace(body.start, x=body.start.x @ Q.T + d, v=body.start.v @ Q.T, gravity=Q @ body.start.gravity)
    return MovingBody(body.mesh, body.material, start)


def rotation() -> Floats:
    """A rotation about no axis in particular, shape [3, 3]."""
    Q, _ = np.linalg.qr(bodies.rng(54).standard_normal((3, 3)))
    return Q * np.linalg.det(Q)
