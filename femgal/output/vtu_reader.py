# SPDX-License-Identifier: BSD-3-Clause
"""Reads the .vtu + .pvd series that `femgal.output.vtu` writes, also while it is being written."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femgal.output.series import Array, Kind, checked_frame
from meshes.errors import InputError

if TYPE_CHECKING:
    import meshio


class VtuReader:
    """A `SeriesReader` of a .pvd list and its .vtu files.

    Parameters
    ----------
    path : Path
        The .pvd file.

    Raises
    ------
    InputError
        Missing or damaged file, a frame outside the series' folder, no such array or frame.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._cached: tuple[int, meshio.Mesh] | None = None
        self._text = ""
        self._listed: list[tuple[float, Path]] = []
        self._entries()

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the frames [s], shape [n_frames]."""
        return np.array([time for time, _ in self._entries()], np.float64)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Rest positions [m], shape [n_vertices, 3]."""
        return np.asarray(self._frame(0).points, np.float64)

    def points_of(self, frame: int) -> NDArray[np.float64]:
        """Points of one frame [m], which other programs move along with the body, shape [n_vertices, 3]."""
        return np.asarray(self._frame(frame).points, np.float64)

    @cached_property
    def cells(self) -> NDArray[np.int32]:
        """Vertex indices, shape [n_tets, 4]."""
        return np.asarray(self._frame(0).cells[0].data)

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Names of the point or cell arrays, sorted."""
        return tuple(sorted(self._data(kind, 0)))

    def array(self, kind: Kind, name: str, frame: int) -> Array:
        """One array of one frame, shape [rows] or [rows, components]."""
        data = self._data(kind, frame)
        if name not in data:
            allowed = ", ".join(sorted(data)) or "none"
            raise InputError(f"no such {kind} array", where=str(self._path), found=name, allowed=allowed)
        return data[name]

    def field_data(self, frame: int) -> dict[str, float]:
        """Return the numbers of one frame."""
        data = self._frame(frame).field_data
        return {name: float(np.ravel(value)[0]) for name, value in data.items() if name != "TimeValue"}

    def _data(self, kind: Kind, frame: int) -> dict[str, Array]:
        mesh = self._frame(frame)
        if kind == "point":
            return dict(mesh.point_data)
        return {name: blocks[0] for name, blocks in mesh.cell_data.items()}

    def _entries(self) -> list[tuple[float, Path]]:
        """Times and files of the list, read anew when it has been replaced."""
        try:
            text = self._path.read_text(encoding="utf-8")
            if text != self._text:
                self._listed, self._text, self._cached = self._parsed(text), text, None
        except InputError:
            raise
        except (OSError, ET.ParseError, KeyError, ValueError) as error:
            raise InputError("cannot be read", where=str(self._path), found=error, allowed="a .pvd series") from error
        return self._listed

    def _parsed(self, text: str) -> list[tuple[float, Path]]:
        rows = ET.fromstring(text).iter("DataSet")
        entries = [(float(row.attrib["timestep"]), self._path.parent / row.attrib["file"]) for row in rows]
        home = self._path.parent.resolve()
        for _, file in entries:
            if not file.resolve().is_relative_to(home):
                raise InputError("frame outside the run", where=str(self._path), found=file, allowed=f"below {home}")
        return entries

    def _frame(self, frame: int) -> meshio.Mesh:
        import meshio

        entries = self._entries()
        number = checked_frame(frame, len(entries), str(self._path))
        if self._cached is None or self._cached[0] != number:
            file = entries[number][1]
            try:
                mesh = meshio.vtu.read(file)
            except (OSError, ET.ParseError, KeyError, IndexError, ValueError, meshio.ReadError) as error:
                raise InputError(
                    "damaged frame", where=str(file), found=str(error), allowed="a .vtu file of tetrahedra"
                ) from error
            if [block.type for block in mesh.cells] != ["tetra"]:
                found = ", ".join(block.type for block in mesh.cells) or "no cells"
                raise InputError("not a frame of ours", where=str(file), found=found, allowed="tetrahedra only")
            self._cached = number, mesh
        return self._cached[1]
