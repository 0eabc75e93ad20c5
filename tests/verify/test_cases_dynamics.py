# SPDX-License-Identifier: BSD-3-Clause
"""The cases of dynamics.

1. No quick row fails, and each law is asked of each solver that promises it.
2. Laws notice a motion that breaks them: momentum that a little friction takes, spin that is kept where backward Euler
   loses it, energy that is put in, a vertex that slips, a state that remembers too little.
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
LAWS = {row.case.id: row.case for row in choose("dynamics/*")}


def test_quick_rows():
    results = list(run(choose("dynamics/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    rows = {str(result.row) for result in results}
    for law in ("free-fall", "constrained", "linear-momentum", "centre-of-mass", "turned-start", "restart"):
        solvers = ("verlet", "fas", "fas-linear", "fas-bdf2", "newton-multigrid", "vbd")
        assert {f"dynamics/{law}[{solver}]" for solver in solvers} <= rows
    for law in ("angular-momentum-loss", "energy-decay"):
        assert {f"dynamics/{law}[{solver}]" for solver in ("fas", "newton-multigrid-euler", "vbd")} <= rows
    assert {"dynamics/angular-momentum[verlet]", "dynamics/rest[fas,free]"} <= rows


def spoilt(name: str, spoil) -> SolverUnderTest:
    """A good solver whose every new state goes through `spoil(before, after)`."""
    good = solver_under_test(name, USE)

    def step(mesh, material, state, h):
        return spoil(state, good.function(mesh, material, state, h))

    return SolverUnderTest("spoilt", step, good.method, good.order)


def rubbed(before, after):
    return replace(after, v=after.v * (1.0 - 1e-9))


def slipping(before, after):
    x = after.x.copy()
    x[before.constrained[:1]] += 1e-15
    return replace(after, x=x)


def shaken(before, after):
    return replace(after, v=after.v + np.array([3.0, 0.0, 0.0]))


def counted(before, after):
    """Depends on a number that it keeps to itself."""
    counted.calls += 1
    return replace(after, v=after.v * (1.0 + 1e-15 * counted.calls))


counted.calls = 0


def drifting(before, after):
    return replace(after, x=after.x + 1e-9 * np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("law", "solver", "spoil"),
    [
        ("linear-momentum", "fas", rubbed),
        ("centre-of-mass", "verlet", drifting),
        ("free-fall", "jacobi", drifting),
        ("constrained", "fas", slipping),
        ("angular-momentum", "verlet", rubbed),
        ("angular-momentum-loss", "fas", rubbed),
        ("reversible", "verlet", rubbed),
        ("energy-inequality", "jacobi", shaken),
        ("energy-decay", "jacobi", shaken),
        ("turned-start", "verlet", drifting),
        ("restart", "verlet", counted),
    ],
)
def test_laws_notice(law, solver, spoil):
    use_own_solver(spoilt(solver, spoil))
    values = {"solver": OWN_SOLVER} | ({"step": "short"} if law == "energy-inequality" else {})
    result = run_row(Row(LAWS[f"dynamics/{law}"], values), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None
    assert result.measurement.error > 0.0


def test_verlet_does_not_pass_for_backward_euler():
    verlet = solver_under_test("verlet", USE)
    use_own_solver(SolverUnderTest("liar", verlet.function, "backward-euler", 1))
    laws = ("free-fall", "angular-momentum-loss")
    results = [run_row(Row(LAWS[f"dynamics/{law}"], {"solver": OWN_SOLVER}), USE) for law in laws]
    assert [result.status for result in results] == [Status.FAIL] * 2
