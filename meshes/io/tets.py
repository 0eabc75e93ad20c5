# SPDX-License-Identifier: BSD-3-Clause
"""Read and write tetrahedral meshes."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes.errors import InputError, MeshError
from meshes.io.gaia import read_t, write_t
from meshes.io.meshio_reader import FORMATS, read_with_meshio
from meshes.io.raw import RawMesh
from meshes.io.repair import drop_unused, refuse_repeated, repair_winding
from meshes.io.source import file_origin, readable, writable
from meshes.types import TetMesh, checked_cells, checked_points, checked_regions

# Names under which formats and programs keep the material or part of a cell, the most explicit first.
REGION_NAMES = (
    "region",
    "regions",
    "gmsh:physical",
    "medit:ref",
    "nastran:ref",
    "avsucd:material",
    "ugrid:ref",
    "cell_tags",
)
# Cells of lower dimension often accompany a volume mesh: its boundary, feature lines, corner points.
_BOUNDARY = {"vertex", "line", "triangle", "quad", "polygon"}
# Suffix -> meshio module and the name under which regions are kept there ("" = the format has none).
_WRITERS = {
    ".msh": ("gmsh", "gmsh:physical"),
    ".vtk": ("vtk", "region"),
    ".vtu": ("vtu", "region"),
    ".mesh": ("medit", "medit:ref"),
    ".xdmf": ("xdmf", "region"),
    ".inp": ("abaqus", ""),
    ".nas": ("nastran", "nastran:ref"),
    ".bdf": ("nastran", "nastran:ref"),
    ".avs": ("avsucd", "avsucd:material"),
    ".su2": ("su2", ""),
}
READABLE = (".t", *FORMATS)
WRITABLE = (".t", *_WRITERS)


def read_tets(path: str | Path) -> tuple[TetMesh, list[str]]:
    """Read, check and repair a tetrahedral mesh.

    Parameters
    ----------
    path : File in one of the formats `READABLE`, chosen by suffix.

    Returns
    -------
    mesh : TetMesh
        With positive volumes; regions from the file where it has any; origin with path and SHA-256.
    messages : list of str
        What was repaired, dropped or found: winding, unused vertices, boundary cells, regions.

    Raises
    ------
    MeshError
        Missing, unreadable, empty or damaged file; no tetrahedra or other volume cells; index out of range; NaN;
        tetrahedra of zero volume.
    """
    path = readable(path)
    return tets_of(read_raw(path), path)


def read_raw(path: Path) -> RawMesh:
    """Read a file of a volume format without any check of its contents."""
    suffix = path.suffix.lower()
    if suffix == ".t":
        return read_t(path)
    if suffix in FORMATS:
        return read_with_meshio(path)
    raise MeshError("unknown mesh format", where=str(path), found=suffix or "no suffix", allowed=", ".join(READABLE))


def tets_of(raw: RawMesh, path: Path) -> tuple[TetMesh, list[str]]:
    """Check and repair what a file holds; see `read_tets`."""
    where = str(path)
    _refuse_other_cells(raw, where)
    messages = list(raw.messages)
    beside = {kind: number for kind, number in raw.counts().items() if kind in _BOUNDARY}
    if beside:
        messages.append("ignored " + ", ".join(f"{number} {kind}" for kind, number in beside.items()) + " cells")
    regions = _regions(raw, where, messages)
    points = checked_points(raw.points, where)
    cells = checked_cells(raw.cells("tetra", 4), len(points), 4, "tetrahedron", where)
    points, cells, dropped = drop_unused(points, cells)
    cells, turned = repair_winding(points, cells, where)
    refuse_repeated(cells, where)
    mesh = TetMesh(points, cells, file_origin(path), regions)
    return mesh, messages + dropped + turned


def write_tets(path: str | Path, mesh: TetMesh) -> list[str]:
    """Write a tetrahedral mesh in the format of the suffix; returns remarks, for instance that regions were left out.

    ``.msh`` is written as version 4.1; with regions other than 0 as version 2.2, which keeps a tag per cell, so that
    the order of the cells survives.

    Raises
    ------
    InputError
        Unknown suffix, missing folder, or the file cannot be written.
    """
    path = writable(path)
    suffix = check_format(path)
    try:
        if suffix == ".t":
            write_t(path, mesh)
        else:
            _write_with_meshio(path, mesh, *_WRITERS[suffix])
    except OSError as error:
        raise InputError("cannot be written", where=str(path), found=error.strerror or str(error)) from error
    name = "" if suffix == ".t" else _WRITERS[suffix][1]
    return [] if name or not np.any(mesh.regions) else [f"{suffix} has no place for regions: they were left out"]


def check_format(path: Path) -> str:
    """Return the suffix when tetrahedra can be written in its format, else raise InputError."""
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise InputError(
            "tetrahedra cannot be written in this format",
            where=str(path),
            found=suffix or "no suffix",
            allowed=", ".join(WRITABLE),
        )
    return suffix


def _write_with_meshio(path: Path, mesh: TetMesh, module: str, region: str) -> None:
    import meshio

    data: dict[str, list[Any]] = {region: [mesh.regions]} if region else {}
    options: dict[str, Any] = {}
    if module == "gmsh":
        data["gmsh:geometrical"] = [np.ones(len(mesh.cells), np.int32)]
        options["fmt_version"] = "2.2" if np.any(mesh.regions) else "4.1"
    if module == "xdmf":
        options["data_format"] = "XML"  # one file; "HDF" would write a second one beside it
    contents = meshio.Mesh(mesh.points, [("tetra", mesh.cells)], cell_data=data)
    import_module(f"meshio.{module}").write(str(path), contents, **options)


def _refuse_other_cells(raw: RawMesh, where: str) -> None:
    counts = raw.counts()
    others = set(counts) - _BOUNDARY - {"tetra"}
    if counts["tetra"] and not others:
        return
    advice = "split or convert the other cells" if others else "for a closed surface ask for a number of vertices"
    if any(kind.startswith("tetra1") for kind in others):
        advice = "export with linear elements (order 1)"
    raise MeshError(
        "holds cells other than linear tetrahedra" if others else "holds no tetrahedra",
        where=where,
        found=raw.summary(),
        allowed="linear tetrahedra, and boundary cells, which are ignored",
        advice=advice,
    )


def _regions(raw: RawMesh, where: str, messages: list[str]) -> NDArray[np.int32]:
    name = next((name for name in REGION_NAMES if name in raw.data), None)
    n_tets = raw.counts()["tetra"]
    if name is None:
        return np.zeros(n_tets, np.int32)
    regions = checked_regions(raw.cell_data(name, "tetra"), n_tets, f"{where}, region data '{name}'")
    ids = np.unique(regions).tolist()
    shown = ", ".join(map(str, ids[:8])) + (" ..." if len(ids) > 8 else "")
    messages.append(f"regions from '{name}': {len(ids)} ({shown})")
    return regions
