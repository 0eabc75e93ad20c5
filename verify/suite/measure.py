# SPDX-License-Identifier: BSD-3-Clause
"""From what a case has computed to a `Measurement`: differences, bounds, and orders of convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from verify.suite.case import Curve, Measurement, Plot


def compare(
    computed: ArrayLike, reference: ArrayLike, scale: float | None = None, note: str = "", plots: tuple[Plot, ...] = ()
) -> Measurement:
    """Largest difference of two arrays of one shape, relative to a scale.

    Parameters
    ----------
    scale : What the difference is relative to; the largest entry of the reference when None. Give the size of a single
        term where the reference is a sum that may cancel, or 1 for an absolute error.

    Returns
    -------
    The numbers shown are the entries where the difference is largest.
    """
    a, b = np.atleast_1d(np.asarray(computed, np.float64)), np.atleast_1d(np.asarray(reference, np.float64))
    if a.shape != b.shape:
        raise ValueError(f"shapes {a.shape} and {b.shape} cannot be compared")
    difference = np.abs(a - b)
    worst = np.unravel_index(int(np.argmax(np.where(np.isfinite(difference), difference, np.inf))), a.shape)
    size = float(np.abs(b).max()) if scale is None else scale
    if not 0.0 < size < np.inf:
        raise ValueError(f"nothing can be relative to {size:g}; where the reference is zero everywhere, give a scale")
    return Measurement(float(a[worst]), float(b[worst]), float(difference[worst]) / size, note, plots)


def vanishes(values: ArrayLike, scale: float, note: str = "", plots: tuple[Plot, ...] = ()) -> Measurement:
    """Largest absolute value of what should be zero, relative to a scale."""
    return compare(values, np.zeros_like(np.asarray(values, np.float64)), scale, note, plots)


def at_most(value: float, bound: float, note: str = "", plots: tuple[Plot, ...] = ()) -> Measurement:
    """By what share of the bound's size a value exceeds it; 0 when it does not."""
    if not np.isfinite(bound):
        raise ValueError(f"{bound} is not a bound")
    excess = value - bound
    error = max(0.0, excess) / max(abs(bound), np.finfo(float).tiny) if np.isfinite(value) else float("inf")
    return Measurement(value, bound, error, note, plots)


def worst(found: Mapping[str, Measurement]) -> Measurement:
    """The measurement with the largest error, one that is not a number before all others; the note says whose it is."""
    name = max(found, key=lambda one: found[one].error if np.isfinite(found[one].error) else np.inf)
    note = f"worst of {len(found)}: {name}" if len(found) > 1 else name
    return replace(found[name], note="; ".join(filter(None, (note, found[name].note))))


def observed_orders(h: Sequence[float], errors: Sequence[float]) -> list[float]:
    """Order between each pair of neighbours: log(e_i / e_{i+1}) / log(h_i / h_{i+1})."""
    steps, e = np.asarray(h, float), np.asarray(errors, float)
    return list(np.log(e[:-1] / e[1:]) / np.log(steps[:-1] / steps[1:]))


def order(
    h: Sequence[float],
    errors: Sequence[float],
    expected: float,
    *,
    x: str,
    y: str,
    title: str,
    more: Sequence[Curve] = (),
) -> Measurement:
    """Observed order of the finest pair against the expected one, with a plot; the error is their difference.

    Parameters
    ----------
    h, errors : From coarse to fine, at least three.
    x, y, title : Labels of the plot.
    more : Further curves for the plot.
    """
    if len(h) < 3:
        raise ValueError("an order needs three sizes or more")
    orders = observed_orders(h, errors)
    plot = Plot(title, x, y, (Curve("computed", tuple(map(float, h)), tuple(map(float, errors))), *more), (expected,))
    note = "orders " + ", ".join(f"{one:.3f}" for one in orders) + f"; finest error {errors[-1]:.3g}"
    return Measurement(float(orders[-1]), expected, abs(float(orders[-1]) - expected), note, (plot,))
