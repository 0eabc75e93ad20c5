# SPDX-License-Identifier: BSD-3-Clause
"""Whole scenes in Numba's simulator: the same motion as on the CPU.

1. Positions to 1e-9 of the motion and energies to 1e-8 of the largest one in float64, 1e-4 in float32, for every
   solver, transfer, cycle, step rule, time stepping and preconditioner that a GPU takes, with vertices that are held
   and moved.
2. As many substeps and passes as on the CPU, and the same estimates of the error where an accuracy is asked for.
3. Never more memory than was expected, nor less than a fourth.
4. Substeps of fixed length are repeated from a recording, and of no other solver.
"""

from __future__ import annotations

import pytest

from tests.femgal.kernels_cuda.simulated import in_simulator

SOLVERS = {
    "spectral": 'name = "fas"\nsubsteps = 4\nratio = 8\nsteps = "spectral"',
    "given steps": 'name = "fas"\nsubsteps = 4\nratio = 8\nsteps = [0.5, 0.7]\nblocks = "fresh"\nstepping = "bdf2"',
    "exact": 'name = "fas"\nsubsteps = 3\nratio = 8',
    "backtracking": 'name = "fas"\nsubsteps = 2\nratio = 8\nsteps = "backtracking"\ncycle = "W"',
    "linear": 'name = "fas"\ntransfer = "linear"\nsubsteps = 2\nstepping = "bdf2"\ncycle = "V"',
    "jacobi": 'name = "jacobi"\nsubsteps = 3\niterations = 2\nsteps = "spectral"\nblocks = "fresh"',
    "scalar": 'name = "scalar-jacobi"\nsubsteps = 2\ntolerance = 1e-5\niterations = 3',
    "chebyshev": 'name = "jacobi"\nsubsteps = 2\niterations = 3\nchebyshev = "auto"',
    "fixed weights": 'name = "jacobi"\nsubsteps = 3\niterations = 3\nchebyshev = 0.5\nsteps = "spectral"',
    "verlet": 'name = "verlet"',
    "verlet, given substeps": 'name = "verlet"\nsubsteps = 4',
    "newton, layers": 'name = "newton-multigrid"\nsubsteps = 1\npreconditioner = "layers"',
    "newton, cycle": 'name = "newton-multigrid"\nsubsteps = 1\npreconditioner = "cycle"\nstepping = "bdf2"',
    # A cycle in double precision takes another path to the solution than one in single: solve far enough to meet there.
    "newton, v-cycle": 'name = "newton-multigrid"\nsubsteps = 1\nreduction = 1e-8',
    "verlet, accuracy": 'name = "verlet"\naccuracy = 0.05',
    "auto": 'name = "auto"\naccuracy = 0.05',
    "newton, accuracy": 'name = "newton-multigrid"\naccuracy = 0.2\npreconditioner = "layers"\nreduction = 1e-8',
    "vbd": 'name = "vbd"\nsubsteps = 3\niterations = 2',
    "newton, blocks": 'name = "newton-multigrid"\nsubsteps = 1\npreconditioner = "blocks"\nstepping = "backward-euler"',
}
QUICK = ("spectral",)

# With fixed step lengths, or none: substeps that are recorded once and repeated.
# Verlet's own step is so long here that a frame is one of it.
VERLET = ("verlet, given substeps", "verlet, accuracy", "auto")
REPEATED = ("spectral", "given steps", "jacobi", "fixed weights", "vbd", *VERLET)
TOLERANCES = {"float64": (1e-9, 1e-8), "float32": (1e-4, 1e-4)}
PATH = "path = {times = [0.0, 0.05], offsets = [[0, 0, 0], [0.01, 0, 0]]}"


def run(name: str, precision: str, path: str = "") -> dict:
    return in_simulator("verify.gpu.scenes", f"[solver]\n{SOLVERS[name]}", precision, "2", path)


def assert_same(found: dict, precision: str) -> None:
    positions, energies = TOLERANCES[precision]
    assert found["status"] == ["finished", "finished"]
    assert found["moved"] > 1e-3
    assert found["positions"] <= positions
    assert found["energies"] <= energies
    assert found["substeps"][0] == found["substeps"][1]
    assert found["estimated_error"][0] == pytest.approx(found["estimated_error"][1], rel=1e-6)
    taken, expected = found["bytes"]
    assert taken <= expected <= 4 * taken
    assert found["passes"][0] == pytest.approx(found["passes"][1], rel=1e-12)


@pytest.mark.parametrize("name", QUICK)
def test_scene(name):
    found = run(name, "float64")
    assert_same(found, "float64")
    assert found["repeated"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SOLVERS if name not in QUICK])
def test_every_solver(name):
    found = run(name, "float64")
    assert_same(found, "float64")
    assert (found["repeated"] > 0) == (name in REPEATED)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spectral", "verlet", "linear"])
def test_single_precision(name):
    assert_same(run(name, "float32"), "float32")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["given steps", "verlet", "exact"])
def test_moving_vertices(name):
    assert_same(run(name, "float64", PATH), "float64")
