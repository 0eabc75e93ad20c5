# SPDX-License-Identifier: BSD-3-Clause
"""Inexact Newton: where it ends, what it promises on the way, and indefinite Hessians."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.solvers.newton import Newton, NewtonState
from femgal.solvers.preconditioner import Preconditioner
from femgal.solvers.solver import Budget, minimise
from femgal.timestep.potential import IncrementalPotential
from verify.cases.cycles import H, minimiser, thrown
from verify.cases.preconditioners import PRECONDITIONERS, preconditioner_of
from verify.problems.bodies import body, mean_edge, rng
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import mass_matrix
from verify.suite.case import Kind, Measurement, case
from verify.suite.measure import at_most, vanishes
from verify.suite.use import Use

Floats = NDArray[np.float64]

# What the linear systems are solved to in the row about the promise.
_REDUCTION = 0.05


@case(
    "newton/minimiser",
    title="Newton's method ends at the minimiser of the reference, with every preconditioner",
    quantity="largest distance of a vertex over the mean edge",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="argmin |x - xhat|^2_M / (2 h^2) + E(x)",
    source="verify/reference/newton.py: Hessian and masses by scikit-fem, a direct solver",
    tolerance=1e-9,
    reason="solved to eps18 = 1e-13 m, which bounds the distance in the norm of the masses",
    over={"preconditioner": PRECONDITIONERS},
    requires="scikit-fem",
)
def newton_minimiser(use: Use, *, preconditioner: str) -> Measurement:
    """From a body that is thrown so that it bends."""
    disc = body("beam", "uniform")
    phi = _thrown(disc, use)
    solver = Newton(phi.backend, preconditioner_of(phi.backend, preconditioner), Budget(40, 1e-13))
    state = minimise(solver, phi, {})
    return vanishes(state.x - minimiser(disc), mean_edge(disc.mesh), f"{state.iteration} iterations")


@case(
    "newton/promise",
    title="Newton's method leaves no more of the residual than was asked for",
    quantity="residual left over the share asked for, as excess",
    unit="1",
    kind=Kind.IDENTITY,
    formula="sqrt(g . M^-1 g) at the end <= 0.05 of that at the start, M the preconditioner at each",
    source="the promise of solver.reduction",
    tolerance=0.2,
    reason="Newton's own estimate of what is left, by the polynomial of phi along the step, and M of two states",
    over={"preconditioner": PRECONDITIONERS},
    quick={"preconditioner": ("blocks", "layers", "mas")},
)
def promise(use: Use, *, preconditioner: str) -> Measurement:
    """The residual at the end is measured, not the solver's estimate."""
    phi = _thrown(body("beam", "uniform"), use)
    made = preconditioner_of(phi.backend, preconditioner)
    solver = Newton(phi.backend, made, reduction=_REDUCTION)
    first = _residual(phi, made, solver.init(phi, {}).x)
    state = minimise(solver, phi, {})
    return at_most(_residual(phi, made, state.x) / first, _REDUCTION, f"{state.iteration} iterations")


@case(
    "newton/falls",
    title="The potential falls in every iteration, where full Newton steps raise it and Hessians are indefinite",
    quantity="largest rise of phi in an iteration over the fall in all of them",
    unit="J",
    kind=Kind.IDENTITY,
    formula="phi(x_{k+1}) <= phi(x_k)",
    source="the direction is one of descent, and the step ends at the first minimum along it; phi by scikit-fem",
    tolerance=1e-12,
    reason="rounding of energies summed over a thousand elements",
    over={"start": ("crushed", "everted")},
    requires="scikit-fem",
)
def falls(use: Use, *, start: str) -> Measurement:
    """The row is void, and red, where the Hessian at the start is definite."""
    phi, x_n = _hard(use, start)
    states = _path(phi)
    elasticity = AssembledElasticity(phi.backend.disc.mesh, phi.backend.disc.mu, phi.backend.disc.lam)
    least = _least_eigenvalue(phi, elasticity, x_n)
    if not least < 0.0:
        raise AssertionError("the Hessian at the start is definite: this state proves nothing")
    mass = phi.inverse_h2 * phi.backend.disc.mass
    with np.errstate(over="ignore", invalid="ignore"):
        value = [0.5 * float(mass @ ((x - phi.xhat) ** 2).sum(axis=1)) + elasticity.energy(x) for x in states]
    rise, fall = float(np.diff(value).max()), value[0] - min(value)
    error = max(rise, 0.0) / fall if np.isfinite(value).all() else np.inf
    note = f"{len(value) - 1} iterations, least eigenvalue {least:.3g} N/m at the start"
    return Measurement(rise, 0.0, error, note)


