# SPDX-License-Identifier: BSD-3-Clause
"""Reads scenes: a built-in name or a TOML file, with overrides, into a validated `Scene`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from femgal.scene import builtin
from femgal.scene.model import Scene, SolverSettings
from femgal.scene.overrides import apply_override
from femgal.scene.problems import Problem, SceneError, scene_error

_POSITION = re.compile(r"^(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$", re.S)


def load_scene(
    name_or_path: str | Path,
    *,
    vertices: int | None = None,
    frames: int | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Scene:
    """Read a built-in scene or a scene file.

    Parameters
    ----------
    name_or_path : Name of a built-in scene (see `femgal.scene.builtin`), or path of a TOML file.
    vertices : Number of vertices of *every* body, in place of what the scene says.
    frames : Number of frames, in place of what the scene says.
    overrides : Dotted keys and values set before validation: ``{"bodies.0.rho": 1.0, "solver.name": "jacobi"}``. With
        the name of another solver, what the scene says of its own solver is left out, but for threads and precision.

    Raises
    ------
    SceneError
        No such scene, not TOML, or keys or values that a scene cannot have; the message lists every problem.
    """
    text, source, folder = _read(name_or_path)
    changes: dict[str, object] = dict(overrides or {})
    if frames is not None:
        changes["frames"] = frames
    return parse_scene(text, source, folder=folder, vertices=vertices, overrides=changes)


def parse_scene(
    text: str,
    source: str,
    *,
    folder: Path | None = None,
    vertices: int | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Scene:
    """Validate the text of a scene file.

    Parameters
    ----------
    text : TOML.
    source : Where the text comes from, for messages; its stem names a scene that has no name.
    folder : Folder that relative mesh paths count from; the working folder when left out.
    vertices, overrides : As in `load_scene`.

    Raises
    ------
    SceneError
        As in `load_scene`.
    """
    data = _parse_toml(text, source)
    data.setdefault("name", Path(source).stem)
    _forget_other_solver(data, overrides or {})
    for key, value in (overrides or {}).items():
        apply_override(data, key, value, source)
    _prepare_bodies(data.get("bodies"), vertices, folder)
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        raise scene_error(error, Scene, source) from None


def _forget_other_solver(data: dict[str, Any], overrides: Mapping[str, object]) -> None:
    """Substeps, step lengths and the like of one solver make no sense for another."""
    table, name = data.get("solver"), overrides.get("solver.name")
    if isinstance(table, dict) and name is not None and name != table.get("name", SolverSettings().name):
        data["solver"] = {key: value for key, value in table.items() if key in ("threads", "precision")}


def _read(name_or_path: str | Path) -> tuple[str, str, Path | None]:
    if isinstance(name_or_path, str) and name_or_path in builtin.names():
        return builtin.text(name_or_path), name_or_path, None
    path = Path(name_or_path).expanduser()
    try:
        return path.read_text(encoding="utf-8"), str(path), path.parent
    except UnicodeDecodeError as error:
        problem = Problem("", "not a text file", f"byte {error.start} is not UTF-8", "a TOML file in UTF-8")
    except FileNotFoundError:
        problem = builtin.not_found(str(name_or_path))
    except OSError as error:
        problem = Problem("", "cannot be read", error.strerror, "a readable TOML file")
    raise SceneError([problem], source=str(name_or_path))


def _parse_toml(text: str, source: str) -> dict[str, Any]:
    try:
        # Files written on Windows may start with a byte order mark, which TOML does not know.
        return tomllib.loads(text.removeprefix("\ufeff"))
    except (ValueError, RecursionError) as error:  # also numbers of thousands of digits, deep nesting
        match = _POSITION.match(str(error))
        what = match["what"] if match else str(error)
        if match and match["line"]:
            where = f"line {match['line']}, column {match['column']}"
        else:
            where = f"line {text.count(chr(10)) + 1}, at the end of the file"
        raise SceneError([Problem(where, f"not valid TOML: {what}", _line(text, match))], source=source) from None


def _line(text: str, match: re.Match[str] | None) -> str | None:
    number = int(match["line"]) if match and match["line"] else 0
    lines = text.splitlines()
    return lines[number - 1].strip() or None if 0 < number <= len(lines) else None


def _prepare_bodies(bodies: object, vertices: int | None, folder: Path | None) -> None:
    """Set the number of vertices and resolve mesh paths; anything malformed is left to the validation."""
    for body in bodies if isinstance(bodies, list) else ():
        if not isinstance(body, dict):
            continue
        if vertices is not None:
            body["vertices"] = vertices
        mesh = body.get("mesh")
        if isinstance(mesh, str) and _is_path(mesh):
            body["mesh"] = str(((folder or Path()) / Path(mesh).expanduser()).resolve())


def _is_path(mesh: str) -> bool:
    return Path(mesh).suffix != "" or "/" in mesh or "\\" in mesh
