# SPDX-License-Identifier: BSD-3-Clause
"""Every solver and every preconditioner that a scene may name is made and moves a body.

1. Every name of the solver table runs a scene, both formulas of time stepping included, with frames that are finite and
   on the way down; implicit ones end near the motion of velocity Verlet.
2. Every preconditioner runs and solves its steps; only those made of layers build a hierarchy.
3. Solvers have defaults of their own, which a scene may overrule.
4. What a solver cannot do is refused before anything is built.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from femgal.scene.load import parse_scene
from femgal.scene.model import SolverSettings
from femgal.simulation import Simulation
from meshes.errors import InputError

NAMES = get_args(SolverSettings.model_fields["name"].annotation)
PRECONDITIONERS = get_args(SolverSettings.model_fields["preconditioner"].annotation)
SCENE = """
name = "small"
frames = 2
frames_per_second = 30.0
[[bodies]]
mesh = "beam"
vertices = 160
E = 2e4
nu = 0.3
rho = 1000.0
[[constraints]]
where = {{halfspace = {{point = [0, 0, 0], normal = [-1, 0, 0]}}, relative = true}}
[solver]
name = "{name}"
"""
ENOUGH = {
    "vbd": "substeps = 60\niterations = 3",
    "vbd-explicit": "substeps = 60\niterations = 3",
    "jacobi": "substeps = 60\niterations = 3",
    "jacobi-explicit": "substeps = 60\niterations = 3",
    "scalar-jacobi": "substeps = 60\niterations = 3",
    "fas": "substeps = 60",
}


def run(name: str, lines: str = ""):
    simulation = Simulation.prepare(parse_scene(SCENE.format(name=name) + lines, "small.toml"))
    return simulation, list(simulation.frames())


REFERENCE = run("verlet")[1][-1].state.x


def error(frames) -> float:
    moved = REFERENCE - frames[0].state.x
    return float(np.linalg.norm(frames[-1].state.x - REFERENCE) / np.linalg.norm(moved))


@pytest.mark.parametrize("stepping", ["backward-euler", "bdf2"])
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("verlet", "auto")])
def test_every_solver_moves_the_body(name, stepping):
    simulation, frames = run(name, f'stepping = "{stepping}"\n' + ENOUGH.get(name, "substeps = 20"))
    assert len(frames) == 3
    assert simulation.plan.passes_per_substep > 0.0
    assert error(frames) < (0.1 if stepping == "backward-euler" else 0.05)


@pytest.mark.parametrize("preconditioner", PRECONDITIONERS)
def test_every_preconditioner_solves_its_steps(preconditioner):
    simulation, frames = run("newton-multigrid", f'preconditioner = "{preconditioner}"\n')
    assert (simulation.hierarchy is not None) == (preconditioner in ("layers", "cycle"))
    assert all(frame.row["unconverged"] == 0 for frame in frames)
    assert error(frames) < 0.01


def test_defaults_go_by_name():
    assert SolverSettings(name="newton-multigrid").stepping == "tr-bdf2"
    assert SolverSettings(name="newton-multigrid", stepping="bdf2", iterations=3).iterations == 3
    assert SolverSettings(name="newton-multigrid", stepping="bdf2").stepping == "bdf2"
    assert SolverSettings().stepping == "backward-euler"
    assert SolverSettings(name="jacobi-explicit").steps == "spectral"


@pytest.mark.parametrize(
    ("lines", "parts"),
    [
        ('name = "jacobi-explicit"\nsteps = "exact"', ("solver.steps", "exact", "spectral")),
        ('name = "fas"\nstepping = "tr-bdf2"', ("solver.stepping", "tr-bdf2", "newton-multigrid")),
        ('name = "vbd"\nrelaxation = 2.0', ("solver.relaxation", "2.0", "< 2")),
        ('name = "newton-multigrid"\nreduction = 0.0', ("solver.reduction", "0.0")),
        ('name = "newton-multigrid"\npreconditioner = "amg"', ("solver.preconditioner", "amg", "layers")),
        ('name = "newton-multigrid"\nchebyshev = 0.9', ("solver.chebyshev", "newton-multigrid does not smooth")),
    ],
)
def test_refusals(lines, parts):
    with pytest.raises(InputError) as caught:
        parse_scene(SCENE.replace('name = "{name}"', lines).format(), "small.toml")
    for part in parts:
        assert part in str(caught.value)
