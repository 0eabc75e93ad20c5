# SPDX-License-Identifier: BSD-3-Clause
"""A time series of one mesh, whatever the file format: the interface of its writers and readers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError
from meshes.types import TetMesh

Array = NDArray[Any]
Kind = Literal["point", "cell"]
Format = Literal["vtkhdf", "vtu"]


class SeriesWriter(Protocol):
    """Writes frames one after the other; frame 0 is the initial state."""

    @property
    def frames_written(self) -> int:
        """Frames that a reader finds now."""
        ...

    def append(
        self,
        time: float,
        point_data: Mapping[str, Array],
        cell_data: Mapping[str, Array],
        field_data: Mapping[str, float],
    ) -> None:
        """Write one frame.

        Parameters
        ----------
        time : float
            Time [s].
        point_data, cell_data : mapping of name to array
            One row per vertex or tetrahedron; the same names at every frame. `displacement` carries the motion.
        field_data : mapping of name to float
            Numbers of the whole frame, energies for example.

        Raises
        ------
        ValueError
            Wrong shapes, or other names than at the frame before.
        OSError
            The disk is full or gone; frames written before stay readable.
        """
        ...

    def close(self) -> None:
        """Finish the files; a second call does nothing."""
        ...


class SeriesReader(Protocol):
    """Reads a series, also while it is still being written."""

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the frames [s], shape [n_frames]."""
        ...

    @property
    def points(self) -> NDArray[np.float64]:
        """Rest positions [m], shape [n_vertices, 3]."""
        ...

    @property
    def cells(self) -> NDArray[np.int32]:
        """Vertex indices, shape [n_tets, 4]."""
        ...

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Names of the point or cell arrays, sorted."""
        ...

    def array(self, kind: Kind, name: str, frame: int) -> Array:
        """One array of one frame, shape [rows] or [rows, components]."""
        ...

    def field_data(self, frame: int) -> dict[str, float]:
        """Return the numbers of one frame."""
        ...


def open_series(
    folder: Path,
    mesh: TetMesh,
    *,
    format: Format = "vtkhdf",
    static_cell_data: Mapping[str, Array] | None = None,
    static_point_data: Mapping[str, Array] | None = None,
    resume_frames: int | None = None,
) -> SeriesWriter:
    """Start a series in `folder`, or go on with the one that is there.

    Parameters
    ----------
    folder : Path
        Existing output folder.
    mesh : TetMesh
        Rest mesh.
    format : "vtkhdf" or "vtu"
        One temporal file `frames.vtkhdf` (ParaView >= 5.12), or `frames.pvd` with one `frames/frame_*.vtu` each.
    static_cell_data, static_point_data : mapping of name to array
        Arrays that never change; visible at every frame.
    resume_frames : int, optional
        Keep the first so many frames of the existing series, drop the rest, and append.

    Raises
    ------
    InputError
        Unknown format, or a series that cannot be resumed: missing, of another mesh, with fewer frames.
    """
    if format not in get_args(Format):
        raise InputError("unknown output format", found=repr(format), allowed=", ".join(get_args(Format)))
    static = {"point": static_point_data or {}, "cell": static_cell_data or {}}
    if format == "vtu":
        from femgal.output.vtu import VtuWriter

        return VtuWriter(folder, mesh, static=static, resume_frames=resume_frames)
    from femgal.output.vtkhdf import VtkHdfWriter

    return VtkHdfWriter(folder / "frames.vtkhdf", mesh, static=static, resume_frames=resume_frames)


def checked_frame(frame: int, n_frames: int, where: str) -> int:
    """Return `frame` as 0 ... n_frames - 1; negative numbers count from the end.

    Raises
    ------
    InputError
        There is no such frame.
    """
    if not -n_frames <= frame < n_frames:
        allowed = f"0 to {n_frames - 1}, or -1 for the last" if n_frames else "none: the series has no frame yet"
        raise InputError("no such frame", where=where, found=frame, allowed=allowed)
    return frame % n_frames


def refuse_other_names(before: set[str], now: set[str], what: str) -> None:
    """Raise ValueError when the arrays of a frame are not those of the frames before."""
    if before != now:
        raise ValueError(f"{what} arrays changed between frames: had {sorted(before)}, got {sorted(now)}")
