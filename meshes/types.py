# SPDX-License-Identifier: BSD-3-Clause
"""Tetrahedral and triangle meshes as small validated types."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshes.errors import MeshError

Points = NDArray[np.float64]
Cells = NDArray[np.int32]


@dataclass(frozen=True)
class Origin:
    """Where a mesh comes from; written to the log and to ``run.json``.

    Parameters
    ----------
    name : str
        Catalogue name, generator or file name.
    source : str
        "procedural", or the path or address that the data was read from.
    sha256 : str
        Digest of the source file; empty for procedural meshes.
    terms : str
        Credit and terms of use of the data.
    """

    name: str = "array"
    source: str = "procedural"
    sha256: str = ""
    terms: str = ""


@dataclass(frozen=True, eq=False)
class _Mesh:
    points: Points
    cells: Cells
    origin: Origin = field(default_factory=Origin)

    _width = 0
    _cell = ""

    def __post_init__(self) -> None:
        where = self.origin.source if self.origin.source != "procedural" else self.origin.name
        object.__setattr__(self, "points", checked_points(self.points, where))
        object.__setattr__(self, "cells", checked_cells(self.cells, len(self.points), self._width, self._cell, where))
        _refuse_unused(self.cells, len(self.points), where)

    @property
    def content_hash(self) -> str:
        """SHA-256 over all arrays: two meshes with one hash are the same mesh, whatever their origin."""
        digest = hashlib.sha256()
        for array in self._arrays():
            digest.update(array.tobytes())
        return digest.hexdigest()

    def _arrays(self) -> tuple[NDArray, ...]:
        return self.points, self.cells.astype(np.int64)

    def moved(self, points: ArrayLike) -> Self:
        """Return the same mesh at other vertex positions [m], shape [n_vertices, 3]."""
        return replace(self, points=np.asarray(points, np.float64))


@dataclass(frozen=True, eq=False)
class TriMesh(_Mesh):
    """A triangle surface.

    Parameters
    ----------
    points : Vertex positions [m], shape [n_vertices, 3], float64.
    cells : Vertex indices of each triangle, shape [n_triangles, 3], int32; counter-clockwise seen from outside.

    Raises
    ------
    MeshError
        Empty, wrong shape, NaN, index out of range, or vertices that no triangle uses.
    """

    _width = 3
    _cell = "triangle"

    @cached_property
    def enclosed_volume(self) -> float:
        """Signed volume [m^3] enclosed by a closed, outward-oriented surface (divergence theorem)."""
        a, b, c = (self.points[self.cells[:, k]] for k in range(3))
        return float(_triple_product(a.T, b.T, c.T).sum() / 6.0)


@dataclass(frozen=True, eq=False)
class TetMesh(_Mesh):
    """A tetrahedral mesh with positively oriented cells.

    Parameters
    ----------
    points : Vertex positions [m], shape [n_vertices, 3], float64.
    cells : Vertex indices of each tetrahedron, shape [n_tets, 4], int32; (b-a) x (c-a) . (d-a) > 0.
    regions : Region id of each tetrahedron, shape [n_tets], int32; all zero when not given.

    Raises
    ------
    MeshError
        Empty, wrong shape, NaN, index out of range, unused vertices, region ids that are not one int32 per
        tetrahedron, zero or negative volume.
    """

    regions: NDArray[np.int32] = None  # type: ignore[assignment]

    _width = 4
    _cell = "tetrahedron"

    def __post_init__(self) -> None:
        super().__post_init__()
        where = self.origin.source if self.origin.source != "procedural" else self.origin.name
        regions = np.zeros(len(self.cells), np.int32) if self.regions is None else self.regions
        object.__setattr__(self, "regions", checked_regions(regions, len(self.cells), where))
        volumes = signed_volumes(self.points, self.cells)
        bad = np.flatnonzero(volumes <= 0.0)
        if len(bad):
            raise MeshError(
                f"{len(bad)} tetrahedra have no positive volume",
                where=where,
                found=f"volume {volumes[bad[0]]:.3g} m^3 in tetrahedron {bad[0]}",
                allowed="volume > 0, (b-a) x (c-a) . (d-a) > 0",
                advice="repair the winding or remove the degenerate cells",
            )

    def _arrays(self) -> tuple[NDArray, ...]:
        return *super()._arrays(), self.regions

    @property
    def volumes(self) -> NDArray[np.float64]:
        """Volume of each tetrahedron [m^3], shape [n_tets]."""
        return signed_volumes(self.points, self.cells)


def signed_volumes(points: Points, cells: NDArray) -> NDArray[np.float64]:
    """Signed volume (b-a) x (c-a) . (d-a) / 6 of each tetrahedron [m^3], shape [n_tets]."""
    volumes = np.empty(len(cells))
    # In pieces that stay in the cache: the temporaries of millions of cells would cost a gigabyte.
    for start in range(0, len(cells), _PIECE):
        piece = cells[start : start + _PIECE]
        a = points[piece[:, 0]]
        b, c, d = (points[piece[:, k]] - a for k in (1, 2, 3))
        volumes[start : start + _PIECE] = _triple_product(b.T, c.T, d.T) / 6.0
    return volumes


_PIECE = 16384


def _triple_product(b: NDArray, c: NDArray, d: NDArray) -> NDArray[np.float64]:
    """(b x c) . d for vectors in the columns of [3, n] arrays."""
    return (b[1] * c[2] - b[2] * c[1]) * d[0] + (b[2] * c[0] - b[0] * c[2]) * d[1] + (b[0] * c[1] - b[1] * c[0]) * d[2]


def checked_points(points: ArrayLike, where: str) -> Points:
    """Return finite positions in space, shape [n_vertices, 3], float64.

    Raises
    ------
    MeshError
        Not numbers, no points, another number of coordinates, NaN or infinity.
    """
    array = _numbers(points, "vertex positions", where)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        found = f"{len(array)} points of {array.shape[1]} coordinates" if array.ndim == 2 else f"shape {array.shape}"
        allowed = "1 point or more, of 3 coordinates"
        raise MeshError("the vertices are not points in space", where=where, found=found, allowed=allowed)
    array = np.ascontiguousarray(array, np.float64)
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise MeshError(
            f"{len(bad)} vertex positions are not finite",
            where=where,
            found=f"{array[bad[0]].tolist()} at vertex {bad[0]}",
            allowed="finite numbers [m]",
        )
    return array


def checked_cells(cells: ArrayLike, n_points: int, width: int, cell: str, where: str) -> Cells:
    """Return vertex indices within 0 to ``n_points - 1``, shape [n_cells, width], int32.

    Raises
    ------
    MeshError
        Not integers, no cells, another number of vertices per cell, or an index out of range; the message shows the
        first such cell.
    """
    array = _numbers(cells, f"{cell} indices", where)
    if array.ndim != 2 or array.shape[1] != width or len(array) == 0:
        raise MeshError(f"no usable {cell} list", where=where, found=array.shape, allowed=f"(n > 0, {width})")
    if array.dtype.kind not in "iu":
        raise MeshError(f"{cell} indices are not integers", where=where, found=array.dtype, allowed="int32 or int64")
    if int(array.min()) < 0 or int(array.max()) >= n_points:
        rows = np.flatnonzero((array < 0).any(axis=1) | (array >= n_points).any(axis=1))
        raise MeshError(
            f"{cell} {rows[0]} refers to a vertex that does not exist ({len(rows)} such)",
            where=where,
            found=array[rows[0]].tolist(),
            allowed=f"indices 0 to {n_points - 1}",
        )
    return np.ascontiguousarray(array, np.int32)


def checked_regions(regions: ArrayLike, n_cells: int, where: str) -> NDArray[np.int32]:
    """Return one whole number per cell, shape [n_cells], int32; 2.0 counts as whole, 2.5 is refused.

    Raises
    ------
    MeshError
        Another shape, or values that int32 cannot hold exactly.
    """
    array = _numbers(regions, "region ids", where)
    if array.shape != (n_cells,):
        raise MeshError("region ids do not match the cells", where=where, found=array.shape, allowed=(n_cells,))
    with np.errstate(invalid="ignore"):  # NaN and what is out of range differ from what they become
        whole = array.astype(np.int32)
    bad = np.flatnonzero(whole != array)
    if len(bad):
        raise MeshError(
            f"{len(bad)} region ids are not whole numbers of 32 bits",
            where=where,
            found=f"{array[bad[0]]} in cell {bad[0]}",
            allowed=f"integers, -{2**31} to {2**31 - 1}",
        )
    return np.ascontiguousarray(whole)


def _numbers(values: ArrayLike, what: str, where: str) -> NDArray:
    """Array of real numbers; lists of unequal length, text and complex numbers are refused."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise MeshError(
            f"{what} are not a table", where=where, found=str(error), allowed="rows of one length"
        ) from error
    if array.dtype.kind not in "biuf":
        raise MeshError(f"{what} are not numbers", where=where, found=array.dtype, allowed="real numbers")
    return array


def _refuse_unused(cells: Cells, n_points: int, where: str) -> None:
    used = np.zeros(n_points, bool)
    used[cells] = True
    unused = n_points - int(used.sum())
    if unused:
        raise MeshError(
            f"{unused} of {n_points} vertices belong to no cell",
            where=where,
            found=f"vertex {int(np.flatnonzero(~used)[0])}",
            allowed="every vertex in at least one cell",
            advice="drop them and renumber; the file readers do so",
        )
