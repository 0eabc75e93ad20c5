# SPDX-License-Identifier: BSD-3-Clause
"""The cases about steps.

1. No quick row fails, and the solvers that matter are among them.
2. They notice a step that is solved too loosely, one that takes the wrong share of the force, and one of first order
   that says it is of second.
3. BDF2 and TR-BDF2 by the reference Newton keep their order (slow).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verify.integrators.under_test import OWN_SOLVER, SolverUnderTest, solver_under_test, use_own_solver
from verify.suite.case import Row
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id: row.case for row in choose("stepping/*")}


def test_quick_rows():
    results = list(run(choose("stepping/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    rows = {str(result.row) for result in results}
    for case in ("frequency", "vibration", "strained", "order"):
        assert {f"stepping/{case}[{solver}]" for solver in ("verlet", "fas", "fas-bdf2", "newton-multigrid")} <= rows
    solvers = ("fas", "fas-linear", "newton-multigrid-euler", "vbd", "vbd-explicit", "jacobi", "jacobi-explicit")
    assert {f"stepping/one-step[{solver},box,long]" for solver in solvers} <= rows


def own(name: str, change, **promises) -> None:
    good = solver_under_test(name, USE)

    def step(mesh, material, state, h):
        return change(good.function, mesh, material, state, h)

    use_own_solver(SolverUnderTest("changed", step, **({"method": good.method, "order": good.order} | promises)))


def loose(step, mesh, material, state, h):
    after = step(mesh, material, state, h)
    predicted = state.x + h * state.v + h * h * state.gravity
    predicted[state.constrained] = state.x[state.constrained]
    x = after.x + 1e-4 * (predicted - after.x)
    return replace(after, x=x, v=(x - state.x) / h)


def softer(step, mesh, material, state, h):
    return step(mesh, replace(material, E=0.99 * material.E), state, h)


def slower(step, mesh, material, state, h):
    """Backward Euler's frequency in place of Verlet's: 1.5 in a thousand too low."""
    return step(mesh, replace(material, rho=1.003 * material.rho), state, h)


def unchanged(step, *arguments):
    return step(*arguments)


@pytest.mark.parametrize(
    ("row", "solver", "change", "promises"),
    [
        (("one-step", {"mesh": "box", "step": "long"}), "jacobi", loose, {}),
        (("vibration", {}), "verlet", softer, {}),
        (("frequency", {}), "verlet", softer, {}),
        (("frequency", {}), "verlet", slower, {}),
        (("order", {}), "verlet", softer, {}),
        (("order", {}), "jacobi", unchanged, {"method": None, "order": 2}),
    ],
)
def test_what_is_noticed(row, solver, change, promises):
    own(solver, change, **promises)
    name, values = row
    result = run_row(Row(CASES[f"stepping/{name}"], {"solver": OWN_SOLVER} | values), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None
    assert np.isfinite(result.measurement.error)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["newton-bdf2", "newton-tr-bdf2"])
def test_references_of_second_order(solver):
    for case in ("order", "vibration"):
        assert run_row(Row(CASES[f"stepping/{case}"], {"solver": solver}), USE).status is Status.PASS
