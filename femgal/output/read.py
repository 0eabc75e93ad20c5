# SPDX-License-Identifier: BSD-3-Clause
"""A run for Python users: times, rest mesh, motion and fields, whatever format it was written in."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.output.runlog import FILE_NAME, read_log
from femgal.output.series import Array, SeriesReader
from meshes.errors import InputError
from meshes.types import Origin, TetMesh

_SERIES = ("frames.vtkhdf", "frames.pvd")


@dataclass(frozen=True)
class SavedRun:
    """What a run has left behind; frames are read when asked for, so a running one can be followed.

    Parameters
    ----------
    path : Path
        The series file.
    series : SeriesReader
        Its reader.
    log : dict
        Content of run.json; empty when the series was opened without its folder.
    """

    path: Path
    series: SeriesReader
    log: dict[str, Any] = field(default_factory=dict)

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the frames [s], shape [n_frames]."""
        return self.series.times

    @property
    def n_frames(self) -> int:
        """Number of frames that are there now."""
        return len(self.times)

    @cached_property
    def mesh(self) -> TetMesh:
        """Rest mesh; a file with indices out of range or NaN is refused here, before VTK crashes on it."""
        return TetMesh(self.series.points, self.series.cells, Origin(name=self.path.name, source=str(self.path)))

    @property
    def points(self) -> NDArray[np.float64]:
        """Rest positions [m], shape [n_vertices, 3]."""
        return self.mesh.points

    @property
    def cells(self) -> NDArray[np.int32]:
        """Vertex indices, shape [n_tets, 4]."""
        return self.mesh.cells

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the point arrays."""
        return self.series.names("point")

    @property
    def cell_names(self) -> tuple[str, ...]:
        """Names of the cell arrays."""
        return self.series.names("cell")

    def displacement(self, frame: int) -> Array:
        """Current minus rest position [m], shape [n_vertices, 3]; frame -1 is the last.

        Raises
        ------
        InputError
            No such frame.
        """
        return self.point_data("displacement", frame)

    def point_data(self, name: str, frame: int) -> Array:
        """Point array `name`, shape [n_vertices] or [n_vertices, components].

        Raises
        ------
        InputError
            No such array or frame.
        """
        return self._rows(self.series.array("point", name, frame), len(self.points), name)

    def cell_data(self, name: str, frame: int) -> Array:
        """Cell array `name`, shape [n_tets] or [n_tets, components].

        Raises
        ------
        InputError
            No such array or frame.
        """
        return self._rows(self.series.array("cell", name, frame), len(self.cells), name)

    def field_data(self, frame: int) -> dict[str, float]:
        """Numbers of a whole frame, energies for example.

        Raises
        ------
        InputError
            No such frame.
        """
        return self.series.field_data(frame)

    def _rows(self, array: Array, rows: int, name: str) -> Array:
        if len(array) != rows:
            raise InputError(f"array {name!r} is cut off", where=str(self.path), found=len(array), allowed=rows)
        return array


def read_run(path: Path | str) -> SavedRun:
    """Open a run folder, or its .vtkhdf or .pvd file.

    Raises
    ------
    InputError
        Nothing there, or not readable.
    """
    file = _series_file(Path(path))
    log = read_log(file.parent) if (file.parent / FILE_NAME).exists() else {}
    return SavedRun(file, _reader(file), log)


def _series_file(path: Path) -> Path:
    if path.is_file():
        return path
    for name in _SERIES:
        if (path / name).is_file():
            return path / name
    raise InputError(
        "no run found",
        where=str(path),
        found="a folder without a series" if path.is_dir() else "no such file or folder",
        allowed=f"a folder with {' or '.join(_SERIES)}, or such a file",
    )


def _reader(file: Path) -> SeriesReader:
    if file.suffix == ".vtkhdf":
        from femgal.output.vtkhdf_reader import VtkHdfReader

        return VtkHdfReader(file)
    if file.suffix == ".pvd":
        from femgal.output.vtu_reader import VtuReader

        return VtuReader(file)
    raise InputError("not a series", where=str(file), found=file.suffix or "no suffix", allowed=".vtkhdf, .pvd")
