# SPDX-License-Identifier: BSD-3-Clause
"""A run as one .vtu file per frame and a .pvd list of them, which every ParaView opens.

The mesh is repeated in each file: several times the size of the .vtkhdf series and slower to write.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from femgal.output.arrays import storable_all
from femgal.output.atomic import replacing, write_text
from femgal.output.series import Array, Kind, checked_frame, refuse_other_names
from meshes.errors import InputError
from meshes.types import TetMesh

if TYPE_CHECKING:
    import meshio


class VtuWriter:
    """Writes a `SeriesWriter` series as `frames.pvd` and `frames/frame_00000.vtu`, `frame_00001.vtu`, ...

    Parameters
    ----------
    folder : Path
        Output folder.
    mesh : TetMesh
        Rest mesh.
    static : {"point": {name: array}, "cell": {name: array}}
        Arrays that never change, repeated in each file.
    resume_frames : int, optional
        Frames of an existing series to keep.

    Raises
    ------
    InputError
        The series cannot be resumed: missing, of another mesh, or with fewer frames.
    """

    def __init__(
        self,
        folder: Path,
        mesh: TetMesh,
        *,
        static: Mapping[str, Mapping[str, Array]],
        resume_frames: int | None = None,
    ) -> None:
        self._folder, self._mesh = folder, mesh
        self._static_points = storable_all(static.get("point", {}), len(mesh.points))
        self._static_cells = storable_all(static.get("cell", {}), len(mesh.cells))
        self._names: tuple[set[str], set[str]] | None = None
        self._times = self._kept_times(resume_frames) if resume_frames else []
        (folder / "frames").mkdir(exist_ok=True)
        self._write_list()
        for frame in (folder / "frames").glob("frame_*.vtu"):
            if frame.name not in map(_frame_name, range(len(self._times))):
                frame.unlink()

    @property
    def frames_written(self) -> int:
        """Frames that a reader finds now."""
        return len(self._times)

    def append(
        self,
        time: float,
        point_data: Mapping[str, Array],
        cell_data: Mapping[str, Array],
        field_data: Mapping[str, float],
    ) -> None:
        """Write one frame; see `SeriesWriter.append`."""
        points = storable_all(point_data, len(self._mesh.points))
        cells = storable_all(cell_data, len(self._mesh.cells))
        names = set(points), set(cells)
        for before, now, what in zip(self._names or names, names, ("point", "cell"), strict=True):
            refuse_other_names(before, now, what)
        path = self._folder / "frames" / _frame_name(len(self._times))
        with replacing(path) as part:
            _write_vtu(part, self._mesh, self._static_points | points, self._static_cells | cells)
            _insert_field_data(part, {"TimeValue": time, **field_data})
        self._names = names
        self._times.append(float(time))
        try:
            self._write_list()
        except OSError:
            self._times.pop()
            raise

    def close(self) -> None:
        """Do nothing: every file is whole as soon as it is there."""

    def _kept_times(self, frames: int) -> list[float]:
        where = self._folder / "frames.pvd"
        reader = VtuReader(where)
        if len(reader.times) < frames:
            _refuse_resume(where, f"{len(reader.times)} frames", f"{frames} or more frames")
        first = reader._frame(0)
        if not np.array_equal(first.points, self._mesh.points) or not np.array_equal(
            first.cells[0].data, self._mesh.cells
        ):
            _refuse_resume(where, "another mesh", "the mesh of the run being resumed")
        return reader.times[:frames].tolist()

    def _write_list(self) -> None:
        rows = [
            f'    <DataSet timestep="{time!r}" part="0" file="frames/{_frame_name(number)}"/>'
            for number, time in enumerate(self._times)
        ]
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
        body = "\n".join(["  <Collection>", *rows, "  </Collection>", "</VTKFile>", ""])
        write_text(self._folder / "frames.pvd", head + body)


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
        self._entries()

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the frames [s], shape [n_frames]."""
        return np.array([time for time, _ in self._entries()], np.float64)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Rest positions [m], shape [n_vertices, 3]."""
        return np.asarray(self._frame(0).points, np.float64)

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
        try:
            rows = ET.fromstring(self._path.read_text(encoding="utf-8")).iter("DataSet")
            entries = [(float(row.attrib["timestep"]), self._path.parent / row.attrib["file"]) for row in rows]
        except (OSError, ET.ParseError, KeyError, ValueError) as error:
            raise InputError("cannot be read", where=str(self._path), found=error, allowed="a .pvd series") from error
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
            self._cached = number, mesh
        return self._cached[1]


def _frame_name(number: int) -> str:
    return f"frame_{number:05d}.vtu"


def _write_vtu(path: Path, mesh: TetMesh, points: dict[str, Array], cells: dict[str, Array]) -> None:
    import meshio

    blocks = {name: [array] for name, array in cells.items()}
    meshio.vtu.write(path, meshio.Mesh(mesh.points, [("tetra", mesh.cells)], point_data=points, cell_data=blocks))


def _insert_field_data(path: Path, numbers: Mapping[str, float]) -> None:
    # meshio reads field data but does not write them.
    arrays = "".join(
        f'<DataArray type="Float64" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{float(value)!r}'
        "</DataArray>"
        for name, value in numbers.items()
        if math.isfinite(value)  # VTK's text parser stops at "nan"
    )
    grid = b"<UnstructuredGrid>"
    content = path.read_bytes()
    path.write_bytes(content.replace(grid, grid + f"<FieldData>{arrays}</FieldData>".encode(), 1))


def _refuse_resume(path: Path, found: str, allowed: str) -> None:
    raise InputError(
        "this series cannot be resumed",
        where=str(path),
        found=found,
        allowed=allowed,
        advice="start anew with another --out",
    )
