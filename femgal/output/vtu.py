# SPDX-License-Identifier: BSD-3-Clause
"""A run as one .vtu file per frame and a .pvd list of them, which every ParaView opens.

The mesh is repeated in each file: several times the size of the .vtkhdf series and slower to write.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from femgal.output.arrays import storable_all
from femgal.output.atomic import replacing, write_text
from femgal.output.series import Array, refuse_other_names
from femgal.output.vtu_reader import VtuReader
from meshes.errors import InputError
from meshes.types import TetMesh


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
        kept = set(map(_frame_name, range(len(self._times))))
        for frame in (folder / "frames").glob("frame_*.vtu"):
            if frame.name not in kept:
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
        same_points = np.array_equal(reader.points, self._mesh.points)
        if not same_points or not np.array_equal(reader.cells, self._mesh.cells):
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
