# SPDX-License-Identifier: BSD-3-Clause
"""A whole run in one temporal VTKHDF file (docs.vtk.org, "VTKHDF format specification", version 2.2).

Rest positions and cells are stored once; every frame appends one block of rows to each array, and
`Steps/*Offsets` tell readers where. What keeps the file readable through kill -9, a full disk and readers that look
in while it is written:

1. A frame counts only when `NSteps` is raised, and that happens after everything else has been flushed. One flush
   alone would not do: HDF5 writes its metadata in order of address, not in order of change.
2. A frame starts on a chunk boundary (rows are padded), so no chunk of an earlier frame is ever recompressed and moved.
3. Datasets are indexed by extensible arrays, whose entries stay where they are; the older B-tree index splits nodes
   and, interrupted there, loses earlier frames. They need the file formats of HDF5 1.10 for the objects but an old
   superblock, since the new one marks the file as "open for writing" and a killed run would leave the mark behind.
4. The room that a frame can need is reserved on the disk before HDF5 is touched: a full disk stops the frame before
   anything has changed.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femgal.output.arrays import storable_all
from femgal.output.atomic import replacing
from femgal.output.fields import find_field, unit_of
from femgal.output.series import Array, refuse_other_names
from meshes.errors import InputError
from meshes.types import TetMesh

if TYPE_CHECKING:
    import h5py

_VTK_TETRA = 10
_CHUNK_BYTES = 1 << 20
_STEP_CHUNK = 64  # frames per chunk of the small per-frame arrays
_COMPRESSION: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
# Index blocks of all datasets of one frame, generously.
_METADATA_BYTES = 1 << 20
_GROUPS = {"point": "PointData", "cell": "CellData"}
# Readers of a topology that never changes look at row 0 in every frame.
_STEP_CONSTANTS = {
    "PartOffsets": ((), 0),
    "NumberOfParts": ((), 1),
    "PointOffsets": ((), 0),
    "CellOffsets": ((1,), 0),
    "ConnectivityIdOffsets": ((1,), 0),
}


class VtkHdfWriter:
    """Writes a `SeriesWriter` series as one .vtkhdf file.

    Parameters
    ----------
    path : Path
        File to write.
    mesh : TetMesh
        Rest mesh.
    static : {"point": {name: array}, "cell": {name: array}}
        Arrays that never change. When resuming, those in the file stay.
    resume_frames : int, optional
        Frames of an existing file to keep.

    Raises
    ------
    InputError
        The file cannot be resumed: missing, of another mesh, or with fewer frames.
    """

    def __init__(
        self,
        path: Path,
        mesh: TetMesh,
        *,
        static: Mapping[str, Mapping[str, Array]],
        resume_frames: int | None = None,
    ) -> None:
        self._path = path
        self._rows = {"point": len(mesh.points), "cell": len(mesh.cells)}
        if not resume_frames:
            _create(path, mesh, static)
        elif not path.is_file():
            raise _not_resumable(path, "no such file", f"a series of {resume_frames} or more frames")
        self._file = _open_for_writing(path)
        self._root = self._file["VTKHDF"]
        if resume_frames:
            _refuse_other_mesh(path, self._root, mesh)
            _cut_back(path, self._root, resume_frames)
            self._file.flush()
        self.frames_written = resume_frames or 0
        self._descriptor = os.open(path, os.O_WRONLY)

    def append(
        self,
        time: float,
        point_data: Mapping[str, Array],
        cell_data: Mapping[str, Array],
        field_data: Mapping[str, float],
    ) -> None:
        """Write one frame; see `SeriesWriter.append`."""
        arrays = {
            "PointData": storable_all(point_data, self._rows["point"]),
            "CellData": storable_all(cell_data, self._rows["cell"]),
            "FieldData": {name: np.array([value], np.float64) for name, value in field_data.items()},
        }
        self._check_names(arrays)
        self._reserve(sum(array.nbytes for group in arrays.values() for array in group.values()))
        for group, blocks in arrays.items():
            for name, block in blocks.items():
                self._write_block(group, name, block)
        self._write_step(time)
        self._file.flush()
        self._root["Steps"].attrs["NSteps"] = np.int64(self.frames_written + 1)
        self._file.flush()
        self.frames_written += 1

    def close(self) -> None:
        """Close the file and give back the disk space that was reserved but not needed."""
        if not self._file:
            return
        used = self._file.id.get_filesize()
        self._file.close()
        if os.fstat(self._descriptor).st_size > used:
            os.truncate(self._descriptor, used)
        os.close(self._descriptor)

    def _check_names(self, arrays: Mapping[str, Mapping[str, Array]]) -> None:
        for group, blocks in arrays.items():
            known = {name: data for name, data in self._root[group].items() if not data.attrs.get("static", False)}
            if self.frames_written or known:
                refuse_other_names(set(known), set(blocks), group)
            for name, block in blocks.items():
                if name in known and known[name].shape[1:] != block.shape[1:]:
                    raise ValueError(f"{group} {name!r}: shape {block.shape}, before [., {known[name].shape[1:]}]")

    def _reserve(self, n_bytes: int) -> None:
        # Incompressible data grow by a thousandth; padding adds at most one row per chunk.
        room = int(1.01 * n_bytes) + _METADATA_BYTES
        if not hasattr(os, "posix_fallocate"):
            return
        try:
            os.posix_fallocate(self._descriptor, 0, self._file.id.get_filesize() + room)
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS):
                raise OSError(
                    error.errno, f"no room for frame {self.frames_written} ({room} bytes): {error.strerror}", self._path
                ) from error

    def _write_block(self, group: str, name: str, block: Array) -> None:
        target = self._root[group]
        if name not in target:
            compressed = group != "FieldData"
            chunk = _chunk_rows(block) if compressed else _STEP_CHUNK
            data = _growing(target, name, block.shape[1:], block.dtype, chunk, **(_COMPRESSION if compressed else {}))
            _annotate(data, name)
        data = target[name]
        stride = _stride(data, len(block)) if group != "FieldData" else 1
        start = self.frames_written * stride
        data.resize(start + stride, axis=0)
        data[start : start + len(block)] = block
        self._write_row(f"{group}Offsets/{name}", (), start)
        if group == "FieldData":
            self._write_row(f"FieldDataSizes/{name}", (2,), 1)

    def _write_step(self, time: float) -> None:
        self._write_row("Values", (), time, np.float64)
        for name, (tail, value) in _STEP_CONSTANTS.items():
            self._write_row(name, tail, value)
        for group in _GROUPS.values():
            for name, data in self._root[group].items():
                if data.attrs.get("static", False):
                    self._write_row(f"{group}Offsets/{name}", (), 0)

    def _write_row(self, name: str, tail: tuple[int, ...], value: float, dtype: type = np.int64) -> None:
        steps = self._root["Steps"]
        if name not in steps:
            _growing(steps, name, tail, np.dtype(dtype), _STEP_CHUNK)
        data = steps[name]
        data.resize(self.frames_written + 1, axis=0)
        data[self.frames_written] = value


def _create(path: Path, mesh: TetMesh, static: Mapping[str, Mapping[str, Array]]) -> None:
    """Write the header, the mesh and the static arrays under a temporary name, then rename."""
    import h5py

    with replacing(path) as part:
        h5py.File(part, "w", libver=("earliest", "v110"), locking=False).close()
        _write_static(part, mesh, static)


def _write_static(path: Path, mesh: TetMesh, static: Mapping[str, Mapping[str, Array]]) -> None:
    with _open_for_writing(path) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 2], np.int64)
        root.attrs["Type"] = np.bytes_("UnstructuredGrid")
        _write_mesh(root, mesh)
        for group in ("PointData", "CellData", "FieldData"):
            root.create_group(group)
            root.create_group(f"Steps/{group}Offsets")
        root.create_group("Steps/FieldDataSizes")
        root["Steps"].attrs["NSteps"] = np.int64(0)
        for kind, rows in (("point", len(mesh.points)), ("cell", len(mesh.cells))):
            for name, array in storable_all(static.get(kind, {}), rows).items():
                data = root[_GROUPS[kind]].create_dataset(name, data=array, chunks=True, **_COMPRESSION)
                data.attrs["static"] = np.uint8(1)
                _annotate(data, name)


def _write_mesh(root: h5py.Group, mesh: TetMesh) -> None:
    n_cells = len(mesh.cells)
    root["NumberOfPoints"] = np.array([len(mesh.points)], np.int64)
    root["NumberOfCells"] = np.array([n_cells], np.int64)
    root["NumberOfConnectivityIds"] = np.array([4 * n_cells], np.int64)
    blocks = {
        # Rest positions are stored once, so their full precision is nearly free; the motion is float32.
        "Points": mesh.points,
        "Connectivity": mesh.cells.ravel().astype(np.int64),
        "Offsets": 4 * np.arange(n_cells + 1, dtype=np.int64),
        "Types": np.full(n_cells, _VTK_TETRA, np.uint8),
    }
    for name, block in blocks.items():
        root.create_dataset(name, data=block, chunks=True, **_COMPRESSION)
    root["Points"].attrs["unit"] = "m"


def _open_for_writing(path: Path) -> h5py.File:
    import h5py

    return h5py.File(path, "r+", libver=("v110", "v110"), locking=False)


def _growing(
    group: h5py.Group, name: str, tail: tuple[int, ...], dtype: np.dtype[Any], chunk: int, **filters: Any
) -> h5py.Dataset:
    return group.create_dataset(
        name, shape=(0, *tail), maxshape=(None, *tail), chunks=(chunk, *tail), dtype=dtype, **filters
    )


def _chunk_rows(block: Array) -> int:
    pieces = -(-block.nbytes // _CHUNK_BYTES)
    return -(-len(block) // pieces)


def _stride(data: h5py.Dataset, rows: int) -> int:
    chunk = data.chunks[0]
    return chunk * -(-rows // chunk)


def _annotate(data: h5py.Dataset, name: str) -> None:
    field = find_field(name)
    if unit_of(name):
        data.attrs["unit"] = unit_of(name)
    if field:
        data.attrs["description"] = field.description


def _cut_back(path: Path, root: h5py.Group, frames: int) -> None:
    steps = root["Steps"]
    present = int(steps.attrs["NSteps"])
    if present < frames:
        raise _not_resumable(path, f"{present} frames", f"{frames} or more frames")
    steps.attrs["NSteps"] = np.int64(frames)
    root.file.flush()
    for data in _step_arrays(steps):
        if len(data) > frames:
            data.resize(frames, axis=0)
    for group, rows in (("PointData", "NumberOfPoints"), ("CellData", "NumberOfCells"), ("FieldData", None)):
        for data in root[group].values():
            stride = _stride(data, int(root[rows][0])) if rows else 1
            if not data.attrs.get("static", False) and len(data) > frames * stride:
                data.resize(frames * stride, axis=0)


def _step_arrays(steps: h5py.Group) -> Iterator[h5py.Dataset]:
    for item in steps.values():
        if hasattr(item, "keys"):
            yield from item.values()
        else:
            yield item


def _refuse_other_mesh(path: Path, root: h5py.Group, mesh: TetMesh) -> None:
    counts = int(root["NumberOfPoints"][0]), int(root["NumberOfCells"][0])
    wanted = len(mesh.points), len(mesh.cells)
    if counts != wanted:
        raise _not_resumable(path, "{} vertices, {} tetrahedra".format(*counts), "{} and {}".format(*wanted))
    same_cells = np.array_equal(root["Connectivity"][:], mesh.cells.ravel())
    if not same_cells or not np.array_equal(root["Points"][:], mesh.points):
        raise _not_resumable(path, "another mesh of the same size", "the mesh of the run being resumed")


def _not_resumable(path: Path, found: str, allowed: str) -> InputError:
    return InputError(
        "this series cannot be resumed",
        where=str(path),
        found=found,
        allowed=allowed,
        advice="start anew with another --out",
    )
