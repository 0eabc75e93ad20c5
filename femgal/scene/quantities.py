# SPDX-License-Identifier: BSD-3-Clause
"""The kinds of values a scene file holds: numbers with units, vectors, directions, and their checks.

Each kind is an annotated type. Bounds, `Unit` and `Words` are read twice: by pydantic to check a value, and by
`femgal.scene.problems` to say in words what would have been accepted.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

from pydantic import AfterValidator, AllowInfNan, BeforeValidator, Field, Strict
from pydantic_core import PydanticCustomError

# A large odd integer, so that no seed is shared by chance with another program's 0, 1 or 42.
DEFAULT_SEED = 20250731


@dataclass(frozen=True)
class Unit:
    """Unit of a quantity, shown in messages."""

    symbol: str


@dataclass(frozen=True)
class Words:
    """What is accepted, in words, where bounds alone do not say it."""

    text: str


# Relative trajectory errors that may be asked for. Below, what a file holds in single precision is no better; above, a
# motion has little to do with the right one.
FINEST_ACCURACY, COARSEST_ACCURACY = 1e-6, 0.5

_HUGE = sys.float_info.max
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _is_number(value: object) -> bool:
    # Bounds in place of isfinite, which fails on integers beyond the range of floats.
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -_HUGE <= value <= _HUGE


def _vector(value: Any) -> tuple[float, ...]:
    if isinstance(value, (list, tuple)) and len(value) == 3 and all(_is_number(v) for v in value):
        return tuple(float(v) for v in value)
    raise PydanticCustomError("vector", "not three finite numbers")


def _direction(value: Any) -> tuple[float, ...]:
    if isinstance(value, str):
        if value in _AXES:
            return _AXES[value]
        raise PydanticCustomError("direction", "not a direction")
    vector = _vector(value)
    if math.hypot(*vector) == 0.0:
        raise PydanticCustomError("direction", "a direction of length zero")
    return vector


def _layers(value: Any) -> Any:
    if value == "full" or (isinstance(value, int) and not isinstance(value, bool) and value >= 0):
        return value
    raise PydanticCustomError("layers", "not a number of layers")


def _steps(value: Any) -> Any:
    if value in ("spectral", "exact", "backtracking", "lu2025"):
        return value
    pair = isinstance(value, (list, tuple)) and len(value) == 2
    if pair and all(_is_number(w) and 0.0 < w < 2.0 for w in value):
        return tuple(float(w) for w in value)
    raise PydanticCustomError("steps", "not a choice of step lengths")


def _radius(value: Any) -> Any:
    if value == "auto":
        return value
    if _is_number(value) and 0.0 < value < 1.0:
        return float(value)
    raise PydanticCustomError("radius", "not a spectral radius")


def _accuracy(value: Any) -> Any:
    number = value
    if isinstance(value, str):
        text = value.strip()
        try:
            number = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
        except ValueError:
            raise PydanticCustomError("accuracy", "not an accuracy") from None
    if _is_number(number) and FINEST_ACCURACY <= number <= COARSEST_ACCURACY:
        return float(number)
    raise PydanticCustomError("accuracy", "out of range" if _is_number(number) else "not an accuracy")


def _increasing(times: tuple[float, ...]) -> tuple[float, ...]:
    if not times or any(later <= earlier for earlier, later in pairwise(times)):
        raise PydanticCustomError("times", "times do not increase")
    return times


def _not_empty(items: tuple[Any, ...]) -> tuple[Any, ...]:
    if not items:
        raise PydanticCustomError("empty", "the list is empty")
    return items


# Runs after the items were checked; a minimum length would complain once more about items that are merely wrong.
NotEmpty = AfterValidator(_not_empty)

Number = Annotated[float, Strict(), AllowInfNan(False)]
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Text = Annotated[str, Strict()]
Count = Annotated[Integer, Field(ge=1)]
Index = Annotated[Integer, Field(ge=0)]

YoungsModulus = Annotated[Number, Field(gt=0), Unit("Pa")]
PoissonsRatio = Annotated[Number, Field(gt=-1, lt=0.5)]
Density = Annotated[Number, Field(gt=0), Unit("kg/m^3")]
Length = Annotated[Number, Field(gt=0, le=1e9), Unit("m")]
# Smallest dihedral angle of a tetrahedron; that of the regular one is 70.5 degrees.
DihedralAngle = Annotated[Number, Field(ge=1e-3, le=70), Unit("degrees")]

Triple = tuple[float, float, float]
Vector = Annotated[Triple, BeforeValidator(_vector), Words("three finite numbers, [x, y, z]")]
Direction = Annotated[
    Triple, BeforeValidator(_direction), Words('"x", "y", "z" or three numbers that are not all zero')
]
Times = Annotated[
    tuple[Number, ...], AfterValidator(_increasing), Words("one or more times [s], each later than the one before")
]
Layers = Annotated[Any, BeforeValidator(_layers), Words('"full" or an integer >= 0')]
StepLengths = Annotated[
    Any,
    BeforeValidator(_steps),
    Words('"spectral", "exact", "backtracking", "lu2025" or [w_coarse, w_fine] with 0 < w < 2'),
]
SpectralRadius = Annotated[Any, BeforeValidator(_radius), Words('"auto" or a number between 0 and 1')]
Accuracy = Annotated[
    Any, BeforeValidator(_accuracy), Words(f'from {FINEST_ACCURACY:g} to {COARSEST_ACCURACY:g}, as 0.01 or "1%"')
]
