# SPDX-License-Identifier: BSD-3-Clause
"""Going on with a .vtkhdf series: checked, and cut back to the frames that a checkpoint knows.

A file that was closed is cut back where it lies. One whose writer was killed may have index entries behind its last
counted frame that point nowhere; HDF5 would fail on them when the rows are removed. There the kept frames, which are
whole, are copied into a new file, chunk by chunk and without compressing them anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femgal.output.atomic import replacing
from femgal.output.hdf5 import local_object, open_for_reading
from femgal.output.vtkhdf_layout import (
    ROW_COUNTS,
    create_empty,
    create_growing,
    is_static,
    open_for_writing,
    rows_per_frame,
    write_header,
)
from meshes.errors import InputError
from meshes.types import TetMesh

if TYPE_CHECKING:
    import h5py

_ADVICE = "start anew with another --out"
_ONCE = (
    "NumberOfPoints",
    "NumberOfCells",
    "NumberOfConnectivityIds",
    "Connectivity",
    "Offsets",
    "Types",
    "Points",
)


def reopen(path: Path, mesh: TetMesh, frames: int) -> h5py.File:
    """Return the series opened for writing, with exactly `frames` frames.

    Raises
    ------
    InputError
        Missing, damaged, of another mesh, or with fewer frames.
    OSError
        No room for the copy; the file is as it was.
    """
    with open_for_reading(path, "series to resume", _ADVICE) as file:
        root = local_object(file, "VTKHDF")
        _check(path, root, mesh, frames)
        killed = bool(root.attrs.get("NotClosed", True))
    if killed:
        _replace_by_copy(path, frames)
    file = open_for_writing(path)
    root = file["VTKHDF"]
    root.attrs.modify("NotClosed", np.uint8(1))
    root["Steps"].attrs.modify("NSteps", np.int64(frames))
    file.flush()
    if not killed:
        _cut_back(root, frames)
        file.flush()
    return file


def _check(path: Path, root: h5py.Group, mesh: TetMesh, frames: int) -> None:
    present = int(local_object(root, "Steps").attrs["NSteps"])
    if present < frames:
        raise _not_resumable(path, f"{present} frames", f"{frames} or more frames")
    counts = tuple(int(local_object(root, name)[0]) for name in ROW_COUNTS.values())
    wanted = len(mesh.points), len(mesh.cells)
    if counts != wanted:
        raise _not_resumable(path, "{} vertices, {} tetrahedra".format(*counts), "{} and {}".format(*wanted))
    same_cells = np.array_equal(local_object(root, "Connectivity")[:], mesh.cells.ravel())
    if not same_cells or not np.array_equal(local_object(root, "Points")[:], mesh.points):
        raise _not_resumable(path, "another mesh of the same size", "the mesh of the run being resumed")


def _cut_back(root: h5py.Group, frames: int) -> None:
    for data, stride in _growing_arrays(root):
        if len(data) > frames * stride:
            data.resize(frames * stride, axis=0)


def _replace_by_copy(path: Path, frames: int) -> None:
    import h5py

    with replacing(path) as part, h5py.File(path, "r", locking=False) as old, create_empty(part) as file:
        root, target = old["VTKHDF"], write_header(file)
        for name in _ONCE:
            root.copy(local_object(root, name), target, name)
        for group in ROW_COUNTS:
            for name, data in root[group].items():
                if is_static(data):
                    root.copy(data, target[group], name)
        for data, stride in _growing_arrays(root):
            _copy_rows(data, target, frames * stride)
        target["Steps"].attrs.modify("NSteps", np.int64(frames))


def _copy_rows(data: h5py.Dataset, root: h5py.Group, rows: int) -> None:
    place, _, name = data.name.removeprefix("/VTKHDF/").rpartition("/")
    filters = {"compression": data.compression, "compression_opts": data.compression_opts, "shuffle": data.shuffle}
    copy = create_growing(root[place], name, data.shape[1:], data.dtype, data.chunks[0], **filters)
    copy.resize(rows, axis=0)
    for key, value in data.attrs.items():
        copy.attrs[key] = value
    if not data.compression:
        copy[:] = data[:rows]
        return
    for start in range(0, rows, data.chunks[0]):
        corner = (start,) + (0,) * (data.ndim - 1)
        mask, chunk = data.id.read_direct_chunk(corner)
        copy.id.write_direct_chunk(corner, chunk, mask)


def _growing_arrays(root: h5py.Group) -> Iterator[tuple[Any, int]]:
    """Every array that grows, with its rows per frame."""
    for item in root["Steps"].values():
        for data in item.values() if hasattr(item, "keys") else [item]:
            yield data, 1
    for data in root["FieldData"].values():
        yield data, 1
    for group, count in ROW_COUNTS.items():
        for data in root[group].values():
            if not is_static(data):
                yield data, rows_per_frame(data, int(root[count][0]))


def _not_resumable(path: Path, found: str, allowed: str) -> InputError:
    return InputError("this series cannot be resumed", where=str(path), found=found, allowed=allowed, advice=_ADVICE)
