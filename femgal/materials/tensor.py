# SPDX-License-Identifier: BSD-3-Clause
"""3x3 tensor algebra on tuples of scalars.

A tensor is a tuple of nine scalars in row-major order, a vector a tuple of three. The functions are inlined into the
kernel that calls them, so a tuple lives in registers and no array is made.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from meshes.jit import scalar

# A tuple of scalars; Numba infers the length and the precision.
Vector = tuple[Any, ...]
Tensor = tuple[Any, ...]


def like(x: Any, c: float) -> Any:
    """Return the literal c in the precision of x: a bare literal would lift a float32 formula to float64."""
    return type(x)(c)


# Numba compares this signature with the lambdas', annotations included, so there are none.
@overload(like, inline="always")
def _like(x, c):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if x == types.float32:
        return lambda x, c: np.float32(c)
    return lambda x, c: np.float64(c)


@scalar
def cofactor(F: Tensor) -> Tensor:
    """C = cof F, columns [f1 x f2, f2 x f0, f0 x f1] for F with columns f0, f1, f2; C = dJ/dF."""
    return (
        F[4] * F[8] - F[5] * F[7],
        F[5] * F[6] - F[3] * F[8],
        F[3] * F[7] - F[4] * F[6],
        F[2] * F[7] - F[1] * F[8],
        F[0] * F[8] - F[2] * F[6],
        F[1] * F[6] - F[0] * F[7],
        F[1] * F[5] - F[2] * F[4],
        F[2] * F[3] - F[0] * F[5],
        F[0] * F[4] - F[1] * F[3],
    )


@scalar
def cofactor_increment(F: Tensor, G: Tensor) -> Tensor:
    """dC[G], the derivative of cof F along G; cof is quadratic, so it is the mixed product of F and G."""
    return (
        F[4] * G[8] + G[4] * F[8] - F[5] * G[7] - G[5] * F[7],
        F[5] * G[6] + G[5] * F[6] - F[3] * G[8] - G[3] * F[8],
        F[3] * G[7] + G[3] * F[7] - F[4] * G[6] - G[4] * F[6],
        F[2] * G[7] + G[2] * F[7] - F[1] * G[8] - G[1] * F[8],
        F[0] * G[8] + G[0] * F[8] - F[2] * G[6] - G[2] * F[6],
        F[1] * G[6] + G[1] * F[6] - F[0] * G[7] - G[0] * F[7],
        F[1] * G[5] + G[1] * F[5] - F[2] * G[4] - G[2] * F[4],
        F[2] * G[3] + G[2] * F[3] - F[0] * G[5] - G[0] * F[5],
        F[0] * G[4] + G[0] * F[4] - F[1] * G[3] - G[1] * F[3],
    )


@scalar
def determinant(F: Tensor, C: Tensor) -> Any:
    """J = det F by expansion along the first row, from C = cof F."""
    return F[0] * C[0] + F[1] * C[1] + F[2] * C[2]


@scalar
def contract(A: Tensor, B: Tensor) -> Any:
    """A : B."""
    return (
        (A[0] * B[0] + A[1] * B[1] + A[2] * B[2])
        + (A[3] * B[3] + A[4] * B[4] + A[5] * B[5])
        + (A[6] * B[6] + A[7] * B[7] + A[8] * B[8])
    )


@scalar
def apply(A: Tensor, u: Vector) -> Vector:
    """A u."""
    return (
        A[0] * u[0] + A[1] * u[1] + A[2] * u[2],
        A[3] * u[0] + A[4] * u[1] + A[5] * u[2],
        A[6] * u[0] + A[7] * u[1] + A[8] * u[2],
    )


@scalar
def add(A: Tensor, B: Tensor) -> Tensor:
    """A + B."""
    return (
        A[0] + B[0],
        A[1] + B[1],
        A[2] + B[2],
        A[3] + B[3],
        A[4] + B[4],
        A[5] + B[5],
        A[6] + B[6],
        A[7] + B[7],
        A[8] + B[8],
    )


@scalar
def combine(a: Any, A: Tensor, b: Any, B: Tensor) -> Tensor:
    """a A + b B."""
    return (
        a * A[0] + b * B[0],
        a * A[1] + b * B[1],
        a * A[2] + b * B[2],
        a * A[3] + b * B[3],
        a * A[4] + b * B[4],
        a * A[5] + b * B[5],
        a * A[6] + b * B[6],
        a * A[7] + b * B[7],
        a * A[8] + b * B[8],
    )


@scalar
def multiply(A: Tensor, B: Tensor) -> Tensor:
    """A B."""
    return (
        A[0] * B[0] + A[1] * B[3] + A[2] * B[6],
        A[0] * B[1] + A[1] * B[4] + A[2] * B[7],
        A[0] * B[2] + A[1] * B[5] + A[2] * B[8],
        A[3] * B[0] + A[4] * B[3] + A[5] * B[6],
        A[3] * B[1] + A[4] * B[4] + A[5] * B[7],
        A[3] * B[2] + A[4] * B[5] + A[5] * B[8],
        A[6] * B[0] + A[7] * B[3] + A[8] * B[6],
        A[6] * B[1] + A[7] * B[4] + A[8] * B[7],
        A[6] * B[2] + A[7] * B[5] + A[8] * B[8],
    )


@scalar
def transpose(A: Tensor) -> Tensor:
    """A^T."""
    return (A[0], A[3], A[6], A[1], A[4], A[7], A[2], A[5], A[8])
