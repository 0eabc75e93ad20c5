# SPDX-License-Identifier: BSD-3-Clause
"""Sets single keys of a scene from outside the file: ``bodies.0.rho = 1.0``."""

from __future__ import annotations

import tomllib
from typing import Any

from femgal.scene.problems import Problem, SceneError


def parse_override(text: str) -> tuple[str, object]:
    """Split ``KEY=VALUE`` as typed on a command line; what is not a TOML value counts as text.

    Raises
    ------
    SceneError
        There is no key or no ``=``.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not key or not equals:
        problem = Problem("", "not an override", text, "KEY=VALUE, such as bodies.0.rho=1.0 or solver.name=jacobi")
        raise SceneError([problem], source="--set")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):  # also numbers of thousands of digits, deep nesting
        return key, value


def apply_override(data: dict[str, Any], key: str, value: object, source: str) -> None:
    """Set a dotted key in the tables of a scene file, in place; tables on the way are made when missing.

    Parameters
    ----------
    data : The parsed scene file.
    key : Keys and list indices joined by dots: ``bodies.0.rho``; ``bodies[0].rho`` means the same.
    value : The value to set.
    source : Where the scene comes from, for messages.

    Raises
    ------
    SceneError
        A list index that does not exist, or a step into something that holds no keys.
    """
    steps = key.replace("[", ".").replace("]", "").split(".")
    here: Any = data
    for step in steps[:-1]:
        here = _inside(here, step, key, source)
    if isinstance(here, list):
        here[_index(here, steps[-1], key, source)] = value
    elif isinstance(here, dict):
        here[steps[-1]] = value
    else:
        raise _refusal(key, source, f"{steps[-1]} in a single value", "keys of tables, indices of lists")


def _inside(here: Any, step: str, key: str, source: str) -> Any:
    if isinstance(here, list):
        return here[_index(here, step, key, source)]
    if isinstance(here, dict):
        return here.setdefault(step, {})
    raise _refusal(key, source, f"{step} in a single value", "keys of tables, indices of lists")


def _index(items: list[Any], step: str, key: str, source: str) -> int:
    if step.isdecimal() and int(step) < len(items):
        return int(step)
    allowed = f"0 to {len(items) - 1}" if items else "nothing: the list is empty"
    raise _refusal(key, source, step, f"an index of the list: {allowed}")


def _refusal(key: str, source: str, found: str, allowed: str) -> SceneError:
    return SceneError([Problem(key, "no such key to override", found, allowed)], source=source)
