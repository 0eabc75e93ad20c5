# SPDX-License-Identifier: BSD-3-Clause
"""The arithmetic of the element passes on one tile: rows of lanes in, rows of lanes out.

Each function is one loop over the lanes without a gather or a scatter, so that it becomes vector code; nothing in it
converts a float32 to float64. `points` and `direction` hold the twelve coordinates of the four vertices, `affine` the
displacement gradient that has been taken off the points of the whole block, nine values, and `rest` the rest
quantities of the tile (`femgal.kernels.cpu.tiles`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.simd import W
from femgal.materials.displacement_form import (
    add_identity,
    energy_along,
    energy_and_volume,
    node_terms,
    stress_and_cofactor,
    stress_increment,
)
from femgal.materials.stable_neo_hookean import stress_increment_definite
from femgal.materials.tensor import Tensor, Vector, add, apply, multiply
from meshes.jit import scalar

Reals = NDArray[np.floating]


@scalar
def _tensor(tile: Reals, at: int) -> Tensor:
    """Nine rows of one lane; of a tile's rest quantities Dm^-1, whose rows are grad N_1, grad N_2, grad N_3."""
    return (
        tile[at],
        tile[W + at],
        tile[2 * W + at],
        tile[3 * W + at],
        tile[4 * W + at],
        tile[5 * W + at],
        tile[6 * W + at],
        tile[7 * W + at],
        tile[8 * W + at],
    )


@scalar
def _gradient(tile: Reals, l: int, B: Tensor) -> Tensor:  # noqa: E741
    """sum_k d_k (x) grad N_k of lane l."""
    x, y, z = tile[l], tile[W + l], tile[2 * W + l]
    edges = (
        tile[3 * W + l] - x,
        tile[6 * W + l] - x,
        tile[9 * W + l] - x,
        tile[4 * W + l] - y,
        tile[7 * W + l] - y,
        tile[10 * W + l] - y,
        tile[5 * W + l] - z,
        tile[8 * W + l] - z,
        tile[11 * W + l] - z,
    )
    return multiply(edges, B)


@scalar
def _block_gradient(affine: Reals) -> Tensor:
    """The affine part that all lanes of a block share; read before the loop, so that it stays in registers."""
    return (
        affine[0],
        affine[1],
        affine[2],
        affine[3],
        affine[4],
        affine[5],
        affine[6],
        affine[7],
        affine[8],
    )


@scalar
def _displacement_gradient(tile: Reals, l: int, B: Tensor, A: Tensor) -> Tensor:  # noqa: E741
    """G = A + sum_k d_k (x) grad N_k of lane l; in float64, where A is zero, without the sum."""
    G = _gradient(tile, l, B)
    return add(A, G) if tile.itemsize == 4 else G


@scalar
def _store_vector(tile: Reals, at: int, v: Vector) -> None:
    tile[at], tile[W + at], tile[2 * W + at] = v[0], v[1], v[2]


@scalar
def _store_nine(tile: Reals, at: int, v: Vector) -> None:
    tile[at], tile[W + at], tile[2 * W + at] = v[0], v[1], v[2]
    tile[3 * W + at], tile[4 * W + at], tile[5 * W + at] = v[3], v[4], v[5]
    tile[6 * W + at], tile[7 * W + at], tile[8 * W + at] = v[6], v[7], v[8]


@scalar
def _corner_gradients(B: Tensor) -> tuple[Vector, Vector, Vector, Vector]:
    """grad N_0 to grad N_3."""
    u0 = (-(B[0] + B[3] + B[6]), -(B[1] + B[4] + B[7]), -(B[2] + B[5] + B[8]))
    return u0, (B[0], B[1], B[2]), (B[3], B[4], B[5]), (B[6], B[7], B[8])


@scalar
def _store_forces(tile: Reals, l: int, P: Tensor, B: Tensor) -> None:  # noqa: E741
    """Forces P grad N_k on the four vertices, which sum to zero."""
    _, u1, u2, u3 = _corner_gradients(B)
    f1, f2, f3 = apply(P, u1), apply(P, u2), apply(P, u3)
    f0 = (-(f1[0] + f2[0] + f3[0]), -(f1[1] + f2[1] + f3[1]), -(f1[2] + f2[2] + f3[2]))
    _store_vector(tile, l, f0)
    _store_vector(tile, 3 * W + l, f1)
    _store_vector(tile, 6 * W + l, f2)
    _store_vector(tile, 9 * W + l, f3)


