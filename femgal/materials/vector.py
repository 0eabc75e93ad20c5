# SPDX-License-Identifier: BSD-3-Clause
"""Algebra of vectors of three scalars, beside that of tensors; inlined likewise."""

from __future__ import annotations

from math import sqrt
from typing import Any

from femgal.materials.tensor import Vector, like
from meshes.jit import scalar


@scalar
def dot(u: Vector, v: Vector) -> Any:
    """Scalar product u . v."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@scalar
def cross(u: Vector, v: Vector) -> Vector:
    """Vector product u x v."""
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@scalar
def add_scaled(u: Vector, a: Any, v: Vector) -> Vector:
    """u + a v."""
    return (u[0] + a * v[0], u[1] + a * v[1], u[2] + a * v[2])


@scalar
def negative(u: Vector) -> Vector:
    """-u."""
    return (-u[0], -u[1], -u[2])


@scalar
def unit(u: Vector) -> Vector:
    """u / |u|, for u that is not zero."""
    a = like(u[0], 1) / sqrt(dot(u, u))
    return (a * u[0], a * u[1], a * u[2])


@scalar
def normal(u: Vector) -> Vector:
    """A vector orthogonal to u and at least |u| / sqrt(2) long: u x an axis."""
    return select(abs(u[0]) > abs(u[1]), (-u[2], like(u[0], 0), u[0]), (like(u[0], 0), u[2], -u[1]))


@scalar
def select(condition: Any, u: Vector, v: Vector) -> Vector:
    """Return u where the condition holds and v elsewhere; both are computed, so that no branch stops vectorisation."""
    return (u[0] if condition else v[0], u[1] if condition else v[1], u[2] if condition else v[2])
