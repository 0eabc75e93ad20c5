# SPDX-License-Identifier: BSD-3-Clause
"""A logarithmic axis: from numbers to pixels, and where its labels stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

_LEAST_DECADES = 0.7
_MOST_LABELS = 7


@dataclass(frozen=True)
class LogScale:
    """Maps lo ... hi, both positive, to the pixels start ... end."""

    lo: float
    hi: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """Pixel of a positive value."""
        share = math.log10(value / self.lo) / math.log10(self.hi / self.lo)
        return self.start + share * (self.end - self.start)

    @property
    def decades(self) -> float:
        """Length in powers of ten."""
        return math.log10(self.hi / self.lo)

    def ticks(self) -> list[float]:
        """Values to label: powers of ten, or 1, 2, 5 times them where there are few."""
        first, last = math.floor(math.log10(self.lo)), math.ceil(math.log10(self.hi))
        leading = (1.0,) if self.decades >= 2.5 else (1.0, 2.0, 5.0)
        values = [m * 10.0**n for n in range(first, last + 1) for m in leading]
        inside = [value for value in values if self.lo <= value <= self.hi]
        return inside[:: math.ceil(len(inside) / _MOST_LABELS)] if len(leading) == 1 else inside


def log_scale(values: Sequence[float], start: float, end: float, margin: float = 0.06) -> LogScale:
    """A scale that holds some positive values, with a margin and at least most of a decade."""
    lo, hi = math.log10(min(values)), math.log10(max(values))
    missing = max(0.0, _LEAST_DECADES - (hi - lo)) / 2.0
    space = margin * max(hi - lo, _LEAST_DECADES) + missing
    return LogScale(10.0 ** (lo - space), 10.0 ** (hi + space), start, end)


def tick_label(value: float) -> tuple[str, str]:
    """Text of a label and its exponent: ("0.02", ""), ("10", "-5"), ("2×10", "-5")."""
    if 1e-2 <= value < 1e4:
        return f"{value:.6g}", ""
    exponent = math.floor(math.log10(value) + 1e-9)
    leading = value / 10.0**exponent
    return ("10" if abs(leading - 1.0) < 1e-6 else f"{leading:.3g}\u00d710"), str(exponent)
