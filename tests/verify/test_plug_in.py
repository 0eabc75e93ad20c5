# SPDX-License-Identifier: BSD-3-Clause
"""A user's own solver.

1. A correct one passes all that it promises; what it does not promise is skipped, and the row says how to promise it.
   Cases about solvers of femgal's own are not asked of it.
2. One that raises, returns something else, wrong shapes or NaN is a failure that says what and where; the arrays that
   it was given are its own to overwrite.
3. A function is found by module and name or by file and name; what cannot be found, imported or called is an
   InputError that says what would do.
4. One that promises nothing fails all the same where its energy is another one, the moduli of small strains being the
   same, and where it leaves bodies as they are.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from meshes.errors import InputError
from verify import check_solver
from verify.integrators.plug_in import as_solver, load_solver, own_solver_rows
from verify.integrators.under_test import OWN_SOLVER, State
from verify.suite.run import Status

SOLVER_FILE = """
from dataclasses import replace
import part_of_mine

def step(mesh, material, state, h):
    return replace(state, x=state.x + h * state.v)

step.order = 1
nothing = 3

def two(a, b):
    return a
"""


def accelerations(mesh, material, x):
    """In NumPy alone; returns (a, mass)."""
    X, T = mesh.points, mesh.cells
    Dm = np.swapaxes(X[T[:, 1:]] - X[T[:, :1]], 1, 2)
    V, B = np.linalg.det(Dm) / 6.0, np.linalg.inv(Dm)
    F = np.swapaxes(x[T[:, 1:]] - x[T[:, :1]], 1, 2) @ B
    f1, f2, f3 = F[:, :, 0], F[:, :, 1], F[:, :, 2]
    C = np.stack([np.cross(f2, f3), np.cross(f3, f1), np.cross(f1, f2)], axis=2)
    J = (f1 * C[:, :, 0]).sum(axis=1)
    P = material.mu[:, None, None] * F + (material.lam * (J - 1.0) - material.mu)[:, None, None] * C
    forces = V[:, None, None] * P @ np.swapaxes(B, 1, 2)  # on corners 1, 2, 3 as columns
    f, mass = np.zeros_like(x), np.zeros(len(x))
    for k in range(3):
        np.add.at(f, T[:, k + 1], -forces[:, :, k])
        np.add.at(f, T[:, 0], forces[:, :, k])
    np.add.at(mass, T.ravel(), np.repeat(material.rho * V / 4.0, 4))
    return f / mass[:, None]


def symplectic_euler(mesh, material, state, h):
    """A kick, then a drift."""
    v = state.v + h * (accelerations(mesh, material, state.x) + state.gravity)
    v[state.constrained] = 0.0
    return replace(state, x=state.x + h * v, v=v)


def st_venant_kirchhoff(mesh, material, state, h):
    """Velocity Verlet with P = F (2 mu E + lam_Lame tr E I): the same material at small strains, another at large."""

    def accelerations_there(x):
        X, T = mesh.points, mesh.cells
        Dm = np.swapaxes(X[T[:, 1:]] - X[T[:, :1]], 1, 2)
        V, B = np.linalg.det(Dm) / 6.0, np.linalg.inv(Dm)
        F = np.swapaxes(x[T[:, 1:]] - x[T[:, :1]], 1, 2) @ B
        E = 0.5 * (np.swapaxes(F, 1, 2) @ F - np.eye(3))
        mu, lam = (a[:, None, None] for a in (material.mu, material.lam - material.mu))
        P = F @ (2.0 * mu * E + lam * np.trace(E, axis1=1, axis2=2)[:, None, None] * np.eye(3))
        outer = np.swapaxes(V[:, None, None] * P @ np.swapaxes(B, 1, 2), 1, 2)
        f, mass = np.zeros_like(x), np.zeros(len(x))
        np.add.at(f, T, np.concatenate([outer.sum(axis=1, keepdims=True), -outer], axis=1))
        np.add.at(mass, T.ravel(), np.repeat(material.rho * V / 4.0, 4))
        a = f / mass[:, None] + state.gravity
        a[state.constrained] = 0.0
        return a

    v = state.v + 0.5 * h * accelerations_there(state.x)
    x = state.x + h * v
    return replace(state, x=x, v=v + 0.5 * h * accelerations_there(x))


def idle(mesh, material, state, h):
    return state


def coasting(mesh, material, state, h):
    return replace(state, x=state.x + h * state.v)


def test_another_energy_is_noticed_without_a_promise():
    right = check_solver(symplectic_euler, pattern="stepping/*")
    assert {r.row.case.id for r in right if r.status is Status.PASS} == {"stepping/frequency", "stepping/strained"}
    wrong = check_solver(st_venant_kirchhoff)
    assert {r.row.case.id for r in wrong if r.status is Status.FAIL} == {"stepping/strained"}
    assert statuses(wrong)["dynamics/linear-momentum"] is Status.PASS
    strained = next(r for r in wrong if r.row.case.id == "stepping/strained")
    assert strained.measurement.error > 0.3


@pytest.mark.parametrize("step", [idle, coasting])
def test_a_solver_that_does_nothing_passes_nothing(step):
    results = check_solver(step)
    assert {result.status for result in results} == {Status.FAIL, Status.SKIP}
    assert all("set step." in result.note for result in results if result.status is Status.SKIP)
    assert any("as they were" in result.note or "where it was" in result.note for result in results)


def statuses(results):
    return {result.row.case.id: result.status for result in results}


def test_a_correct_solver_passes_what_it_promises():
    results = check_solver(symplectic_euler, order=1, pattern="dynamics/*")
    assert [f"{r.row}: {r.note}" for r in results if r.status is Status.FAIL] == []
    found = statuses(results)
    for law in ("rest", "constrained", "linear-momentum", "centre-of-mass", "turned-start", "restart"):
        assert found[f"dynamics/{law}"] is Status.PASS
    assert found["dynamics/energy-decay"] is Status.SKIP
    skipped = next(result for result in results if result.row.case.id == "dynamics/energy-decay")
    assert "method = backward-euler" in skipped.note


def test_only_cases_that_take_any_solver_are_asked():
    solver = as_solver(symplectic_euler, order=1)
    rows = own_solver_rows(solver)
    assert {row.case.id.split("/")[0] for row in rows} == {"dynamics", "stepping"}
    assert {row.values["solver"] for row in rows} == {OWN_SOLVER}
    with pytest.raises(InputError, match="stepping, dynamics"):
        own_solver_rows(solver, "patch/*")


def raising(mesh, material, state, h):
    raise RuntimeError("no licence")


def nothing(mesh, material, state, h):
    return None


def flat(mesh, material, state, h):
    return replace(state, x=state.x.ravel())


def lost(mesh, material, state, h):
    v = state.v.copy()
    v[7, 1] = np.nan
    return State(state.x, v)


def vandal(mesh, material, state, h):
    state.x[:] = 0.0
    state.v[:] = 0.0
    return state


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (raising, ("RuntimeError", "no licence", "raising")),
        (nothing, ("nothing returned NoneType", "State")),
        (flat, ("x of shape (525,)", "(175, 3)")),
        (lost, ("v that is not finite", "vertex 7", "1 in all")),
    ],
)
def test_answers_that_are_none(step, words):
    (result,) = check_solver(step, pattern="dynamics/linear-momentum")
    assert result.status is Status.FAIL
    for word in words:
        assert word in result.note


def test_arrays_may_be_overwritten():
    (first,) = check_solver(vandal, pattern="dynamics/linear-momentum")
    assert first.status is Status.FAIL
    (second,) = check_solver(symplectic_euler, pattern="dynamics/linear-momentum")
    assert second.status is Status.PASS


def test_a_solver_is_found_by_file_and_by_module(tmp_path, monkeypatch):
    (tmp_path / "solver_of_mine.py").write_text(SOLVER_FILE)
    (tmp_path / "part_of_mine.py").write_text("")
    by_file = load_solver(f"{tmp_path / 'solver_of_mine.py'}:step")
    assert (by_file.name, by_file.method, by_file.order) == ("step", None, 1)
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    assert load_solver("solver_of_mine:step").name == "step"
    assert sys.path == before
    for text, words in {
        "step": ("not the name of a function", "module:function"),
        "no_such_module_of_mine:step": ("cannot be imported", "ModuleNotFoundError"),
        "absent.py:step": ("no such file", "absent.py"),
        "solver_of_mine:other": ("no such function", "step, two"),
        "solver_of_mine:nothing": ("cannot be called", "3"),
        "solver_of_mine:two": ("wrong arguments", "(mesh, material, state, h)"),
    }.items():
        with pytest.raises(InputError) as error:
            load_solver(text)
        for word in words:
            assert word in str(error.value)


def test_promises_are_checked():
    assert as_solver(symplectic_euler, method="verlet").order == 2
    for promise in ({"method": "leapfrog"}, {"order": 7}, {"method": "verlet", "order": 1}):
        with pytest.raises(InputError):
            as_solver(symplectic_euler, **promise)
