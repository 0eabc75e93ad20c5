# SPDX-License-Identifier: BSD-3-Clause
"""The competing and reference solvers by name, for any simulation that is ready to run.

    simulation = Simulation.prepare(scene)
    solver = reference_solver("newton-pcg", simulation, tolerance=1e-3)
    simulation.stepper = dataclasses.replace(simulation.stepper, solver=solver)

takes the steps of the scene's implicit method with that solver. Precision and threads are those of the simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from femgal.kernels.backend import Backend
from femgal.scene.problems import close_match
from femgal.simulation import Simulation
from femgal.solvers.solver import Solver
from meshes.errors import InputError
from verify.reference.newton import ReferenceNewton
from verify.solvers.amg import SmoothedAggregation
from verify.solvers.newton import Newton
from verify.solvers.sgm import SGM
from verify.solvers.system import AssembledJacobi, LinearSystem, MatrixFreeJacobi

_NEWTON: dict[str, Any] = {"tolerance": 5e-3, "iterations": 20, "linear_iterations": 5000}
_MATRICES = {"assembled": AssembledJacobi, "matrix-free": MatrixFreeJacobi}

# Settings of each solver with their defaults.
SETTINGS: dict[str, dict[str, Any]] = {
    "newton-pcg": {"matrix": "assembled", **_NEWTON},
    "newton-amg": _NEWTON,
    "newton-amg-plain": _NEWTON,
    "newton-direct": {"tolerance": 1e-12, "iterations": 60},
    "sgm": {**_NEWTON, "cluster": 64, "ratio": 8, "smoothings": 1, "accelerate": True},
}
NAMES = tuple(SETTINGS)


@dataclass(frozen=True)
class _Rule:
    """What a setting may be, in words and as a test."""

    allowed: str
    holds: Callable[[Any], bool]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


_COUNT = _Rule("an integer, 1 or more", _is_count)
_RULES = {
    "matrix": _Rule(", ".join(_MATRICES), lambda value: value in _MATRICES),
    "tolerance": _Rule("a number between 0 and 1", lambda value: _is_number(value) and 0.0 < value < 1.0),
    "iterations": _COUNT,
    "linear_iterations": _COUNT,
    "cluster": _Rule("an integer, 4 or more", lambda value: _is_count(value) and value >= 4),
    "ratio": _Rule("an integer, 2 or more", lambda value: _is_count(value) and value >= 2),
    "smoothings": _COUNT,
    "accelerate": _Rule("True, False", lambda value: isinstance(value, bool)),
}


def reference_solver(name: str, simulation: Simulation, **settings: Any) -> Solver:
    """A solver by name for the bodies and the backend of a simulation.

    Parameters
    ----------
    name : One of NAMES.
    settings : Keys of SETTINGS[name]. `tolerance` is the relative error that the solver stops at, `iterations` are
        Newton iterations of one step at most, `linear_iterations` those of one linear system; `matrix` is "assembled"
        or "matrix-free"; the others are those of `SGM`.

    Raises
    ------
    InputError
        There is no such solver or setting, or the value is not allowed.
    """
    chosen = _checked(name, settings)
    backend = simulation.backend
    if name == "newton-direct":
        return ReferenceNewton(simulation.disc, **chosen)
    return Newton(backend, _system(name, backend, chosen), chosen["tolerance"], chosen["iterations"])


def _system(name: str, backend: Backend, chosen: dict[str, Any]) -> LinearSystem:
    most = chosen["linear_iterations"]
    if name == "sgm":
        return SGM(backend, most, **{key: chosen[key] for key in ("cluster", "ratio", "smoothings", "accelerate")})
    if name == "newton-pcg":
        return _MATRICES[chosen["matrix"]](backend, most)
    return SmoothedAggregation(backend, most, rigid_modes=name == "newton-amg")


def _checked(name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Settings with the defaults of those left out."""
    if name not in SETTINGS:
        raise InputError(
            "there is no such solver", found=name, allowed=", ".join(NAMES), advice=close_match(name, NAMES)
        )
    defaults = SETTINGS[name]
    for key, value in settings.items():
        if key not in defaults:
            raise InputError("there is no such setting", where=name, found=key, allowed=", ".join(defaults))
        if not _RULES[key].holds(value):
            raise InputError(
                "the value is not allowed", where=f"{name}.{key}", found=value, allowed=_RULES[key].allowed
            )
    return {**defaults, **settings}
