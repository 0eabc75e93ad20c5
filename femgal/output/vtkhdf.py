# SPDX-License-Identifier: BSD-3-Clause
"""Writes a whole run into one temporal VTKHDF file; its layout is described in `femgal.output.vtkhdf_layout`.

What keeps the file readable through kill -9, a full disk and readers that look in while it is written:

1. A frame counts only when `NSteps` is raised, and that happens after everything else has been flushed. One flush
   alone would not do: HDF5 writes its metadata in order of address, not in order of change.
2. A frame starts on a chunk boundary (rows are padded), so no chunk of an earlier frame is ever recompressed and moved.
3. Datasets are indexed by extensible arrays, whose entries stay where they are; the older B-tree index splits nodes
   and, interrupted there, loses earlier frames. They need the file formats of HDF5 1.10 for the objects but an old
   superblock, since the new one marks the file as "open for writing" and a killed run would leave the mark behind.
4. The room that a frame can need is reserved on the disk before HDF5 is touched: a full disk stops the frame before
   anything has changed.
5. The file gets its name when the first frame is in it, because that frame creates the arrays.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from femgal.output.arrays import storable_all
from femgal.output.series import Array, refuse_other_names
from femgal.output.vtkhdf_layout import (
    COMPRESSION,
    GROUPS,
    STEP_CHUNK,
    annotate,
    create_empty,
    create_growing,
    is_static,
    rows_per_frame,
    write_header,
    write_static,
)
from femgal.output.vtkhdf_resume import reopen
from meshes.types import TetMesh

if TYPE_CHECKING:
    import h5py

_CHUNK_BYTES = 1 << 20
# Index blocks of all datasets of one frame, generously.
_METADATA_BYTES = 1 << 20
# Readers of a mesh that never changes look at row 0 in every frame.
_STEP_CONSTANTS: dict[str, tuple[tuple[int, ...], int]] = {
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
        The file cannot be resumed: missing, damaged, of another mesh, or with fewer frames.
    OSError
        The file cannot be written.
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
        self._unnamed: Path | None = None
        self._whole = True
        self.frames_written = resume_frames or 0
        if resume_frames:
            self._file = reopen(path, mesh, resume_frames)
        else:
            self._unnamed = path.with_name(f".{path.stem}.part{path.suffix}")
            self._file = _start(self._unnamed, mesh, static)
        self._root = self._file["VTKHDF"]
        self._descriptor = os.open(self._unnamed or path, os.O_WRONLY)

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
        with self._torn_until_done():
            for group, blocks in arrays.items():
                for name, block in blocks.items():
                    self._write_block(group, name, block)
            self._write_step(time)
            self._flush()
            self._root["Steps"].attrs.modify("NSteps", np.int64(self.frames_written + 1))
            self._flush()
        self.frames_written += 1
        self._name_file()

    def close(self) -> None:
        """Close the file and give back the disk space that was reserved but not needed."""
        if not self._file:
            return
        if self._whole:
            self._root.attrs.modify("NotClosed", np.uint8(0))
            self._file.flush()
        used = self._file.id.get_filesize()
        self._file.close()
        if os.fstat(self._descriptor).st_size > used:
            os.truncate(self._descriptor, used)
        os.close(self._descriptor)
        self._name_file()

    def _name_file(self) -> None:
        if self._unnamed:
            os.replace(self._unnamed, self._path)
            self._unnamed = None

    @contextlib.contextmanager
    def _torn_until_done(self) -> Iterator[None]:
        self._whole = False
        yield
        self._whole = True

    def _flush(self) -> None:
        # On to the disk as well: a checkpoint that survives a power cut needs its frames.
        self._file.flush()
        os.fsync(self._descriptor)

    def _check_names(self, arrays: Mapping[str, Mapping[str, Array]]) -> None:
        for group, blocks in arrays.items():
            known = {name: data for name, data in self._root[group].items() if not is_static(data)}
            if self.frames_written:
                refuse_other_names(set(known), set(blocks), group)
            for name, block in blocks.items():
                if name in known and known[name].shape[1:] != block.shape[1:]:
                    raise ValueError(f"{group} {name!r}: rows of {block.shape[1:]}, before {known[name].shape[1:]}")

    def _reserve(self, n_bytes: int) -> None:
        if not hasattr(os, "posix_fallocate"):
            return
        # Incompressible data grow by a thousandth; padding adds at most one row per chunk.
        room = int(1.01 * n_bytes) + _METADATA_BYTES
        try:
            os.posix_fallocate(self._descriptor, 0, self._file.id.get_filesize() + room)
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS):
                reason = f"no room for frame {self.frames_written} ({room} bytes): {error.strerror}"
                raise OSError(error.errno, reason, str(self._path)) from error

    def _write_block(self, group: str, name: str, block: Array) -> None:
        target = self._root[group]
        if name not in target:
            compressed = group in GROUPS.values()
            chunk, filters = (_chunk_rows(block), COMPRESSION) if compressed else (STEP_CHUNK, {})
            annotate(create_growing(target, name, block.shape[1:], block.dtype, chunk, **filters), name)
        data = target[name]
        stride = 1 if group == "FieldData" else rows_per_frame(data, len(block))
        start = self.frames_written * stride
        data.resize(start + stride, axis=0)
        data[start : start + len(block)] = block
        self._write_entry(f"{group}Offsets/{name}", (), start)
        if group == "FieldData":
            self._write_entry(f"FieldDataSizes/{name}", (2,), 1)

    def _write_step(self, time: float) -> None:
        self._write_entry("Values", (), time, np.float64)
        for name, (tail, value) in _STEP_CONSTANTS.items():
            self._write_entry(name, tail, value)
        for group in GROUPS.values():
            for name, data in self._root[group].items():
                if is_static(data):
                    self._write_entry(f"{group}Offsets/{name}", (), 0)

    def _write_entry(self, name: str, tail: tuple[int, ...], value: float, dtype: type = np.int64) -> None:
        steps = self._root["Steps"]
        if name not in steps:
            create_growing(steps, name, tail, np.dtype(dtype), STEP_CHUNK)
        data = steps[name]
        data.resize(self.frames_written + 1, axis=0)
        data[self.frames_written] = value


def _start(path: Path, mesh: TetMesh, static: Mapping[str, Mapping[str, Array]]) -> h5py.File:
    file = create_empty(path)
    try:
        write_static(write_header(file), mesh, static)
    except BaseException:
        file.close()
        path.unlink()
        raise
    return file


def _chunk_rows(block: Array) -> int:
    pieces = -(-block.nbytes // _CHUNK_BYTES)
    return -(-len(block) // pieces)
