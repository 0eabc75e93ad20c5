# SPDX-License-Identifier: BSD-3-Clause
"""What a key of the scene file accepts, in words, read from the annotations that check it."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from itertools import chain
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from femgal.scene.quantities import Unit, Words

Location = tuple[str | int, ...]

_KINDS = ((bool, "true or false"), (int, "an integer"), (float, "a number"), (str, "text in quotes"))
_LONGEST = 100


def allowed_text(location: Location, field: FieldInfo) -> str:
    """Return what a key accepts: ``0 < E [Pa]``, ``"x", "y", "z"``, ``a table with keys from: ...``.

    Parameters
    ----------
    location : Keys and list indices that lead to the value.
    field : The last key's declaration.
    """
    notes = list(_notes(field))
    words = [note.text for note in notes if isinstance(note, Words)]
    unit = "".join(f" [{note.symbol}]" for note in notes if isinstance(note, Unit))
    inner = list(tables(field.annotation))
    if inner and (isinstance(location[-1], int) or not words):
        return f"a table with keys from: {', '.join(inner[0].model_fields)}"
    if words:
        return words[0] + unit
    if one_of := choices(field.annotation):
        return ", ".join(shown(choice) for choice in one_of)
    return _range_text(str(location[-1]), notes, field.annotation) + unit


def tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the table types that an annotation holds, lists and unions included."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from tables(argument)


def choices(annotation: Any) -> tuple[Any, ...]:
    """Return the literal values that an annotation allows; empty when it is not a choice."""
    if typing.get_origin(annotation) is Literal:
        return typing.get_args(annotation)
    return tuple(choice for argument in typing.get_args(annotation) for choice in choices(argument))


def shown(value: object) -> str:
    """Return a value as it would stand in a scene file, shortened."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = f'"{value}"'
    elif isinstance(value, dict):
        text = "{" + ", ".join(f"{key} = {shown(item)}" for key, item in value.items()) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(shown(item) for item in value) + "]"
    else:
        text = str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _range_text(name: str, notes: list[Any], annotation: Any) -> str:
    kinds = set(_kinds(annotation))
    low, high = _bound(notes, "gt", "ge"), _bound(notes, "lt", "le")
    if low is None and high is None:
        return next((text for kind, text in _KINDS if kind in kinds), "a list")
    left = f"{low[1]:g} {'<' if low[0] == 'gt' else '<='} " if low else ""
    right = f" {'<' if high[0] == 'lt' else '<='} {high[1]:g}" if high else ""
    return f"{left}{name}{right}" + (", an integer" if int in kinds else "")


def _bound(notes: list[Any], strict: str, weak: str) -> tuple[str, float] | None:
    found = [(sign, getattr(note, sign)) for note in notes for sign in (strict, weak) if hasattr(note, sign)]
    return found[-1] if found else None


def _kinds(annotation: Any) -> Iterator[Any]:
    yield annotation
    for argument in typing.get_args(annotation):
        yield from _kinds(argument)


def _notes(field: FieldInfo) -> Iterator[Any]:
    """Yield bounds, units and words of a field, those of ``X | None`` and of list items included."""
    inner = (getattr(kind, "__metadata__", ()) for kind in _kinds(field.annotation))
    for note in chain(field.metadata, *inner):
        yield from note.metadata if isinstance(note, FieldInfo) else (note,)
