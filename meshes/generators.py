# SPDX-License-Identifier: BSD-3-Clause
"""Meshes from numbers alone: box, beam and cube on a Kuhn-split grid, and the solid sphere."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError, MeshError
from meshes.types import Cells, Origin, Points, TetMesh, TriMesh

_SEED = 20250731
# Below this the edge matrix of a Kuhn tetrahedron stays strictly diagonally dominant, see `box`.
MAX_JITTER = 1.0 / 6.0
_MAX_VERTICES = 200_000_000


def box(
    size: tuple[float, float, float] = (1.0, 1.0, 1.0),
    cells: tuple[int, int, int] = (4, 4, 4),
    *,
    vertices: int | None = None,
    jitter: float = 0.0,
    seed: int = _SEED,
    name: str = "box",
) -> TetMesh:
    """Box from the origin to ``size``, every grid cell split into the six tetrahedra around its diagonal (Kuhn).

    Parameters
    ----------
    size : Extents [m], all positive.
    cells : Grid cells along each axis, all at least 1; replaced when ``vertices`` is given.
    vertices : Wanted number of vertices: the most cubic grid whose count comes closest. Counts of grids lie
        apart, so the difference is within 5% from about 500 vertices upwards for boxes of modest proportions.
    jitter : Largest random displacement of an inner vertex along each axis, as a share of the cell, in [0, 1/6).
        Along the path of a Kuhn tetrahedron the three edges in units of the cell are the identity plus entries of at
        most 2 jitter: strictly diagonally dominant below 1/6, so all volumes stay positive.
    seed : Seed of the jitter.

    Raises
    ------
    InputError
        A size, count or jitter outside its range.
    """
    extents = _checked_size(size)
    shape = _checked_cells(cells) if vertices is None else cells_for(extents, vertices)
    if not 0.0 <= jitter < MAX_JITTER:
        raise InputError("jitter would turn tetrahedra over", where=name, found=jitter, allowed="0 <= jitter < 1/6")
    nodes = np.array(shape) + 1
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in nodes), indexing="ij"), axis=-1).reshape(-1, 3)
    unit = grid.astype(np.float64)
    inner = ((grid > 0) & (grid < nodes - 1)).all(axis=1)
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, (int(inner.sum()), 3))
    unit[inner] += noise
    return TetMesh(unit * (extents / np.array(shape)), _kuhn_cells(shape), Origin(name))


def beam(
    cells: tuple[int, int, int] = (15, 5, 5),
    size: tuple[float, float, float] = (3.0, 1.0, 1.0),
    *,
    vertices: int | None = None,
    jitter: float = 0.0,
    seed: int = _SEED,
) -> TetMesh:
    """Beam along x, three times as long as thick, of 15 x 5 x 5 grid cells; parameters as in `box`."""
    return box(size, cells, vertices=vertices, jitter=jitter, seed=seed, name="beam")


def cube(vertices: int = 4913, *, jitter: float = 0.0, seed: int = _SEED) -> TetMesh:
    """Unit cube [0, 1]^3 with about ``vertices`` vertices: equal numbers of cells, or one more along an axis."""
    return box(vertices=vertices, jitter=jitter, seed=seed, name="cube")


def sphere(vertices: int = 5000, *, radius: float = 0.5) -> TetMesh:
    """Solid sphere around the origin with ``vertices`` vertices within 5%, by isosurface stuffing of an icosphere.

    Raises
    ------
    MeshError
        Fewer vertices than the stuffing can make a ball of.
    """
    from meshes.stuffing.tetrahedralise import tetrahedralise

    # Surface triangles at most half as wide as the lattice, so that facets do not show.
    level = int(np.clip(np.ceil(np.log(max(vertices, 10) ** (2.0 / 3.0)) / np.log(4.0)), 2, 8))
    mesh, _ = tetrahedralise(icosphere(level, radius=radius), vertices)
    return TetMesh(mesh.points, mesh.cells, Origin("sphere"))


def icosphere(level: int = 3, *, radius: float = 0.5) -> TriMesh:
    """Sphere surface: an icosahedron subdivided ``level`` times, 20 * 4^level triangles, outward.

    Raises
    ------
    InputError
        ``level`` outside 0 to 9.
    """
    if not 0 <= level <= 9:
        raise InputError("too many or few subdivisions", where="icosphere", found=level, allowed="0 to 9")
    points, cells = _icosahedron()
    for _ in range(level):
        points, cells = _subdivided(points, cells)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return TriMesh(radius * points, cells, Origin("icosphere"))


def cells_for(size: NDArray[np.float64], vertices: int) -> tuple[int, int, int]:
    """Grid cells along each axis whose (nx+1)(ny+1)(nz+1) comes closest to a vertex count, cells near cubic.

    Parameters
    ----------
    size : Extents of the box, shape [3].

    Raises
    ------
    InputError
        Fewer than 8 vertices or more than 200 million.
    """
    if not 8 <= vertices <= _MAX_VERTICES:
        raise InputError("impossible vertex count", where="box", found=vertices, allowed=f"8 to {_MAX_VERTICES}")
    low, high = 0.0, float(vertices) / size.min()
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.prod(size * middle + 1.0) < vertices else (low, middle)
    ideal = size * low
    candidates = product(*({max(int(np.floor(n)) + k, 1) for k in (-1, 0, 1, 2)} for n in ideal))

    def distance(shape: tuple[int, ...]) -> tuple[float, float]:
        count = float(np.prod(np.array(shape) + 1.0))
        spacing = size / np.array(shape)
        # A percent of the count is worth a percent of aspect ratio.
        return abs(count / vertices - 1.0) + 0.1 * float(np.log(spacing.max() / spacing.min())), spacing.max()

    best = min(candidates, key=distance)
    return best[0], best[1], best[2]


def _kuhn_cells(shape: tuple[int, int, int]) -> Cells:
    nx, ny, nz = shape
    strides = np.array([(ny + 1) * (nz + 1), nz + 1, 1])
    corners = (np.arange(nx)[:, None, None] * strides[0] + np.arange(ny)[:, None] * strides[1] + np.arange(nz)).ravel()
    if (nx + 1) * (ny + 1) * (nz + 1) > np.iinfo(np.int32).max:
        raise MeshError("too many vertices for 32-bit indices", where="box", found=shape)
    tets = np.empty((len(corners), 6, 4), np.int32)
    for k, path in enumerate(permutations(range(3))):
        steps = np.concatenate([[0], np.cumsum(strides[list(path)])])
        # An odd permutation walks a left-handed path: its last two vertices change places.
        odd = path in {(0, 2, 1), (1, 0, 2), (2, 1, 0)}
        tets[:, k] = corners[:, None] + (steps[[0, 1, 3, 2]] if odd else steps)
    return tets.reshape(-1, 4)


def _checked_size(size: tuple[float, float, float]) -> NDArray[np.float64]:
    extents = np.asarray(size, np.float64)
    if extents.shape != (3,) or not np.isfinite(extents).all() or (extents <= 0.0).any():
        raise InputError("not the size of a box", where="box", found=size, allowed="three lengths > 0 [m]")
    return extents


def _checked_cells(cells: tuple[int, int, int]) -> tuple[int, int, int]:
    if len(cells) != 3 or any(n != int(n) or n < 1 for n in cells):
        raise InputError("not a grid", where="box", found=cells, allowed="three whole numbers >= 1")
    return int(cells[0]), int(cells[1]), int(cells[2])


def _icosahedron() -> tuple[Points, NDArray[np.int32]]:
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-golden, golden)]
    points = np.array([p for a, b in signs for p in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))])
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 2.1
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    cells = np.array(faces, np.int32)
    inward = np.linalg.det(points[cells]) < 0.0
    cells[inward] = cells[inward][:, ::-1]
    return points / np.linalg.norm(points[0]), cells


def _subdivided(points: Points, cells: NDArray[np.int32]) -> tuple[Points, NDArray[np.int32]]:
    """Split every triangle into four at the midpoints of its edges."""
    edges = np.sort(cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middles = points[unique].mean(axis=1)
    ab, bc, ca = (inverse.reshape(-1, 3) + len(points)).T
    a, b, c = cells.T
    parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    split = np.concatenate([np.stack(part, axis=1) for part in parts])
    return np.concatenate([points, middles]), split.astype(np.int32)
