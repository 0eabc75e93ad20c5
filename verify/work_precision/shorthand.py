# SPDX-License-Identifier: BSD-3-Clause
"""A grid as typed on a command line."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from femgal.scene.accuracy import CONTROLLED
from femgal.scene.model import SolverSettings
from femgal.scene.problems import close_match
from meshes.errors import InputError
from verify.work_precision.method import STEPPING_KEYS, check_name, production_names, reference_settings

_COMMAS = re.compile(r",(?![^\[]*\])")


def choices(text: str) -> list[Any]:
    """Values separated by commas: numbers, words, lists in brackets: ``5,10``, ``exact,[0.25,0.5]``.

    What is not a TOML value counts as text.
    """
    return [_value(part.strip()) for part in _COMMAS.split(text)]


def numbers(text: str, where: str) -> list[float]:
    """Numbers separated by commas.

    Raises
    ------
    InputError
        Something else.
    """
    found = choices(text)
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in found):
        raise InputError("not a list of numbers", where=where, found=repr(text), allowed="numbers separated by commas")
    return found


def solver_tables(
    names: Sequence[str], specs: Sequence[str], common: Mapping[str, Sequence[Any]]
) -> list[dict[str, Any]]:
    """Solver tables of a grid.

    Parameters
    ----------
    names : Solvers with all defaults.
    specs : Solvers with choices of their own: ``fas substeps=5,10 steps=exact,spectral label=mine``.
    common : Choices for every solver that has such a key and does not say otherwise. Of these Verlet takes
        precision and accuracy only: it chooses its own step.

    Raises
    ------
    InputError
        Unknown solver; a word that is no choice; a key that no solver has.
    """
    tables = [{"name": name} for name in names] + [_table(spec) for spec in specs]
    for table in tables:
        check_name(table["name"], "--solvers")
    for key, values in common.items():
        taking = [table for table in tables if key in _keys(table["name"])]
        if tables and not taking:
            every = sorted({key for table in tables for key in _keys(table["name"])})
            advice = close_match(key, every)
            raise InputError(
                "no solver of this grid has such a key", where=key, found=key, allowed=", ".join(every), advice=advice
            )
        for table in taking:
            table.setdefault(key, list(values))
    return tables


def assignment(text: str, where: str) -> tuple[str, list[Any]]:
    """Split ``KEY=V,V``.

    Raises
    ------
    InputError
        There is no key, or no ``=``.
    """
    key, equals, values = (part.strip() for part in text.partition("="))
    if not key or not equals or not values:
        raise InputError("not a choice", where=where, found=repr(text), allowed="KEY=VALUE,VALUE,...")
    return key, choices(values)


def _table(spec: str) -> dict[str, Any]:
    try:
        name, *words = shlex.split(spec)
    except ValueError:
        raise InputError(
            "not a solver", where="--solver", found=repr(spec), allowed='"NAME KEY=VALUE,VALUE ..."'
        ) from None
    table: dict[str, Any] = {"name": name}
    for word in words:
        key, values = assignment(word, f"--solver {name}")
        table[key] = str(word.partition("=")[2]) if key == "label" else values
    return table


def _keys(name: str) -> set[str]:
    if name == "verlet":
        return {"precision", "accuracy"}
    if name in production_names():
        # `auto` chooses how it steps.
        own = set(STEPPING_KEYS) - {"precision"} if name == "auto" else set()
        own |= set() if name in CONTROLLED else {"accuracy"}
        return set(SolverSettings.model_fields) - {"name", "threads"} - own
    return {*STEPPING_KEYS, *reference_settings()[name]}


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
