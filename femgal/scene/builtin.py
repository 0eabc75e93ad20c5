# SPDX-License-Identifier: BSD-3-Clause
"""The scenes that come with femgal, kept as commented scene files."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable

from femgal.scene.problems import Problem, SceneError, close_match

DEFAULT = "rabbit-drape"


def names() -> tuple[str, ...]:
    """Return the names of the built-in scenes, the default one first."""
    found = sorted(entry.name.removesuffix(".toml") for entry in _folder().iterdir() if entry.name.endswith(".toml"))
    return (DEFAULT, *(name for name in found if name != DEFAULT))


def text(name: str) -> str:
    """Return the scene file of a built-in scene, comments included.

    Raises
    ------
    SceneError
        There is no such scene.
    """
    if name not in names():
        raise SceneError([not_found(name)], source=name)
    return (_folder() / f"{name}.toml").read_text(encoding="utf-8")


def not_found(name: str) -> Problem:
    """Return the problem of a scene that does not exist, with the names of those that do."""
    known = names()
    allowed = f"a built-in scene ({', '.join(known)}) or the path of a TOML file"
    return Problem("", "no such scene", name, allowed, close_match(name, known))


def _folder() -> Traversable:
    return resources.files("femgal.scene") / "scenes"
