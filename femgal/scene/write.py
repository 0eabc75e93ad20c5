# SPDX-License-Identifier: BSD-3-Clause
"""Writes a scene as a TOML file that runs as it is."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from femgal.scene.model import Scene

_TABLES = ("solver", "output")
_LISTS = ("bodies", "constraints")


def scene_to_toml(scene: Scene) -> str:
    """Return the scene file of a scene: every value, defaults included; loading it gives an equal scene."""
    data = scene.model_dump(exclude_none=True)
    plain = {key: value for key, value in data.items() if key not in (*_TABLES, *_LISTS)}
    blocks = ["\n".join(_assignments(plain))]
    blocks += [_block(f"[{key}]", data[key]) for key in _TABLES]
    blocks += [_block(f"[[{key}]]", item) for key in _LISTS for item in data[key]]
    return "\n\n".join(blocks) + "\n"


def _block(header: str, table: Mapping[str, Any]) -> str:
    return "\n".join([header, *_assignments(table)])


def _assignments(table: Mapping[str, Any]) -> Iterator[str]:
    return (f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's strings are TOML's basic strings but for DEL, which TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_assignments(value)) + " }" if value else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return repr(value)
