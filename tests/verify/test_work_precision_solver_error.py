# SPDX-License-Identifier: BSD-3-Clause
"""Which converged motion a solver error is taken from.

1. The same steps, by a direct solver on small meshes and by femgal's Newton on large ones and for its own stepping; the
   method is one that a scene accepts.
2. None where the method chooses its steps.
"""

from __future__ import annotations

import pytest

from femgal.scene.model import SolverSettings
from tests.femgal.scenes import hanging_beam
from verify.work_precision.solver_error import SMALL, converged_method


@pytest.mark.parametrize(
    ("stepping", "vertices", "name"),
    [
        ("backward-euler", SMALL, "newton-direct"),
        ("bdf2", SMALL, "newton-direct"),
        ("bdf2", SMALL + 1, "newton-multigrid"),
        ("tr-bdf2", SMALL, "newton-multigrid"),
    ],
)
def test_same_steps(stepping, vertices, name):
    solver = "newton-multigrid" if stepping == "tr-bdf2" else "jacobi"
    method = converged_method(SolverSettings(name=solver, stepping=stepping, substeps=7), vertices)
    assert method is not None
    assert method.name == name
    settings = method.scene(hanging_beam(), 1).solver
    assert (settings.stepping, settings.substeps) == (stepping, 7)


@pytest.mark.parametrize("settings", [{"name": "verlet"}, {"name": "auto"}, {"name": "fas"}])
def test_own_steps(settings):
    assert converged_method(SolverSettings(**settings), 100) is None
