# SPDX-License-Identifier: BSD-3-Clause
"""Solves scenes of elastic bodies with matrix-free Galerkin multigrid.

>>> import femgal
>>> scene = femgal.load_scene("cube-random", vertices=343, frames=2)
>>> result = femgal.run(scene)
>>> result.status
'finished'
>>> [u.shape for u in result.displacements]  # x - X [m] of frames 0, 1 and 2
[(343, 3), (343, 3), (343, 3)]
>>> result.rows[2]["elastic_energy"] < result.rows[0]["elastic_energy"]  # the cube recovers
True

With a folder, ``femgal.run(scene, "out")`` writes what the command line does, and ``femgal.read_run("out")`` reads it.
`Simulation` gives frame after frame, its `world`, `hierarchy`, `plan` and `backend` all arrays.

Names are loaded on first use, so that ``import femgal`` stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from femgal.failure import SolverFailure
    from femgal.output.read import read_run
    from femgal.runner import Progress, RunResult, run
    from femgal.scene.load import load_scene, parse_scene
    from femgal.scene.model import Scene
    from femgal.simulation import Simulation
    from meshes.errors import InputError

__version__ = "0.1.0"

__all__ = [
    "InputError",
    "Progress",
    "RunResult",
    "Scene",
    "Simulation",
    "SolverFailure",
    "load_scene",
    "parse_scene",
    "read_run",
    "run",
]

_HOMES = {
    "InputError": "meshes.errors",
    "Progress": "femgal.runner",
    "RunResult": "femgal.runner",
    "Scene": "femgal.scene.model",
    "Simulation": "femgal.simulation",
    "SolverFailure": "femgal.failure",
    "load_scene": "femgal.scene.load",
    "parse_scene": "femgal.scene.load",
    "read_run": "femgal.output.read",
    "run": "femgal.runner",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'femgal' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
