# SPDX-License-Identifier: BSD-3-Clause
"""Preconditioned conjugate gradients that stop at a relative residual, as linear algebra packages do."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend

Floats = NDArray[np.float64]

Map = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Where the iteration ended.

    Parameters
    ----------
    d : Approximate solution of A d = b, shape [k, 3].
    iterations : Iterations made.
    reduction : |b - A d| / |b|.
    definite : False when some p . A p or r . M^-1 r was not positive: A or M is not positive definite.
    """

    d: Floats
    iterations: int
    reduction: float
    definite: bool = True


def conjugate_gradients(
    backend: Backend, product: Map, precondition: Map, b: Floats, tolerance: float, most_iterations: int
) -> LinearSolution:
    """Solve A d = b from d = 0 until |b - A d| <= tolerance |b| (Saad 2003, Algorithm 9.1).

    Parameters
    ----------
    backend : Sums and updates of rows.
    product, precondition : p -> A p and r -> M^-1 r, both symmetric, rows of shape [k, 3].
    b : Right-hand side, shape [k, 3].
    """
    d, r = np.zeros_like(b), b.copy()
    first = left = math.sqrt(backend.dot(b, b))
    p, before, done = b, math.inf, 0
    while done < most_iterations and left > tolerance * first:
        z = precondition(r)
        rz = backend.dot(r, z)
        backend.add_scaled(z, rz / before if done else 0.0, p)
        p = z
        Ap = product(p)
        curvature = backend.dot(p, Ap)
        if not (rz > 0.0 and curvature > 0.0):
            return LinearSolution(d, done, left / first, definite=False)
        backend.add_scaled(d, rz / curvature, p)
        backend.add_scaled(r, -rz / curvature, Ap)
        before, left, done = rz, math.sqrt(backend.dot(r, r)), done + 1
    return LinearSolution(d, done, left / first if first > 0.0 else 0.0)
