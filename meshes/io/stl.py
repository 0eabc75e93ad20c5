# SPDX-License-Identifier: BSD-3-Clause
"""STL surfaces, ASCII and binary; equal corners are merged to shared vertices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.io.raw import RawMesh
from meshes.types import TriMesh

_HEADER, _FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path) -> RawMesh:
    """Read an STL file.

    Raises
    ------
    MeshError
        Neither a complete binary file nor ASCII facets.
    """
    data = path.read_bytes()
    if len(data) >= _HEADER:
        number = int(np.frombuffer(data, "<u4", 1, 80)[0])
        # A binary file may begin with "solid", so the size decides.
        if _HEADER + number * _FACET.itemsize == len(data):
            facets = np.frombuffer(data, _FACET, number, _HEADER)
            return _merged(facets["corners"].astype(np.float64).reshape(-1, 3))
    return _merged(_ascii_corners(data, path))


def write_stl(path: Path, mesh: TriMesh) -> None:
    """Write a binary STL file (float32 positions, no shared vertices)."""
    facets = np.zeros(len(mesh.cells), _FACET)
    corners = mesh.points[mesh.cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facets["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    facets["corners"] = corners
    with path.open("wb") as stream:
        stream.write(b"femgal".ljust(80, b" "))
        stream.write(np.array([len(facets)], "<u4").tobytes())
        stream.write(facets.tobytes())


def _ascii_corners(data: bytes, path: Path) -> NDArray[np.float64]:
    if not data.lstrip()[:5].lower() == b"solid":
        raise MeshError(
            "is neither a complete binary nor an ASCII STL file",
            where=str(path),
            found=f"{len(data)} bytes",
            allowed="84 + 50 bytes per triangle, or text that begins with 'solid'",
        )
    words = data.split()
    at = [k for k, word in enumerate(words) if word == b"vertex"]
    try:
        corners = np.array([[float(word) for word in words[k + 1 : k + 4]] for k in at]).reshape(-1, 3)
    except ValueError as error:
        raise MeshError("the STL text is damaged or cut off", where=str(path), found=str(error)[:80]) from error
    if len(corners) % 3 or not data.rstrip().lower().split(b"\n")[-1].startswith(b"endsolid"):
        raise MeshError("the STL text is cut off", where=str(path), found=f"{len(corners)} corners", allowed="3 each")
    return corners


def _merged(corners: NDArray[np.float64]) -> RawMesh:
    points, inverse = np.unique(corners, axis=0, return_inverse=True)
    triangles = inverse.reshape(-1, 3)
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    dropped = len(triangles) - int(proper.sum())
    messages = [f"dropped {dropped} triangles with equal corners"] if dropped else []
    return RawMesh(points, [("triangle", triangles[proper])], {}, messages)
