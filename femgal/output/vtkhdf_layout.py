# SPDX-License-Identifier: BSD-3-Clause
"""Layout of a temporal VTKHDF file (docs.vtk.org, "VTKHDF format specification", version 2.2).

VTKHDF                     @Version, @Type, @NotClosed (ours: 1 while a writer has it open, or was killed)
  NumberOfPoints, NumberOfCells, NumberOfConnectivityIds, Connectivity, Offsets, Types, Points      once
  PointData, CellData      static arrays once; others one block of rows per frame
  FieldData                one number per frame
  Steps                    @NSteps; Values (times) and for every array above the row where its frame starts
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femgal.output.arrays import storable_all
from femgal.output.fields import find_field, unit_of
from femgal.output.series import Array
from meshes.types import TetMesh

if TYPE_CHECKING:
    import h5py

GROUPS = {"point": "PointData", "cell": "CellData"}
ROW_COUNTS = {"PointData": "NumberOfPoints", "CellData": "NumberOfCells"}
COMPRESSION: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
STEP_CHUNK = 64  # frames per chunk of the arrays with one entry per frame
_VTK_TETRA = 10


def open_for_writing(path: Path) -> h5py.File:
    """Open an existing file so that new datasets get extensible-array indices; see `femgal.output.vtkhdf`, point 3."""
    import h5py

    return h5py.File(path, "r+", libver=("v110", "v110"), locking=False)


def create_empty(path: Path) -> h5py.File:
    """Create a file with an old superblock, and open it for writing."""
    import h5py

    h5py.File(path, "w", libver=("earliest", "v110"), locking=False).close()
    return open_for_writing(path)


def write_header(file: h5py.File) -> h5py.Group:
    """Write attributes and empty groups; return the VTKHDF group."""
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array([2, 2], np.int64)
    root.attrs["Type"] = np.bytes_("UnstructuredGrid")
    root.attrs["NotClosed"] = np.uint8(1)
    for group in ("PointData", "CellData", "FieldData"):
        root.create_group(group)
        root.create_group(f"Steps/{group}Offsets")
    root.create_group("Steps/FieldDataSizes")
    root["Steps"].attrs["NSteps"] = np.int64(0)
    return root


def write_static(root: h5py.Group, mesh: TetMesh, static: Mapping[str, Mapping[str, Array]]) -> None:
    """Write everything that does not change from frame to frame."""
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
        root.create_dataset(name, data=block, chunks=True, **COMPRESSION)
    root["Points"].attrs["unit"] = "m"
    for kind, rows in (("point", len(mesh.points)), ("cell", n_cells)):
        for name, array in storable_all(static.get(kind, {}), rows).items():
            data = root[GROUPS[kind]].create_dataset(name, data=array, chunks=True, **COMPRESSION)
            data.attrs["static"] = np.uint8(1)
            annotate(data, name)


def create_growing(
    group: h5py.Group, name: str, tail: tuple[int, ...], dtype: np.dtype[Any], chunk: int, **filters: Any
) -> h5py.Dataset:
    """Create an empty dataset that grows along its first axis."""
    return group.create_dataset(
        name, shape=(0, *tail), maxshape=(None, *tail), chunks=(chunk, *tail), dtype=dtype, **filters
    )


def annotate(data: h5py.Dataset, name: str) -> None:
    """Write unit and description of a field that the catalogue knows."""
    field = find_field(name)
    if unit_of(name):
        data.attrs["unit"] = unit_of(name)
    if field:
        data.attrs["description"] = field.description


def is_static(data: h5py.Dataset) -> bool:
    """Return whether the array is stored once."""
    return bool(data.attrs.get("static", False))


def rows_per_frame(data: h5py.Dataset, rows: int) -> int:
    """Rows from one frame to the next: whole chunks; see `femgal.output.vtkhdf`, point 2."""
    chunk = data.chunks[0]
    return chunk * -(-rows // chunk)
