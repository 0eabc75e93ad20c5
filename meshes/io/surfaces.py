# SPDX-License-Identifier: BSD-3-Clause
"""Read and write triangle surfaces."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError, MeshError
from meshes.io.meshio_reader import FORMATS, read_with_meshio
from meshes.io.obj import read_obj, write_obj
from meshes.io.ply import read_ply, write_ply
from meshes.io.raw import RawMesh
from meshes.io.repair import drop_unused
from meshes.io.source import file_origin, readable, writable
from meshes.io.stl import read_stl, write_stl
from meshes.types import TriMesh, checked_cells, checked_points

_READERS = {".ply": read_ply, ".obj": read_obj, ".stl": read_stl}
_WRITERS = {".ply": write_ply, ".obj": write_obj, ".stl": write_stl}
# Formats that hold nothing but surfaces.
SURFACE_SUFFIXES = (*_READERS, ".off")
_SHEETS = {"triangle", "quad", "polygon"}


def read_surface(path: str | Path) -> TriMesh:
    """Read a surface; quads and convex polygons are split into triangles, corners of STL triangles merged.

    Parameters
    ----------
    path : PLY, OBJ, STL, OFF, or a mesh format (vtk, vtu, msh ...) that holds only surface cells.

    Returns
    -------
    TriMesh
        Origin with path and SHA-256. Remarks of the reader go to the log ``meshes``.

    Raises
    ------
    MeshError
        Missing, empty, damaged or unknown file; no triangles; index out of range; NaN.
    """
    path = readable(path)
    suffix = path.suffix.lower()
    if suffix in _READERS:
        return surface_of(_READERS[suffix](path), path)
    if suffix in FORMATS:
        return surface_of(read_with_meshio(path), path)
    allowed = ", ".join((*SURFACE_SUFFIXES, ".vtk", ".vtu", ".msh", ".mesh"))
    raise MeshError("unknown surface format", where=str(path), found=suffix or "no suffix", allowed=allowed)


def surface_of(raw: RawMesh, path: Path) -> TriMesh:
    """Check what a file holds; see `read_surface`."""
    where = str(path)
    others = set(raw.counts()) - _SHEETS - {"line", "vertex"}
    triangles = _triangles(raw)
    if others or len(triangles) == 0:
        raise MeshError("holds no surface", where=where, found=raw.summary(), allowed="triangles, quads or polygons")
    points = checked_points(raw.points, where)
    cells = checked_cells(triangles, len(points), 3, "triangle", where)
    points, cells, dropped = drop_unused(points, cells)
    for message in raw.messages + dropped:
        logging.getLogger("meshes").info("%s: %s", where, message)
    return TriMesh(points, cells, file_origin(path))


def write_surface(path: str | Path, mesh: TriMesh) -> None:
    """Write a surface as PLY (binary, float64), OBJ or STL (binary, float32).

    Raises
    ------
    InputError
        Unknown suffix, missing folder, or the file cannot be written.
    """
    path = writable(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(
            "surfaces cannot be written in this format",
            where=str(path),
            found=path.suffix or "no suffix",
            allowed=", ".join(_WRITERS),
        )
    try:
        writer(path, mesh)
    except OSError as error:
        raise InputError("cannot be written", where=str(path), found=error.strerror or str(error)) from error


def _triangles(raw: RawMesh) -> NDArray[np.int64]:
    """All faces as triangles: a polygon becomes a fan around its first vertex."""
    fans = [np.empty((0, 3), np.int64)]
    for kind, faces in raw.blocks:
        if kind in _SHEETS:
            fans.append(_fan(np.asarray(faces)))
    return np.concatenate(fans)


def _fan(faces: NDArray) -> NDArray[np.int64]:
    width = faces.shape[1]
    if width < 3:
        return np.empty((0, 3), np.int64)
    corners = [faces[:, [0, k, k + 1]] for k in range(1, width - 1)]
    return np.stack(corners, axis=1).reshape(-1, 3).astype(np.int64)
