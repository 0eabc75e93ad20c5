# SPDX-License-Identifier: BSD-3-Clause
"""Reference solvers by name.

1. Each drives the steps of a scene for ten frames, under every implicit stepping, close to the reference's motion.
2. Every setting has a default that is allowed.
3. Unknown names, settings and values are refused with what is allowed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from femgal.simulation import Simulation
from meshes.errors import InputError
from tests.femgal.scenes import hanging_beam
from verify.solvers.registry import NAMES, SETTINGS, reference_solver

FRAMES = 10


def simulation(stepping: str) -> Simulation:
    """A small beam that hangs down, prepared with another solver."""
    lines = f'substeps = 2\nstepping = "{stepping}"'
    return Simulation.prepare(hanging_beam(frames=FRAMES, solver="newton-multigrid", solver_lines=lines))


@cache
def motion(name: str, stepping: str) -> np.ndarray:
    """Displacements after ten frames [m], shape [n, 3]."""
    one = simulation(stepping)
    one.stepper = replace(one.stepper, solver=reference_solver(name, one))
    frames = list(one.frames())
    assert [frame.row["unconverged"] for frame in frames] == [0] * (FRAMES + 1)
    return frames[-1].state.x - one.disc.mesh.points


@pytest.mark.parametrize("stepping", ["backward-euler", "bdf2", "tr-bdf2"])
@pytest.mark.parametrize("name", [name for name in NAMES if name != "newton-direct"])
def test_ten_frames(name, stepping):
    exact = motion("newton-direct", stepping)
    assert np.abs(exact).max() > 0.01
    assert np.linalg.norm(motion(name, stepping) - exact) <= 5e-3 * np.linalg.norm(exact)


@pytest.mark.parametrize("name", NAMES)
def test_settings(name):
    one = simulation("bdf2")
    assert type(reference_solver(name, one, **SETTINGS[name])) is type(reference_solver(name, one))


def test_settings_arrive():
    one = simulation("bdf2")
    solver = reference_solver("newton-pcg", one, matrix="matrix-free", tolerance=0.1, iterations=3, linear_iterations=7)
    assert (solver.tolerance, solver.iterations, solver.system.iterations) == (0.1, 3, 7)
    assert type(solver.system).__name__ == "MatrixFreeJacobi"


@pytest.mark.parametrize(
    ("name", "settings", "part"),
    [
        ("newton-pgc", {}, "newton-pcg"),
        ("newton-direct", {"matrix": "assembled"}, "tolerance, iterations"),
        ("newton-pcg", {"tolerance": 0}, "between 0 and 1"),
        ("newton-pcg", {"tolerance": "small"}, "between 0 and 1"),
        ("newton-pcg", {"iterations": 2.5}, "1 or more"),
        ("newton-pcg", {"matrix": "sparse"}, "matrix-free"),
    ],
)
def test_refused(name, settings, part):
    with pytest.raises(InputError, match=part):
        reference_solver(name, simulation("bdf2"), **settings)
