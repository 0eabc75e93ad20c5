# SPDX-License-Identifier: BSD-3-Clause
"""What a solver leaves undone: its distance from the converged motion of the same time stepping with the same step.

The converged motion is Newton's with a direct solver on small meshes, and femgal's own to eight digits on large ones.
"""

from __future__ import annotations

from typing import Any

from femgal.scene.model import SolverSettings
from verify.work_precision.method import Method

# Largest number of vertices for direct solvers.
SMALL = 1000

# What every solver can step by; the others are for femgal's Newton alone.
_OF_ANY_SOLVER = ("backward-euler", "bdf2")

_TIGHT: dict[str, Any] = {"reduction": 1e-8, "iterations": 50, "linear_iterations": 5000}


def converged_method(settings: SolverSettings, vertices: int) -> Method | None:
    """The method that takes the same steps and solves each; None where the steps are the method's own choice.

    Parameters
    ----------
    settings : Solver table of the scene with the method, or with the one in whose place it is put.
    """
    if settings.name == "verlet" or settings.accuracy is not None or settings.substeps is None:
        return None
    steps = (("stepping", settings.stepping), ("substeps", settings.substeps))
    if vertices <= SMALL and settings.stepping in _OF_ANY_SOLVER:
        return Method("newton-direct", steps, "converged")
    return Method("newton-multigrid", (*steps, *_TIGHT.items()), "converged")