@scalar
def tile_terms(points: Reals, affine: Reals, rest: Reals, terms: Reals) -> None:
    """Gradient and block of all four vertices of each lane: 36 rows from 12 rows of displacements."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        B, mu, lam = _tensor(rest, l), rest[9 * W + l], rest[10 * W + l]
        P, C = stress_and_cofactor(_displacement_gradient(points, l, B, A), mu, lam)
        u0, u1, u2, u3 = _corner_gradients(B)
        _store_nine(terms, l, node_terms(P, C, mu, lam, u0))
        _store_nine(terms, 9 * W + l, node_terms(P, C, mu, lam, u1))
        _store_nine(terms, 18 * W + l, node_terms(P, C, mu, lam, u2))
        _store_nine(terms, 27 * W + l, node_terms(P, C, mu, lam, u3))


@scalar
def tile_forces(points: Reals, affine: Reals, rest: Reals, forces: Reals) -> None:
    """Gradient of all four vertices of each lane: 12 rows."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        B, mu, lam = _tensor(rest, l), rest[9 * W + l], rest[10 * W + l]
        P, _ = stress_and_cofactor(_displacement_gradient(points, l, B, A), mu, lam)
        _store_forces(forces, l, P, B)


@scalar
def tile_products(points: Reals, affine: Reals, direction: Reals, rest: Reals, forces: Reals) -> None:
    """Hessian times a direction, of all four vertices of each lane: 12 rows."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        B, mu, lam = _tensor(rest, l), rest[9 * W + l], rest[10 * W + l]
        P = stress_increment(_displacement_gradient(points, l, B, A), _gradient(direction, l, B), mu, lam)
        _store_forces(forces, l, P, B)


@scalar
def tile_definite_products(points: Reals, affine: Reals, direction: Reals, rest: Reals, forces: Reals) -> None:
    """The same with the positive semi-definite part of each element's Hessian."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        B, mu, lam = _tensor(rest, l), rest[9 * W + l], rest[10 * W + l]
        F = add_identity(_displacement_gradient(points, l, B, A))
        _store_forces(forces, l, stress_increment_definite(F, _gradient(direction, l, B), mu, lam), B)


@scalar
def tile_stresses(points: Reals, affine: Reals, rest: Reals, tensors: Reals) -> None:
    """P and C of each lane: 18 rows."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        P, C = stress_and_cofactor(
            _displacement_gradient(points, l, _tensor(rest, l), A), rest[9 * W + l], rest[10 * W + l]
        )
        _store_nine(tensors, l, P)
        _store_nine(tensors, 9 * W + l, C)


@scalar
def tile_stress_increments(points: Reals, affine: Reals, direction: Reals, rest: Reals, tensors: Reals) -> None:
    """dP of each lane: 9 rows."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        B, mu, lam = _tensor(rest, l), rest[9 * W + l], rest[10 * W + l]
        _store_nine(
            tensors, l, stress_increment(_displacement_gradient(points, l, B, A), _gradient(direction, l, B), mu, lam)
        )


@scalar
def tile_pair_terms(tensors: Reals, u: Reals, rest: Reals, terms: Reals) -> None:
    """Gradient and block of one node of each lane: 9 rows."""
    for l in range(W):  # noqa: E741
        P, C = _tensor(tensors, l), _tensor(tensors, 9 * W + l)
        _store_nine(terms, l, node_terms(P, C, rest[9 * W + l], rest[10 * W + l], (u[l], u[W + l], u[2 * W + l])))


@scalar
def tile_pair_forces(tensors: Reals, u: Reals, forces: Reals) -> None:
    """Gradient of one node of each lane: 3 rows."""
    for l in range(W):  # noqa: E741
        _store_vector(forces, l, apply(_tensor(tensors, l), (u[l], u[W + l], u[2 * W + l])))


@scalar
def tile_energies(points: Reals, affine: Reals, rest: Reals, out: Reals) -> None:
    """Energy and J - 1 of each lane: 2 rows."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        energy, j = energy_and_volume(
            _displacement_gradient(points, l, _tensor(rest, l), A), rest[9 * W + l], rest[10 * W + l]
        )
        out[l], out[W + l] = energy, j


@scalar
def tile_energies_along(points: Reals, affine: Reals, direction: Reals, rest: Reals, sums: Reals) -> None:
    """Add the six coefficients of each lane to 6 rows."""
    A = _block_gradient(affine)
    for l in range(W):  # noqa: E741
        B = _tensor(rest, l)
        G, dG = _displacement_gradient(points, l, B, A), _gradient(direction, l, B)
        p = energy_along(G, dG, rest[9 * W + l], rest[10 * W + l])
        sums[l] += p[0]
        sums[W + l] += p[1]
        sums[2 * W + l] += p[2]
        sums[3 * W + l] += p[3]
        sums[4 * W + l] += p[4]
        sums[5 * W + l] += p[5]