@case(
    "newton/indefinite",
    title="From states with indefinite Hessians Newton's method gets to a point where forces balance",
    quantity="largest force on a free vertex over the largest at the start",
    unit="N",
    kind=Kind.CROSS_CODE,
    formula="grad phi(x) = 0",
    source="gradient by scikit-fem",
    tolerance=1e-6,
    reason="the reduction asked for is 1e-8, in another norm",
    over={"start": ("crushed", "everted")},
    requires="scikit-fem",
)
def indefinite(use: Use, *, start: str) -> Measurement:
    """A body that is crushed or turned inside out, and a long step."""
    phi, x_n = _hard(use, start)
    disc, states = phi.backend.disc, _path(phi)
    elasticity = AssembledElasticity(disc.mesh, disc.mu, disc.lam)

    def forces(x: Floats) -> Floats:
        return (phi.inverse_h2 * disc.mass[:, None] * (x - phi.xhat) + elasticity.gradient(x))[disc.free]

    return vanishes(forces(states[-1]), float(np.abs(forces(x_n)).max()), f"{len(states) - 1} iterations")


def _thrown(disc: Discretisation, use: Use) -> IncrementalPotential:
    return IncrementalPotential(use.backend(disc), thrown(disc), H, x_n=disc.mesh.points)


def _residual(phi: IncrementalPotential, made: Preconditioner, x: Floats) -> float:
    made.refresh(phi, x)
    g = phi.backend.nodal_gradient(phi.backend.vertices, x, phi.xhat, phi.inverse_h2)
    return float(np.sqrt(phi.backend.dot(g, made.apply(g))))


@cache
def _hard(use: Use, start: str) -> tuple[IncrementalPotential, Floats]:
    """A long step that begins where the Hessian is indefinite, and the positions [m] there."""
    disc = body("box", "uniform")
    X = disc.mesh.points
    scale = {"crushed": [1.0, 1.0, 0.2], "everted": [1.0, 1.0, -0.8]}[start]
    x = X * scale + 0.2 * mean_edge(disc.mesh) * rng(61).standard_normal(X.shape)
    x_n = np.where(disc.free[:, None], x, X)
    return IncrementalPotential(use.backend(disc), x_n, 0.2, x_n=x_n), x_n


@cache
def _path(phi: IncrementalPotential) -> tuple[Floats, ...]:
    """Iterates of Newton's method to a share of 1e-8 of the residual."""
    solver = Newton(phi.backend, preconditioner_of(phi.backend, "layers"), Budget(60), reduction=1e-8)
    state: NewtonState = solver.init(phi, {})
    states = [state.x.copy()]
    while solver.finished(phi, state) is None:
        state = solver.step(phi, state)
        states.append(state.x.copy())
    return tuple(states)


def _least_eigenvalue(phi: IncrementalPotential, elasticity: AssembledElasticity, x: Floats) -> float:
    at = np.repeat(phi.backend.disc.free, 3)
    A = elasticity.hessian(x) + mass_matrix(phi.inverse_h2 * phi.backend.disc.mass)
    return float(np.linalg.eigvalsh(A.tocsr()[at][:, at].toarray())[0])
