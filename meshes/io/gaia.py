# SPDX-License-Identifier: BSD-3-Clause
"""The ``.t`` format of Gaia: lines ``Vertex id x y z`` and ``Tet id a b c d``.

Ids may start at any number and have gaps; text in braces after the numbers is ignored.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.io.raw import RawMesh
from meshes.types import TetMesh

_NUMBERS = {"Vertex": 3, "Tet": 4}
# Written by the surface variants of the format, of no use for a volume.
_IGNORED = {"Edge", "Face"}


def read_t(path: Path) -> RawMesh:
    """Read a ``.t`` file.

    Raises
    ------
    MeshError
        A line that is none of the format's, a duplicate or unknown vertex id; the message names the line.
    """
    ids: list[int] = []
    rows: dict[str, list[list[float]]] = {"Vertex": [], "Tet": []}
    line = "\n"
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            words = line.partition("{")[0].split()
            if not words or words[0].startswith("#") or words[0] in _IGNORED:
                continue
            rows_of_kind = rows.get(words[0])
            if rows_of_kind is None:
                raise _bad_line(path, number, line)
            try:
                identity, values = _parse(words)
            except ValueError as error:
                raise _bad_line(path, number, line) from error
            rows_of_kind.append(values)
            if words[0] == "Vertex":
                ids.append(identity)
    points = np.array(rows["Vertex"], np.float64).reshape(-1, 3)
    tets = np.array(rows["Tet"], np.int64).reshape(-1, 4)
    blocks = [("tetra", _positions_of(tets, np.array(ids, np.int64), path))]
    # The format has no counts: this is the only trace that a cut-off file may leave.
    messages = [] if line.endswith("\n") else ["the last line has no line end: the file may be cut off"]
    return RawMesh(points, blocks, messages=messages)


def write_t(path: Path, mesh: TetMesh) -> None:
    """Write a ``.t`` file with ids from 0; regions are not part of the format."""
    with path.open("w", encoding="ascii") as stream:
        stream.writelines(f"Vertex {k} {x!r} {y!r} {z!r}\n" for k, (x, y, z) in enumerate(mesh.points.tolist()))
        stream.writelines(f"Tet {k} {a} {b} {c} {d}\n" for k, (a, b, c, d) in enumerate(mesh.cells.tolist()))


def _parse(words: list[str]) -> tuple[int, list[float]]:
    width = _NUMBERS[words[0]]
    if len(words) != 2 + width:
        raise ValueError(words)
    convert = float if words[0] == "Vertex" else int
    return int(words[1]), [convert(word) for word in words[2:]]


def _bad_line(path: Path, number: int, line: str) -> MeshError:
    return MeshError(
        f"line {number} is not part of a .t file",
        where=str(path),
        found=repr(line.strip()[:60]),
        allowed="'Vertex id x y z' or 'Tet id a b c d'",
    )


def _positions_of(tets: NDArray[np.int64], ids: NDArray[np.int64], path: Path) -> NDArray[np.int64]:
    """Rows of the vertices that the ids in ``tets`` name."""
    order = np.argsort(ids, kind="stable")
    known = ids[order]
    if len(known) and (known[1:] == known[:-1]).any():
        twice = known[1:][known[1:] == known[:-1]][0]
        raise MeshError("a vertex id is defined twice", where=str(path), found=f"Vertex {twice}", allowed="unique ids")
    if len(known) == 0 or len(tets) == 0:
        return tets
    slots = np.searchsorted(known, tets).clip(max=len(known) - 1)
    missing = np.argwhere(known[slots] != tets)
    if len(missing):
        row, column = missing[0]
        raise MeshError(
            f"tetrahedron {row} refers to a vertex that does not exist",
            where=str(path),
            found=f"vertex id {tets[row, column]} in {tets[row].tolist()}",
            allowed=f"ids of Vertex lines, {known[0]} to {known[-1]}",
        )
    return order[slots]
