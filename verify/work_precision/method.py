# SPDX-License-Identifier: BSD-3-Clause
"""One way of solving a scene: a solver of femgal or of `verify.solvers`, with its settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import ValidationError

from femgal.scene.model import Scene, SolverSettings
from femgal.scene.problems import close_match, scene_error
from meshes.errors import InputError

# What a scene says for a solver of `verify.solvers`: how time is stepped, and in which arithmetic.
STEPPING_KEYS = ("stepping", "substeps", "precision")

# Prepared in place of a solver of `verify.solvers`, which then takes its seat: it builds nothing and estimates nothing.
HOST = {"name": "jacobi", "steps": "exact"}


@dataclass(frozen=True)
class Method:
    """A solver and its settings; one row of each scene.

    Parameters
    ----------
    name : A solver of a scene's solver table, or of `verify.solvers.registry`.
    settings : Its keys and values, as the grid orders them.
    curve : Name of the curve that its row is a point of.
    """

    name: str
    settings: tuple[tuple[str, Any], ...]
    curve: str

    def __str__(self) -> str:
        words = (f"{key}={_shown(value)}" for key, value in self.settings)
        return " ".join((self.name, *words))

    @property
    def is_reference(self) -> bool:
        """Whether it is a solver of `verify.solvers`."""
        return self.name not in production_names()

    @property
    def own_settings(self) -> dict[str, Any]:
        """Settings of a solver of `verify.solvers` itself, without those of its time stepping."""
        return {key: value for key, value in self.settings if key not in STEPPING_KEYS}

    def scene(self, base: Scene, threads: int) -> Scene:
        """A scene with this solver, or with the one in whose place it is put.

        Raises
        ------
        InputError
            Settings that the solver does not have.
        """
        settings = dict(self.settings)
        if self.is_reference:
            _check_reference(self)
            table = HOST | {key: value for key, value in settings.items() if key in STEPPING_KEYS}
        else:
            table = {"name": self.name, **settings}
        data = base.model_dump(exclude_none=True)
        data["solver"] = {"threads": threads, **table}
        try:
            return Scene.model_validate(data)
        except ValidationError as error:
            raise scene_error(error, Scene, str(self)) from None


def production_names() -> tuple[str, ...]:
    """Names of the solvers that a scene may ask for."""
    return get_args(SolverSettings.model_fields["name"].annotation)


def reference_settings() -> Mapping[str, Mapping[str, Any]]:
    """Keys and defaults of the solvers of `verify.solvers`, by name."""
    try:
        from verify.solvers.registry import NAMES, SETTINGS  # type: ignore[import-untyped]
    except ImportError:
        return {}
    return {name: SETTINGS[name] for name in NAMES}


def known_names() -> tuple[str, ...]:
    """Names of all solvers."""
    return (*production_names(), *(name for name in reference_settings() if name not in production_names()))


def check_name(name: str, where: str) -> None:
    """Refuse what is no solver.

    Raises
    ------
    InputError
        There is no such solver.
    """
    known = known_names()
    if name not in known:
        advice = close_match(name, known)
        raise InputError("no such solver", where=where, found=repr(name), allowed=", ".join(known), advice=advice)


def _check_reference(method: Method) -> None:
    keys = (*STEPPING_KEYS, *reference_settings()[method.name])
    for key in dict(method.settings):
        if key not in keys:
            raise InputError(
                "not a setting of this solver",
                where=str(method),
                found=key,
                allowed=", ".join(keys),
                advice=close_match(key, keys),
            )


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_shown, value)) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)
