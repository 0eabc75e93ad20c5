# SPDX-License-Identifier: BSD-3-Clause
"""What a verification case is: one function that computes a number, and what is known about that number.

    @case(
        "material/simple-shear",
        title="Simple shear carries shear stress mu g only",
        quantity="P12 / mu", unit="1",
        kind=Kind.CLOSED_FORM, formula="P12 = mu g at F = I + g e1 (x) e2", source="Smith et al. 2018, Eq. 13",
        tolerance={"float64": 1e-12, "float32": 1e-5}, reason="rounding of ten operations",
        over={"precision": PRECISIONS},
    )
    def simple_shear(use: Use, *, precision: str) -> Measurement:
        ...
        return compare(computed, reference)

is a complete case: put it into a module of `verify.cases` and it runs. Each combination of the values in `over` is a
row, ``material/simple-shear[float64]``, and comes to the function by name. What the function returns is an error; the
row passes when the error is a number not above the tolerance. A row without a tolerance reports and judges nothing.
"""

from __future__ import annotations

import enum
import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

PRECISIONS = ("float64", "float32")


class Kind(enum.Enum):
    """Kinds of reference, from the strongest statement to the weakest."""

    CLOSED_FORM = "CLOSED-FORM"
    MANUFACTURED = "MANUFACTURED"
    IDENTITY = "IDENTITY"
    ODE = "ODE"
    CROSS_CODE = "CROSS-CODE"
    LITERATURE = "LITERATURE"
    REGRESSION = "REGRESSION"


class Skip(Exception):
    """Raised by a case that cannot run here; the text says why."""


@dataclass(frozen=True)
class Curve:
    """A line of a plot.

    Parameters
    ----------
    name : For the legend.
    x, y : Points; both positive, the axes are logarithmic.
    """

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]


@dataclass(frozen=True)
class Plot:
    """Curves with logarithmic axes, as data.

    Parameters
    ----------
    title : What the plot shows.
    x, y : Labels of the axes, with units.
    curves : At least one.
    slopes : Orders to draw slope triangles for.
    """

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    slopes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Measurement:
    """What a case has computed.

    Parameters
    ----------
    computed, reference : In the unit of the case; of a field, its norm or its worst value.
    error : What the tolerance judges, as the case's quantity says: relative or absolute.
    note : What a reader should know beside the numbers.
    plots : Curves behind the number.
    """

    computed: float
    reference: float
    error: float
    note: str = ""
    plots: tuple[Plot, ...] = ()


@dataclass(frozen=True)
class Case:
    """A question with a known answer; see the module's own text for an example.

    Parameters
    ----------
    id : topic/name, lower case with hyphens.
    title : One sentence that is true when the case passes.
    quantity, unit : What is compared; "1" where there is no unit.
    kind : Of the reference.
    formula, source : The reference, and where it comes from.
    tolerance : Largest error that passes, for all rows or by precision; None to report and judge nothing.
    reason : Why that tolerance.
    function : Computes a `Measurement` from a `Use` and one value of each axis.
    over : Axes: name to values. "mesh", "precision" and "solver" are known to the suite and may be restricted there.
    quick : True where every row belongs to the quick suite, False where none does; or the values of some axes that
        do, the other axes with all their values.
    requires : What must be there beside femgal, for the reader: "scikit-fem", "a published mesh".
    own_mesh : Whether the case also makes sense on a user's own mesh and material.
    own_solver : Whether its axis "solver" takes any solver that is plugged in (`verify.integrators.under_test`).
    """

    id: str
    title: str
    quantity: str
    unit: str
    kind: Kind
    formula: str
    source: str
    tolerance: Mapping[str, float] | float | None
    reason: str
    function: Callable[..., Measurement]
    over: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    quick: bool | Mapping[str, Sequence[Any]] = True
    requires: str = ""
    own_mesh: bool = False
    own_solver: bool = False

    def __post_init__(self) -> None:
        if complaint := self._complaint():
            raise ValueError(f"case {self.id!r}: {complaint}")

    def _complaint(self) -> str:
        values = [str(value) for axis in self.over.values() for value in axis]
        limits = self.tolerance.values() if isinstance(self.tolerance, Mapping) else (self.tolerance,)
        if not re.fullmatch(r"[a-z0-9-]+/[a-z0-9-]+", self.id):
            return "an id is topic/name, lower case with hyphens"
        if bad := [value for value in values if not value or set(value) & set(" ,[]*?")]:
            return f"values of axes are words without blanks, commas, brackets or stars, not {bad}"
        if isinstance(self.tolerance, Mapping) and set(self.over.get("precision", ())) != set(self.tolerance):
            return "a tolerance by precision needs a precision axis with the same values"
        if any(limit is not None and not 0.0 <= limit < math.inf for limit in limits):
            return f"tolerance {self.tolerance} is not a number from 0 upwards"
        if isinstance(self.quick, Mapping) and not set(self.quick) <= set(self.over):
            return f"quick names axes {sorted(set(self.quick) - set(self.over))} that are not in over"
        return ""

    def rows(self, axes: Mapping[str, Sequence[Any]] | None = None) -> list[Row]:
        """Every combination of the axes' values, those in `axes` in place of the case's own."""
        values = {name: (axes or {}).get(name, own) for name, own in self.over.items()}
        return [
            Row(self, dict(zip(values, chosen, strict=True)))
            for chosen in itertools.product(*map(tuple, values.values()))
        ]


@dataclass(frozen=True)
class Row:
    """A case at one value of each of its axes; ``print(row)`` is its id."""

    case: Case
    values: dict[str, Any]

    def __str__(self) -> str:
        return self.case.id + (f"[{','.join(map(str, self.values.values()))}]" if self.values else "")

    @property
    def tolerance(self) -> float | None:
        """Largest error that passes."""
        given = self.case.tolerance
        if isinstance(given, Mapping):
            return given[str(self.values["precision"])]
        return given

    @property
    def is_quick(self) -> bool:
        """Whether the row belongs to the quick suite."""
        quick = self.case.quick
        if isinstance(quick, bool):
            return quick
        return all(self.values[name] in values for name, values in quick.items())

    def passes(self, error: float) -> bool:
        """Whether an error is small enough; one that is no number, or negative, never is."""
        return self.tolerance is None or (math.isfinite(error) and 0.0 <= error <= self.tolerance)


_CASES: dict[str, Case] = {}


def case(id: str, **what: Any) -> Callable[[Callable[..., Measurement]], Callable[..., Measurement]]:
    """Make a case of a function and add it to the suite; the keywords are those of `Case`."""

    def register(function: Callable[..., Measurement]) -> Callable[..., Measurement]:
        # The same function again is a module that is loaded anew.
        if id in _CASES and _place_of(_CASES[id].function) != _place_of(function):
            raise ValueError(f"two cases are called {id}")
        _CASES[id] = Case(id, function=function, **what)
        return function

    return register


def _place_of(function: Callable[..., Any]) -> tuple[str, str]:
    return function.__module__, function.__qualname__


def registered() -> tuple[Case, ...]:
    """All cases of the modules that have been imported, in order of registration."""
    return tuple(_CASES.values())
