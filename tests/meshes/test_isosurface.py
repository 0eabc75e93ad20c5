# SPDX-License-Identifier: BSD-3-Clause
"""Isosurfacing by marching tetrahedra.

1. A sphere comes out as a closed 2-manifold of the right genus, outward, its vertices on the sphere to rounding, its
   area and volume converging with order 2.
2. A torus has genus 1; two spheres are two components; a kinked union is closed as well.
3. Without smoothing the topology is the same; with it no triangle is thin.
4. A function that leaves the box, has no zero, or asks for too fine a lattice is refused.
5. The number of triangles is known before they are made; zeros at lattice nodes leave no triangle without area.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.errors import MeshError
from meshes.isosurface import isosurface, sampled
from meshes.types import TriMesh

BOX = ((-1.1, -1.1, -1.1), (1.1, 1.1, 1.1))


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - 0.8


def torus(points: np.ndarray) -> np.ndarray:
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.7, points[:, 2]) - 0.25


def two(points: np.ndarray) -> np.ndarray:
    return np.minimum(*(np.linalg.norm(points - [x, 0.1, 0.0], axis=1) - 0.4 for x in (-0.5, 0.5)))


def kinked(points: np.ndarray) -> np.ndarray:
    return np.minimum(ball(points), np.abs(points).max(axis=1) - 0.65)


def euler(surface: TriMesh) -> int:
    """Euler number, after asserting that every edge runs once in each direction."""
    directed = surface.cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    forward = np.sort(directed[:, 0] * len(surface.points) + directed[:, 1])
    backward = np.sort(directed[:, 1] * len(surface.points) + directed[:, 0])
    assert (np.diff(forward) > 0).all(), "an edge runs twice in one direction"
    np.testing.assert_array_equal(forward, backward)
    return len(surface.points) - len(directed) // 2 + len(surface.cells)


def smallest_angle(surface: TriMesh) -> float:
    corners = surface.points[surface.cells]
    angles = []
    for k in range(3):
        u, v = (corners[:, (k + m) % 3] - corners[:, k] for m in (1, 2))
        cosine = np.einsum("ij,ij->i", u, v) / (np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1))
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return float(np.min(angles))


def area(surface: TriMesh) -> float:
    a, b, c = (surface.points[surface.cells[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_sphere_converges_with_order_two():
    volumes, areas = [], []
    for spacing in (0.2, 0.1, 0.05):
        surface = isosurface(ball, *BOX, spacing)
        assert euler(surface) == 2
        np.testing.assert_allclose(np.linalg.norm(surface.points, axis=1), 0.8, atol=1e-9)
        volumes.append(1 - surface.enclosed_volume / (4 / 3 * np.pi * 0.8**3))
        areas.append(1 - area(surface) / (4 * np.pi * 0.8**2))
    for errors in (volumes, areas):
        assert min(errors) > 0.0
        np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.25)
        assert errors[-1] < 2e-3


@pytest.mark.parametrize(("shape", "number"), [(torus, 0), (two, 4), (kinked, 2)])
def test_topology(shape, number):
    assert euler(isosurface(shape, *BOX, 0.07)) == number


@pytest.mark.parametrize("shape", [ball, torus, two])
def test_smoothing_keeps_topology_and_removes_thin_triangles(shape):
    rough, smooth = isosurface(shape, *BOX, 0.08, smoothing=0), isosurface(shape, *BOX, 0.08)
    np.testing.assert_array_equal(rough.cells, smooth.cells)
    assert np.abs(shape(rough.points)).max() < 1e-8
    assert np.abs(shape(smooth.points)).max() < 1e-6
    assert smallest_angle(smooth) > 15.0 > smallest_angle(rough)


def test_result_is_reproducible():
    assert isosurface(torus, *BOX, 0.1).content_hash == isosurface(torus, *BOX, 0.1).content_hash


def test_refusals():
    with pytest.raises(MeshError, match="leaves the box"):
        isosurface(lambda p: p[:, 0], *BOX, 0.2)
    with pytest.raises(MeshError, match="no zero in the box"):
        isosurface(lambda p: np.ones(len(p)), *BOX, 0.2)
    with pytest.raises(MeshError, match="too fine"):
        isosurface(ball, *BOX, 1e-4)


@pytest.mark.parametrize("shape", [torus, two, kinked])
def test_number_of_triangles_is_known(shape):
    found = sampled(shape, *BOX, 0.1)
    assert found.triangles == len(found.surface(smoothing=0).cells) == len(isosurface(shape, *BOX, 0.1).cells)


def test_zeros_at_nodes():
    # Just negative inside a box: the zero of every cut edge is at its inner node, and many edges meet there.
    slab = isosurface(
        lambda p: np.maximum(np.abs(p) - [0.6, 0.5, 0.4], 0.0).max(axis=1) - 1e-300, *BOX, 0.1, smoothing=0
    )
    assert euler(slab) == 2
    corners = slab.points[slab.cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(normals, axis=1).min() > 0.0
