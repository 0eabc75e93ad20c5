# SPDX-License-Identifier: BSD-3-Clause
"""Preconditioned conjugate gradients (Hestenes & Stiefel 1952) that stop at negative curvature."""

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
class Solution:
    """What the iteration has come to.

    Parameters
    ----------
    d : Approximate solution of A d = b, shape [k, 3].
    iterations : Products with A.
    start : sqrt(b . M^-1 b), the norm of the residual at d = 0 [sqrt(J)].
    reduction : The same norm at the end over that at the start.
    curvature : False when some p . A p <= 0 was met; d is the iterate before it, still a direction of descent.
    """

    d: Floats
    iterations: int
    start: float
    reduction: float
    curvature: bool = True


def solve(
    backend: Backend, product: Map, precondition: Map, b: Floats, reduction: float, most_iterations: int
) -> Solution:
    """Solve A d = b from d = 0, until the residual has fallen to a share of what it was.

    The residual is measured by sqrt(r . M^-1 r), which costs nothing more. Where M is near A this is the error in the
    energy norm; it is what Newton's method gains by the step.

    Parameters
    ----------
    backend : Sums and updates of rows.
    product, precondition : p -> A p and r -> M^-1 r, both symmetric, rows of shape [k, 3].
    b : Right-hand side, shape [k, 3].
    reduction : Share at which to stop.
    most_iterations : At most this many products.
    """
    d, r = backend.zeros(len(b)), backend.copy(b)
    z = precondition(r)
    rz = first = backend.dot(r, z)
    p = z
    done = 0
    while done < most_iterations and rz > reduction**2 * first:
        Ap = product(p)
        done += 1
        curvature = backend.dot(p, Ap)
        if not curvature > 0.0:
            return Solution(d if done > 1 else z, done, math.sqrt(first), math.sqrt(rz / first), curvature=False)
        alpha = rz / curvature
        backend.add_scaled(d, alpha, p)
        backend.add_scaled(r, -alpha, Ap)
        z = precondition(r)
        before, rz = rz, backend.dot(r, z)
        backend.add_scaled(z, rz / before, p)
        p = z
    # In this order max hands on what is not a number.
    return Solution(d, done, math.sqrt(max(first, 0.0)), 0.0 if first == 0.0 else math.sqrt(max(rz / first, 0.0)))
