# SPDX-License-Identifier: BSD-3-Clause
"""Which settings an accuracy goes with, and what it means where they are left out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    from femgal.scene.model import SolverSettings

# Solvers whose error can be controlled, and what `auto` keeps when no accuracy is given.
CONTROLLED = ("auto", "newton-multigrid", "verlet")
DEFAULT_ACCURACY = 0.01

# Element passes in single precision leave some 1e-5 of a motion to rounding (reports/published).
FINEST_IN_SINGLE = 1e-4


def with_accuracy_defaults(data: Any) -> Any:
    """A solver table with the name that an accuracy alone means, or the accuracy that the name `auto` means."""
    if isinstance(data, dict) and data.get("accuracy") is not None:
        return {"name": "auto"} | data
    if isinstance(data, dict) and data.get("name") == "auto":
        return data | {"accuracy": DEFAULT_ACCURACY}
    return data


def check_accuracy(settings: SolverSettings) -> None:
    """Refuse an accuracy that the other settings contradict.

    Raises
    ------
    PydanticCustomError
        With the key, what was found and what is allowed.
    """
    if settings.accuracy is None:
        return
    if settings.name not in CONTROLLED:
        allowed = ", ".join(f'"{name}"' for name in CONTROLLED)
        advice = "leave out the name, or the accuracy"
        raise _refusal("accuracy", "not for this solver", f'name = "{settings.name}"', allowed, advice)
    if settings.name == "newton-multigrid" and settings.stepping != "tr-bdf2":
        why = "the error of these steps is not known"
        raise _refusal("stepping", why, f'"{settings.stepping}"', '"tr-bdf2" with accuracy')
    if settings.substeps is not None and settings.name != "newton-multigrid":
        raise _refusal("substeps", "the accuracy chooses them", str(settings.substeps), "none with accuracy")
    if settings.mass_scaling is not None:
        why = "a body of another mass moves otherwise"
        raise _refusal("mass_scaling", why, str(settings.mass_scaling), "none with accuracy")
    if settings.precision == "float32" and settings.accuracy < FINEST_IN_SINGLE:
        allowed = f'{FINEST_IN_SINGLE:g} or more with precision = "float32"'
        advice = 'set precision = "float64"'
        raise _refusal("accuracy", "beyond single precision", f"{settings.accuracy:g}", allowed, advice)


def _refusal(key: str, what: str, found: str, allowed: str, advice: str = "leave it out") -> PydanticCustomError:
    context = {"key": f"solver.{key}", "found": found, "allowed": allowed, "advice": advice, "what": what}
    return PydanticCustomError("accuracy", "{what}", context)
