# SPDX-License-Identifier: BSD-3-Clause
"""A motion as somebody has written it, whatever the format.

* A run folder, a .pvd list of .vtu files or a .vtkhdf file: rest positions, and the point array ``displacement`` at
  every frame; ``velocity`` is used where it is there. A .pvd whose points move and that has no such array will do too:
  then its first frame has to be the start of the scene.
* A .csv file, see `verify.compare.csv_file`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from femgal.output.read import SavedRun, read_run
from meshes.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ForeignMotion:
    """Frames of n vertices in somebody else's order.

    Parameters
    ----------
    name : Of the file.
    times : Of the frames [s], shape [f]; of a table of frame numbers these numbers, see `counted`.
    x : Positions [m], shape [f, n, 3]; may hold what is no number.
    rest : Rest positions [m], shape [n, 3]; None where the file does not have them.
    cells : Vertex indices of the tetrahedra, shape [m, 4]; None where the file does not have them.
    v : Velocities [m/s], shape [f, n, 3]; None where the file does not have them.
    counted : Whether `times` are frame numbers.
    displacements : Whether `x` are displacements from rest positions that only the scene knows.
    """

    name: str
    times: Floats
    x: Floats
    rest: Floats | None = None
    cells: NDArray[np.int32] | None = None
    v: Floats | None = None
    counted: bool = False
    displacements: bool = False


def read_motion(path: Path | str) -> ForeignMotion:
    """Read a result.

    Raises
    ------
    InputError
        Nothing there, another format, or damaged.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        from verify.compare.csv_file import read_csv

        return read_csv(path)
    run = read_run(path)
    if not run.n_frames:
        raise InputError("holds no frame", where=str(path), found="0 frames", allowed="1 or more")
    rest = np.asarray(run.series.points, np.float64)
    x = np.stack([_positions(run, rest, frame) for frame in range(run.n_frames)])
    # Points that move tell where the body starts, not where it is at rest.
    known = rest if "displacement" in run.point_names else None
    v = None
    if "velocity" in run.point_names:
        v = np.stack([np.asarray(run.point_data("velocity", k), np.float64) for k in range(run.n_frames)])
    return ForeignMotion(path.name, run.times, x, known, np.asarray(run.series.cells), v)


def _positions(run: SavedRun, rest: Floats, frame: int) -> Floats:
    from femgal.output.vtu_reader import VtuReader

    if "displacement" in run.point_names:
        array = run.series.array("point", "displacement", frame)
        if array.shape != rest.shape:
            raise InputError(
                "displacements do not match the points", where=str(run.path), found=array.shape, allowed=rest.shape
            )
        return rest + np.asarray(array, np.float64)
    if isinstance(run.series, VtuReader):
        points = run.series.points_of(frame)
        if points.shape != rest.shape:
            raise InputError(
                "the number of points changes", where=str(run.path), found=points.shape, allowed=rest.shape
            )
        return points
    raise InputError(
        "no displacements",
        where=str(run.path),
        found="point arrays " + (", ".join(run.point_names) or "none"),
        allowed="a point array 'displacement' with three components [m]",
    )
