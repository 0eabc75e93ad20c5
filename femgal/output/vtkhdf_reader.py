# SPDX-License-Identifier: BSD-3-Clause
"""Reads the .vtkhdf series that `femgal.output.vtkhdf` writes, also while it is being written."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from femgal.output.hdf5 import local_object, open_for_reading
from femgal.output.series import Array, Kind, checked_frame
from meshes.errors import InputError

if TYPE_CHECKING:
    import h5py

Result = TypeVar("Result")
_GROUPS = {"point": ("PointData", "NumberOfPoints"), "cell": ("CellData", "NumberOfCells")}


class VtkHdfReader:
    """A `SeriesReader` of one .vtkhdf file.

    The file is opened anew for every question: HDF5 caches what it has seen, and would hide newer frames.

    Parameters
    ----------
    path : Path
        File to read.

    Raises
    ------
    InputError
        Missing or damaged file, data outside the file, no such array or frame.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read(_frames)

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the frames [s], shape [n_frames]."""

        def read(root: h5py.Group) -> NDArray[np.float64]:
            n_frames = _frames(root)
            return local_object(root, "Steps/Values")[:n_frames] if n_frames else np.empty(0)

        return self._read(read)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Rest positions [m], shape [n_vertices, 3]."""
        return self._read(lambda root: np.asarray(local_object(root, "Points")[:], np.float64))

    @cached_property
    def cells(self) -> NDArray[np.int32]:
        """Vertex indices, shape [n_tets, 4]."""
        return self._read(lambda root: local_object(root, "Connectivity")[:].reshape(-1, 4).astype(np.int32))

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Names of the point or cell arrays, sorted."""
        return self._read(lambda root: tuple(sorted(local_object(root, _GROUPS[kind][0]))))

    def array(self, kind: Kind, name: str, frame: int) -> Array:
        """One array of one frame, shape [rows] or [rows, components]."""
        group, count = _GROUPS[kind]

        def read(root: h5py.Group) -> Array:
            step = checked_frame(frame, _frames(root), str(self._path))
            if name not in local_object(root, group):
                allowed = ", ".join(sorted(local_object(root, group))) or "none"
                raise InputError(f"no such {kind} array", where=str(self._path), found=name, allowed=allowed)
            start = int(local_object(root, f"Steps/{group}Offsets/{name}")[step])
            rows = int(local_object(root, count)[0])
            return local_object(root, f"{group}/{name}")[start : start + rows]

        return self._read(read)

    def field_data(self, frame: int) -> dict[str, float]:
        """Return the numbers of one frame."""

        def read(root: h5py.Group) -> dict[str, float]:
            step = checked_frame(frame, _frames(root), str(self._path))
            return {
                name: float(local_object(root, f"FieldData/{name}")[step]) for name in local_object(root, "FieldData")
            }

        return self._read(read)

    def _read(self, question: Callable[[Any], Result]) -> Result:
        with open_for_reading(self._path, "VTKHDF series") as file:
            return question(local_object(file, "VTKHDF"))


def _frames(root: h5py.Group) -> int:
    return int(local_object(root, "Steps").attrs["NSteps"])
