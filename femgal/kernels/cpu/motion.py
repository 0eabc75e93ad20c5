# SPDX-License-Identifier: BSD-3-Clause
"""The vector work of an explicit step, fused: each array is read or written once. Always in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel

Floats = NDArray[np.float64]


@kernel
def kick_drift(
    start: int, stop: int, x: Floats, v: Floats, a: Floats, h: float, decay: float, x_out: Floats, v_out: Floats
) -> None:
    """v_out = decay v + h/2 a and x_out = x + h v_out, entry by entry; all arrays flat, shape [3 n]."""
    half = 0.5 * h
    for i in range(start, stop):
        kicked = decay * v[i] + half * a[i]
        v_out[i] = kicked
        x_out[i] = x[i] + h * kicked


@kernel
def accelerate_kick(
    start: int,
    stop: int,
    mass: Floats,
    free: NDArray[np.bool_],
    gravity: Floats,
    h: float,
    growth: float,
    g: Floats,
    v: Floats,
) -> None:
    """In place g becomes a = gravity - g / mass, zero where a vertex is not free, and v becomes growth (v + h/2 a).

    Parameters
    ----------
    mass, free : Of each vertex, shape [n].
    gravity : [m/s^2], shape [3].
    growth : 1 / (1 + alpha h / 2).
    g, v : Elastic gradient [N] and velocity [m/s], shape [n, 3].
    """
    half = 0.5 * h
    for i in range(start, stop):
        moves = 1.0 if free[i] else 0.0
        scale = moves / mass[i]
        for c in range(3):
            a = moves * gravity[c] - scale * g[i, c]
            g[i, c] = a
            v[i, c] = growth * (v[i, c] + half * a)
