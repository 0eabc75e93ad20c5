# SPDX-License-Identifier: BSD-3-Clause
"""Eigenvectors of symmetric 3x3 tensors and singular values of any 3x3 tensor, without a branch.

Jacobi rotations, their number fixed, and selects where a direction is arbitrary: a loop over elements around these
functions is vectorised, and every input gives a result (F = 0, rank 1 and 2, inverted, repeated singular values).
A symmetric tensor is the tuple xx xy xz yy yz zz.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from numba import types
from numba.extending import overload

from femgal.materials.tensor import Tensor, Vector, apply, like, transpose
from femgal.materials.vector import add_scaled, cross, dot, negative, normal, select, unit
from meshes.jit import scalar

Columns = tuple[Vector, Vector, Vector]


@scalar
def eigenvectors(A: Vector) -> tuple[Vector, Columns]:
    """Eigenvalues and eigenvectors of a symmetric tensor by cyclic Jacobi rotations.

    Parameters
    ----------
    A : xx xy xz yy yz zz, the largest of them neither above 1e12 nor, unless all are zero, below 1e-12: their squares
        are formed in the precision of A.

    Returns
    -------
    values : three scalars in no order.
    Q : three unit vectors that form a rotation; what is left of Q^T A Q off the diagonal is rounding.
    """
    zero, one = like(A[0], 0), like(A[0], 1)
    Q = (one, zero, zero), (zero, one, zero), (zero, zero, one)
    A, Q = _sweep(A, Q)
    A, Q = _sweep(A, Q)
    A, Q = _sweep(A, Q)
    A, Q = _refined(A, Q)
    return (A[0], A[3], A[5]), Q


@scalar
def singular_values(F: Tensor) -> tuple[Tensor, Vector, Tensor]:
    """F = U diag(s) V^T with rotations U and V: the last singular value carries the sign of det F.

    The eigenvectors of F^T F square the condition of F, so they are good for the largest singular value only. One
    rotation of the two other columns of F V makes those orthogonal to working precision, too.

    Returns
    -------
    U, s, V : s0 >= s1 >= |s2| up to rounding; U^T U - I and F - U diag(s) V^T are rounding (of 1 and of s0).
    """
    size = _largest(F) + like(F[0], 1e-30)
    G = _scaled(like(F[0], 1) / size, F)
    _, (u, v, w) = eigenvectors(_metric(G))
    a, b, c = apply(G, u), apply(G, v), apply(G, w)
    a, b, u, v = _longer_first(a, b, u, v)
    a, c, u, w = _longer_first(a, c, u, w)
    b, c, v, w = _longer_first(b, c, v, w)
    angle = _rotation(dot(b, b), dot(b, c), dot(c, c))
    b, c = _rotated(angle, b, c)
    v, w = _rotated(angle, v, w)
    p, q, r = _frame(a, b)
    return transpose(p + q + r), (size * dot(p, a), size * dot(q, b), size * dot(r, c)), transpose(u + v + w)


def _refined(A: Vector, Q: Columns) -> tuple[Vector, Columns]:
    """Convergence is quadratic: three sweeps leave 1e-7 at most, whatever A is, so only float64 needs the fourth."""
    return _sweep(A, Q)


@overload(_refined, inline="always")
def _refined_compiled(A, Q):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if A.dtype == types.float32:
        return lambda A, Q: (A, Q)
    return lambda A, Q: _sweep(A, Q)


@scalar
def _sweep(A: Vector, Q: Columns) -> tuple[Vector, Columns]:
    """Eliminate xy, yz and zx once each."""
    A, Q = _eliminate(A, Q)
    A, Q = _eliminate(A, Q)
    return _eliminate(A, Q)


@scalar
def _eliminate(A: Vector, Q: Columns) -> tuple[Vector, Columns]:
    """Rotate in the plane of the first two axes until xy = 0, then rename the axes from x y z to z x y."""
    xx, xy, xz, yy, yz, zz = A
    c, s, t = angle = _rotation(xx, xy, yy)
    x, y = _rotated(angle, Q[0], Q[1])
    xz, yz = _cleared(c * xz - s * yz), _cleared(s * xz + c * yz)
    return (yy + t * xy, yz, like(xx, 0), zz, xz, xx - t * xy), (y, Q[2], x)


@scalar
def _cleared(x: Any) -> Any:
    """Zero for what does not count beside 1: its square would be a denormal float32, a hundred times slower."""
    return x if abs(x) > like(x, 1e-18) else like(x, 0)


@scalar
def _rotation(xx: Any, xy: Any, yy: Any) -> Vector:
    """Cosine, sine and tangent of the smaller angle that makes [[xx, xy], [xy, yy]] diagonal (Golub & Van Loan 8.5)."""
    d, b = yy - xx, xy + xy
    # The last term keeps 0 / 0 away; where it counts the angle is arbitrary.
    t = (-b if d < like(xx, 0) else b) / (abs(d) + sqrt(d * d + b * b) + like(xx, 1e-30))
    c = like(xx, 1) / sqrt(like(xx, 1) + t * t)
    return c, t * c, t


@scalar
def _rotated(angle: Vector, p: Vector, q: Vector) -> tuple[Vector, Vector]:
    """c p - s q and s p + c q."""
    c, s = angle[0], angle[1]
    return (
        (c * p[0] - s * q[0], c * p[1] - s * q[1], c * p[2] - s * q[2]),
        (s * p[0] + c * q[0], s * p[1] + c * q[1], s * p[2] + c * q[2]),
    )


@scalar
def _longer_first(a: Vector, b: Vector, u: Vector, v: Vector) -> tuple[Vector, Vector, Vector, Vector]:
    """Swap both pairs where b is longer than a; one sign changes, so that determinants do not."""
    swap = dot(a, a) < dot(b, b)
    return select(swap, b, a), select(swap, negative(a), b), select(swap, v, u), select(swap, negative(u), v)


@scalar
def _frame(a: Vector, b: Vector) -> Columns:
    """Rotation whose first column points along a and whose second along b; any direction where they give none."""
    tiny = like(a[0], 1e-30)
    p = unit(select(dot(a, a) > tiny, a, (like(a[0], 1), like(a[0], 0), like(a[0], 0))))
    q = add_scaled(b, -dot(p, b), p)
    # b is orthogonal to a already, unless it is rounding and nothing else.
    genuine = dot(q, q) > like(a[0], 0.01) * dot(b, b) + tiny
    q = unit(select(genuine, q, normal(p)))
    return p, q, cross(p, q)


@scalar
def _metric(F: Tensor) -> Vector:
    """F^T F."""
    return (
        F[0] * F[0] + F[3] * F[3] + F[6] * F[6],
        F[0] * F[1] + F[3] * F[4] + F[6] * F[7],
        F[0] * F[2] + F[3] * F[5] + F[6] * F[8],
        F[1] * F[1] + F[4] * F[4] + F[7] * F[7],
        F[1] * F[2] + F[4] * F[5] + F[7] * F[8],
        F[2] * F[2] + F[5] * F[5] + F[8] * F[8],
    )


@scalar
def _scaled(a: Any, F: Tensor) -> Tensor:
    return (a * F[0], a * F[1], a * F[2], a * F[3], a * F[4], a * F[5], a * F[6], a * F[7], a * F[8])


@scalar
def _largest(F: Tensor) -> Any:
    """Largest absolute value of the entries."""
    row = _larger(_larger(F[0], F[1]), F[2]), _larger(_larger(F[3], F[4]), F[5]), _larger(_larger(F[6], F[7]), F[8])
    return _larger(_larger(row[0], row[1]), row[2])


@scalar
def _larger(a: Any, b: Any) -> Any:
    a, b = abs(a), abs(b)
    return a if a > b else b
