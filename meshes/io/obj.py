# SPDX-License-Identifier: BSD-3-Clause
"""Wavefront OBJ surfaces: ``v`` and ``f`` lines, everything else is skipped."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshes.errors import MeshError
from meshes.io.raw import RawMesh
from meshes.types import TriMesh

_KINDS = {3: "triangle", 4: "quad"}


def read_obj(path: Path) -> RawMesh:
    """Read positions and faces; negative indices count back from the latest vertex.

    Raises
    ------
    MeshError
        A line that does not parse; the message names it.
    """
    points: list[list[float]] = []
    faces: dict[int, list[list[int]]] = {}
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            words = line.split()
            try:
                if words[:1] == ["v"]:
                    points.append([float(words[k]) for k in (1, 2, 3)])
                elif words[:1] == ["f"]:
                    corners = [_index(word, len(points)) for word in words[1:]]
                    faces.setdefault(len(corners), []).append(corners)
            except (ValueError, IndexError) as error:
                raise MeshError(
                    f"line {number} is damaged",
                    where=str(path),
                    found=repr(line.strip()[:60]),
                    allowed="v x y z, f ...",
                ) from error
    blocks = [(_KINDS.get(width, "polygon"), np.array(rows, np.int64)) for width, rows in faces.items()]
    return RawMesh(np.array(points).reshape(-1, 3), blocks)


def write_obj(path: Path, mesh: TriMesh) -> None:
    """Write a triangle surface."""
    with path.open("w", encoding="ascii") as stream:
        stream.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.points.tolist())
        stream.writelines(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in mesh.cells.tolist())


def _index(word: str, n_points: int) -> int:
    index = int(word.partition("/")[0])
    if index == 0:
        raise ValueError(word)
    return index - 1 if index > 0 else n_points + index
