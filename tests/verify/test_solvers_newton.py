# SPDX-License-Identifier: BSD-3-Clause
"""Newton's method of the baselines.

1. With a small tolerance it ends at the minimiser that the reference finds, held or free, however the body curves.
2. It ends when the residual has fallen to twice the tolerance, with as few systems as that takes.
3. phi never grows, where the Hessian is indefinite neither.
4. A body at rest costs nothing; lost forces and too few iterations are reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.solvers.solver import Outcome
from tests.verify.thrown_beam import MESH, X, body, distance, minimiser, solved, thrown
from verify.problems.bodies import positions
from verify.solvers.newton import Newton
from verify.solvers.system import AssembledJacobi, MatrixFreeJacobi


def newton(phi, system=AssembledJacobi, **settings) -> Newton:
    """The baseline."""
    return Newton(phi.backend, system(phi.backend), **settings)


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("system", [AssembledJacobi, MatrixFreeJacobi])
def test_converges_to_the_minimiser(system, held):
    phi = thrown(held=held)
    state = solved(newton(phi, system, tolerance=1e-11), phi)
    assert state.outcome is Outcome.CONVERGED
    assert distance(state.x, phi, minimiser(held=held)) <= 1e-9


@pytest.mark.parametrize("tolerance", [1e-1, 5e-3, 1e-6])
def test_ends_at_the_tolerance(tolerance):
    phi = thrown()
    solver = newton(phi, tolerance=tolerance)
    first, last = solver.init(phi, {}), solved(solver, phi)
    left = np.linalg.norm(phi.gradient(last.x)) / np.linalg.norm(phi.gradient(first.x))
    assert last.outcome is Outcome.CONVERGED
    assert left <= 2.0 * tolerance
    assert solver.effort.newton == last.iteration <= 4
    assert solver.effort.linear > solver.effort.newton


def test_one_system_where_the_motion_is_nearly_linear():
    phi = thrown()
    gentle = replace(phi, xhat=X + 1e-4 * (phi.xhat - X))
    assert solved(newton(gentle), gentle).iteration == 1


def test_phi_never_grows_where_the_hessian_is_indefinite():
    disc = body()
    crushed = np.where(disc.free[:, None], positions(MESH, "random"), X)
    phi = replace(thrown(), xhat=crushed, x_n=crushed, h=1.0)
    solver = newton(phi, iterations=60)
    state = solver.init(phi, {})
    values = [phi.value(crushed)]
    while solver.finished(phi, state) is None:
        state = solver.step(phi, state)
        values.append(phi.value(state.x))
    assert solver.finished(phi, state) is Outcome.CONVERGED
    assert solver.effort.definite > 0
    assert (np.diff(values) <= 1e-12 * values[0]).all()


def test_rest_costs_nothing():
    phi = replace(thrown(), xhat=X)
    solver = newton(phi)
    state = solved(solver, phi)
    assert state.outcome is Outcome.CONVERGED
    assert solver.effort.linear <= 2
    assert np.abs(state.x - X).max() <= 1e-15


def test_too_few_iterations():
    phi = thrown()
    assert solved(newton(phi, tolerance=1e-10, iterations=1), phi).outcome is Outcome.NOT_CONVERGED


def test_what_is_not_a_number():
    phi = thrown()
    lost = replace(phi, xhat=np.where(body().free[:, None], np.nan, X), x_n=None)
    assert solved(newton(lost), lost).outcome is Outcome.DIVERGED
