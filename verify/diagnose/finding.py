# SPDX-License-Identifier: BSD-3-Clause
"""What a diagnosis is made of."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


class Severity(enum.Enum):
    """How much a finding matters, from nothing to what ruins a simulation."""

    OK = "ok"
    NOTE = "note"
    WARNING = "warning"
    PROBLEM = "problem"

    @property
    def rank(self) -> int:
        """Larger is worse."""
        return list(Severity).index(self)


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Parameters
    ----------
    topic : Two words or so.
    severity : How much it matters.
    what : What was found, a sentence or two with the numbers that matter.
    advice : What to do; empty where nothing has to be done.
    numbers : All numbers behind it, by name; units are in the names.
    """

    topic: str
    severity: Severity
    what: str
    advice: str = ""
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready; numbers that JSON does not know become words."""
        return {
            "topic": self.topic,
            "severity": self.severity.value,
            "what": self.what,
            "advice": self.advice,
            "numbers": {name: plain(value) for name, value in self.numbers.items()},
        }


def plain(value: Any) -> Any:
    """The same value for JSON: without NumPy's types, infinity and NaN as words."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def shown(value: float, digits: int = 2) -> str:
    """A number with some significant digits, as people write it: 860, 1,200, 0.012, 3.4e-07."""
    if not math.isfinite(value) or value == 0.0 or not 1e-3 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:,.{max(0, digits - 1 - math.floor(math.log10(abs(rounded))))}f}"


def percent(share: float) -> str:
    """A share in per cent, with two significant digits."""
    return f"{shown(100.0 * share)} %"


def count(number: int, what: str, plural: str = "") -> str:
    """Number and noun, as in 1,200 tetrahedra; the plural has an s where none is given."""
    return f"{number:,} {what if number == 1 else plural or what + 's'}"
