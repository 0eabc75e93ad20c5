# SPDX-License-Identifier: BSD-3-Clause
"""How far to go along a correction: the change of the potential along a line is an exact polynomial of degree six.

One energy pass gives its coefficients (`IncrementalPotential.along`), and every trial step costs six multiplications
after that. Both searches take the coefficients of t, t^2, ..., t^6 and return t >= 0; the change at t is negative or
t is zero, so the potential never grows. NaN when a coefficient is not finite.

The first minimum costs no more than backtracking and follows a motion better: a full block-Jacobi step overshoots the
stiffest modes by more than it corrects them (1 - lambda, where -1/3 is the least that keeps their vibration bounded),
and backtracking accepts it as long as the others gain more, so that the body trembles until its energy bounds that.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LineSearch = Callable[[Floats], float]

# Armijo's share of the decrease that the slope promises. It is far above what single precision leaves uncertain in the
# coefficients (some 1e-6 of each), so a step that rounding alone makes look downhill is not taken.
SUFFICIENT = 1e-4

# The cubic and higher terms of corrections that nearly turn elements inside out need some ten halvings at most.
MOST_HALVINGS = 60

# From 1 to the root, where the slope is nearly linear: three or four double the digits to all there are.
_MOST_NEWTON_STEPS = 8


def backtrack(coefficients: Floats, start: float = 1.0) -> float:
    """First of t = start, start / 2, start / 4, ... with phi(t) - phi(0) <= SUFFICIENT * t * (slope at 0).

    Zero when phi does not fall at t = 0 (Armijo 1966; the full step is taken wherever it is good enough).
    """
    if not np.isfinite(coefficients).all():
        return math.nan
    if not coefficients[0] < 0.0:
        return 0.0
    t = start
    for _ in range(MOST_HALVINGS):
        if change(coefficients, t) <= SUFFICIENT * t * coefficients[0]:
            return t
        t *= 0.5
    return 0.0


def first_minimum(coefficients: Floats) -> float:
    """Smallest t > 0 where c_1 t + c_2 t^2 + ... has slope zero; zero when it does not fall at t = 0."""
    if not np.isfinite(coefficients).all():
        return math.nan
    # The direction may be zero up to rounding, as at rest: then there is nothing to gain.
    if not coefficients[0] < 0.0:
        return 0.0
    # In units of the step to the minimum of the quadratic part, and of the gain there, the polynomial of a motion that
    # is nearly linear is -2 s + s^2: no overflow, and what rounding leaves of the higher terms can be dropped.
    unit = -0.5 * coefficients[0] / coefficients[1] if coefficients[1] > 0.0 else 1.0
    powers = np.arange(1, len(coefficients) + 1)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        slope = powers * coefficients * unit ** (powers - 1.0) / -coefficients[0]
    if not np.isfinite(slope).all():
        return math.nan
    if coefficients[1] > 0.0 and (s := _root_near_one(slope.tolist())) is not None:
        return unit * s
    slope[np.abs(slope) < 1e-18 * np.abs(slope).max()] = 0.0
    roots = np.roots(slope[::-1])
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return unit * float(real.min()) if len(real) else 0.0


def _root_near_one(slope: list[float]) -> float | None:
    """The only root in [0, 2] of -1 + s + a s^2 + b s^3 + ..., where the higher terms are too small for another one.

    All roots of a polynomial take 0.3 ms, as long as an energy pass over 8,000 elements.
    """
    higher = slope[2:]
    # Then the derivative is above 1/2 everywhere in the interval, and the ends have different signs.
    if sum(k * abs(a) * 2.0**k for k, a in enumerate(higher, 2)) > 1.0:
        return None
    s = 1.0
    for _ in range(_MOST_NEWTON_STEPS):
        value, derivative = s - 1.0, 1.0
        for k, a in enumerate(higher, 2):
            value += a * s**k
            derivative += k * a * s ** (k - 1)
        before, s = s, s - value / derivative
        if abs(s - before) <= 1e-15 * s:
            return s
    return s


def change(coefficients: Floats, t: float) -> float:
    """c_1 t + c_2 t^2 + ...: phi(x + t d) - phi(x) [J]."""
    value = 0.0
    for c in coefficients[::-1]:
        value = t * (float(c) + value)
    return value
