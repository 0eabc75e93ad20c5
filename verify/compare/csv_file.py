# SPDX-License-Identifier: BSD-3-Clause
"""A motion as a table of text: one line per vertex and frame, in any order, commas between the columns.

    frame,vertex,ux,uy,uz
    0,0,0.0,0.0,0.0
    0,1,0.0,0.0,0.0
    1,0,0.0,0.0,-0.0013

The first line names the columns, which may stand in any order:

* ``frame`` (0 is the start) or ``time`` [s];
* ``vertex``, counted from 0 in the order of the mesh file, or in any order where rest positions are given;
* ``ux, uy, uz``, displacements from rest [m], or ``x, y, z``, positions [m];
* ``X, Y, Z``, rest positions [m], may be added: vertices are then known by where they are;
* ``vx, vy, vz``, velocities [m/s], may be added.

Other columns are ignored. Every frame holds every vertex once.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError
from meshes.io.source import readable
from verify.compare.result import ForeignMotion

Floats = NDArray[np.float64]

_ALLOWED = "frame or time; vertex; ux,uy,uz or x,y,z; X,Y,Z and vx,vy,vz may be added"


def read_csv(path: Path) -> ForeignMotion:
    """Read a table of the columns above.

    Raises
    ------
    InputError
        No such file, columns missing, text in place of numbers, a frame that lacks a vertex or has one twice.
    """
    names, table = _table(readable(path), str(path))
    when, where = (
        _one_of(names, ("frame",), ("time",), str(path)),
        _one_of(names, ("x", "y", "z"), ("ux", "uy", "uz"), str(path)),
    )
    if "vertex" not in names:
        raise InputError("no column of vertices", where=str(path), found=",".join(names), allowed=_ALLOWED)
    order = np.lexsort((table[:, names.index("vertex")], table[:, names.index(when[0])]))
    table = table[order]
    times, n = _frames(table[:, names.index(when[0])], table[:, names.index("vertex")], str(path))

    def columns(wanted: Sequence[str]) -> Floats | None:
        if not set(wanted) <= set(names):
            return None
        return np.ascontiguousarray(table[:, [names.index(name) for name in wanted]]).reshape(len(times), n, 3)

    x, rest, displacements = columns(where), columns(("X", "Y", "Z")), where[0] == "ux"
    assert x is not None
    if rest is not None and displacements:
        x, displacements = rest + x, False
    return ForeignMotion(
        path.name,
        times,
        x,
        None if rest is None else rest[0],
        v=columns(("vx", "vy", "vz")),
        counted=when[0] == "frame",
        displacements=displacements,
    )


def _table(path: Path, where: str) -> tuple[list[str], Floats]:
    try:
        with path.open(encoding="utf-8-sig") as stream:
            names = [name.strip() for name in stream.readline().split(",")]
            lines = [line for line in stream if line.strip()]
        table = np.loadtxt(lines, delimiter=",", ndmin=2) if lines else np.empty((0, len(names)))
    except ValueError as error:  # also what is no UTF-8
        raise InputError("not a table of numbers", where=where, found=str(error), allowed=_ALLOWED) from None
    if not len(table):
        raise InputError("holds no frame", where=where, found=f"{','.join(names)} and no lines", allowed=_ALLOWED)
    if table.shape[1] != len(names):
        found = f"{len(table)} lines of {table.shape[1]} numbers, {len(names)} names"
        raise InputError("names and columns do not match", where=where, found=found, allowed="a number for each name")
    return names, table


def _one_of(names: Sequence[str], first: Sequence[str], second: Sequence[str], where: str) -> Sequence[str]:
    for wanted in (first, second):
        if set(wanted) <= set(names):
            return wanted
    found = ",".join(names)
    allowed = f"{','.join(first)} or {','.join(second)}"
    raise InputError("columns are missing", where=where, found=found, allowed=allowed, advice=f"columns are {_ALLOWED}")


def _frames(when: Floats, vertex: Floats, where: str) -> tuple[Floats, int]:
    """Times or numbers of the frames, and the number of vertices; rows are sorted by both."""
    times, counts = np.unique(when, return_counts=True)
    n = int(counts.max())
    short = np.flatnonzero(counts != n)
    if len(short):
        raise InputError(
            "a frame is not complete",
            where=where,
            found=f"{counts[short[0]]} lines at {times[short[0]]:g}",
            allowed=f"{n} lines, one per vertex, as at {times[int(np.argmax(counts))]:g}",
        )
    expected = np.tile(np.arange(n), len(times))
    wrong = np.flatnonzero(vertex != expected)
    if len(wrong):
        raise InputError(
            "vertices are not numbered from 0, each once per frame",
            where=where,
            found=f"vertex {vertex[wrong[0]]:g} at {when[wrong[0]]:g}",
            allowed=f"0 to {n - 1}",
        )
    return times, n
