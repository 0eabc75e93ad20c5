# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with a scene, in words: one error that lists every problem."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from femgal.scene.allowed import Location, allowed_text, choices, shown, tables
from meshes.errors import InputError

_WHAT = {
    "missing": "required key is missing",
    "literal_error": "not one of the choices",
    "finite_number": "not a finite number",
}


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where (``bodies[0].E``), what, the value found, what is allowed, what to do."""

    key: str
    what: str
    found: str | None = None
    allowed: str | None = None
    advice: str = ""

    def lines(self) -> list[str]:
        """Return the problem as indented lines."""
        rows = (("found", self.found), ("allowed", self.allowed), ("do", self.advice or None))
        details = [f"    {label + ':':9s}{text}" for label, text in rows if text is not None]
        return [f"  {self.key}: {self.what}" if self.key else f"  {self.what}", *details]


class SceneError(InputError):
    """A scene that cannot be used; `problems` holds every reason.

    Parameters
    ----------
    problems : What is wrong, in the order of the file.
    source : File, built-in scene or other origin of the scene.
    """

    def __init__(self, problems: Iterable[Problem], *, source: str) -> None:
        self.problems = tuple(problems)
        first = self.problems[0]
        what = first.what if len(self.problems) == 1 else f"{len(self.problems)} problems"
        super().__init__(what, where=source, found=first.found, allowed=first.allowed, advice=first.advice)

    def _message(self) -> str:
        count = len(self.problems)
        head = f"{self.where}: {count} problem{'s' if count > 1 else ''} in the scene"
        return "\n".join([head, *(line for problem in self.problems for line in problem.lines())])


def scene_error(error: ValidationError, model: type[BaseModel], source: str) -> SceneError:
    """Translate pydantic's report on `model` into a `SceneError`."""
    return SceneError([_problem(item, model) for item in error.errors(include_url=False)], source=source)


def key_text(location: Sequence[str | int]) -> str:
    """Return the TOML path of a location: ``bodies[0].E``."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return text.removeprefix(".")


def close_match(word: object, known: Iterable[str]) -> str:
    """Return ``did you mean ...?`` for a misspelt word, or nothing."""
    names = list(known)
    folded = {name.lower(): name for name in reversed(names)}
    match = difflib.get_close_matches(str(word).lower(), list(folded), 1, 0.6)
    return f"did you mean {folded[match[0]]}?" if match else ""


def _problem(item: Any, model: type[BaseModel]) -> Problem:
    kind, context = item["type"], item.get("ctx", {})
    location, owner, field = _walk(model, item["loc"])
    if kind == "extra_forbidden":
        return _unknown_key(location, owner)
    if kind.startswith("union_tag"):
        return _unknown_kind(location, item["input"], field)
    allowed = context.get("allowed") or (allowed_text(location, field) if field else None)
    return Problem(
        key=context.get("key") or key_text(location),
        what=_WHAT.get(kind) or _what(kind, item["msg"]),
        found=None if kind == "missing" else context.get("found", shown(item["input"])),
        allowed=allowed,
        advice=context.get("advice") or _choice_hint(kind, item["input"], field),
    )


def _what(kind: str, message: str) -> str:
    if kind.startswith(("greater_than", "less_than")):
        return "out of range"
    return "wrong type" if kind.endswith(("_type", "_parsing", "_from_float")) else message


def _unknown_key(location: Location, owner: type[BaseModel] | None) -> Problem:
    known = list(owner.model_fields) if owner else []
    name = str(location[-1])
    return Problem(key_text(location), "unknown key", name, ", ".join(known), close_match(name, known))


def _unknown_kind(location: Location, found: Any, field: FieldInfo | None) -> Problem:
    kinds = [str(_tag(option)) for option in tables(field.annotation)] if field else []
    allowed = ", ".join(shown(kind) for kind in kinds)
    key, kind = key_text((*location, "kind")), found.get("kind") if isinstance(found, dict) else found
    if kind is None:
        return Problem(key, _WHAT["missing"], allowed=allowed)
    return Problem(key, _WHAT["literal_error"], shown(kind), allowed, close_match(kind, kinds))


def _choice_hint(kind: str, found: object, field: FieldInfo | None) -> str:
    if kind != "literal_error" or field is None:
        return ""
    return close_match(found, (str(choice) for choice in choices(field.annotation)))


def _walk(model: type[BaseModel], steps: Location) -> tuple[Location, type[BaseModel] | None, FieldInfo | None]:
    """Follow a location into the models: the location without union tags, the last table, and its field if known."""
    owner: type[BaseModel] | None = model
    field: FieldInfo | None = None
    path: list[str | int] = []
    options: list[type[BaseModel]] = [model]
    for step in steps:
        tagged = [option for option in options if len(options) > 1 and _tag(option) == step]
        if tagged:
            options = tagged
            continue
        path.append(step)
        if isinstance(step, str):
            owner = options[0] if options else None
            field = owner.model_fields.get(step) if owner else None
            options = list(tables(field.annotation)) if field else []
    return tuple(path), owner, field


def _tag(model: type[BaseModel]) -> str | None:
    field = model.model_fields.get("kind")
    return next(iter(choices(field.annotation)), None) if field else None
