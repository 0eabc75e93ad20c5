# SPDX-License-Identifier: BSD-3-Clause
"""Counts that a file declares against the bytes that it has.

Readers allocate what the header says; a file of 100 bytes that declares 10^12 vertices would exhaust the memory.
Every vertex and every cell takes at least one byte in every format, compressed ones aside.
"""

from __future__ import annotations

import mmap
import re
from pathlib import Path

from meshes.errors import MeshError

_DECLARED = re.compile(
    rb"(?:POINTS|CELLS|CELL_TYPES|element vertex|element face|Vertices|Tetrahedra|Triangles|NELEM=|NPOIN=)\s+(\d+)"
    # Version 2: the count alone on its line. Version 4: number of blocks, then the count.
    rb"|\$(?:Nodes|Elements)\s+(\d+)(?:[ \t]+(\d+))?"
)
_SUFFIXES = {".vtk", ".msh", ".mesh", ".su2", ".ply", ".off"}


def check_counts(path: Path) -> None:
    """Refuse a text header that declares more items than the file has bytes.

    Raises
    ------
    MeshError
        With the declared number and the size of the file.
    """
    if path.suffix.lower() not in _SUFFIXES:
        return
    size = path.stat().st_size
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for match in _DECLARED.finditer(content):
            number = max(int(digits[:30]) for digits in match.groups() if digits)
            if number > size:
                raise MeshError(
                    "declares more items than the file can hold",
                    where=str(path),
                    found=f"{match[0][:60].decode('ascii', 'replace').split()} in {size} bytes",
                    allowed=f"at most {size}",
                    advice="the file is damaged or cut off: export it again",
                )
