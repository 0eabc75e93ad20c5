# SPDX-License-Identifier: BSD-3-Clause
"""A number that a device has, and that is fetched when somebody looks at it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable


class Deferred:
    """A float that costs a wait for the device: `float(number)` makes it.

    Parameters
    ----------
    read : Waits for the device and returns the number; called anew at every look.
    """

    def __init__(self, read: Callable[[], float]) -> None:
        self._read = read

    def __float__(self) -> float:
        return self._read()


Number = float | Deferred


def times(t: float, number: Number) -> Number:
    """t times a number; deferred when that is."""
    return Deferred(lambda: t * float(number)) if isinstance(number, Deferred) else t * number


def largest_of(numbers: Iterable[Number]) -> Number:
    """The largest of some numbers, not a number where one of them is not; deferred when one of them is."""
    found = list(numbers)
    if any(isinstance(number, Deferred) for number in found):
        return Deferred(lambda: float(largest_of([float(number) for number in found])))
    most = 0.0
    for number in found:
        # In this order max hands on what is not a number, and keeps it.
        most = most if math.isnan(most) else max(float(number), most)
    return most
