# SPDX-License-Identifier: BSD-3-Clause
"""From a name or path to a tetrahedral mesh that a solver can use: what scenes call."""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

from meshes import generators
from meshes.catalogue import Entry, resolve
from meshes.errors import InputError
from meshes.io.source import readable
from meshes.io.surfaces import SURFACE_SUFFIXES, read_surface, surface_of
from meshes.io.tets import read_raw, tets_of
from meshes.types import Origin, TetMesh, TriMesh

if TYPE_CHECKING:
    from meshes.distance import SurfaceDistance

AnyMesh = TypeVar("AnyMesh", TetMesh, TriMesh)

DEFAULT_VERTICES = 5000
_SMALLEST, _LARGEST = 8, 100_000_000


@dataclass(frozen=True)
class Made:
    """A tetrahedral mesh and how it came about.

    Parameters
    ----------
    mesh : Morton-ordered mesh; its origin names the source file and digest.
    surface : The closed surface that was filled; None for tetrahedral files and grids.
    report : What the tetrahedralisation reports, ready for JSON; None where there was none.
    messages : Repairs and warnings for people.
    """

    mesh: TetMesh
    surface: TriMesh | None = None
    report: dict[str, Any] | None = None
    messages: list[str] = field(default_factory=list)

    def distance(self) -> SurfaceDistance | None:
        """How far the mesh's boundary is from the surface (forward) and back; takes as long as the mesh itself."""
        if self.surface is None:
            return None
        from meshes.distance import surface_distance
        from meshes.stuffing.report import skin_of

        return surface_distance(skin_of(self.mesh), self.surface)


def make_tets(name_or_path: str | os.PathLike[str], vertices: int | None = None) -> Made:
    """Load, fill or generate a tetrahedral mesh.

    Parameters
    ----------
    name_or_path : Catalogue name (`meshes.catalogue.resolve`) or file.
    vertices : Wanted number of vertices, met within 5%; 5000 (a beam: its 15 x 5 x 5 cells) when None. Tetrahedral
        files come as they are and refuse a number.

    Raises
    ------
    MeshError
        Unknown name, or a mesh that no solver should see; see the readers.
    InputError
        ``vertices`` out of range, or given for a tetrahedral file.
    """
    from meshes.ordering import reorder  # here: who only looks at files needs no compiler

    entry = resolve(name_or_path)
    if vertices is not None and not _SMALLEST <= vertices <= _LARGEST:
        raise InputError(
            "impossible vertex count", where=entry.name, found=vertices, allowed=f"{_SMALLEST} to {_LARGEST}"
        )
    made = _generated(entry.name, vertices) if entry.path is None else _from_file(entry, vertices)
    mesh, _, _ = reorder(made.mesh)
    _log(mesh)
    return replace(made, mesh=mesh)


def _generated(name: str, vertices: int | None) -> Made:
    if name == "rabbit":
        from meshes.rabbit import rabbit_surface

        wanted = vertices or DEFAULT_VERTICES
        # Triangles half as wide as the tetrahedra, never fewer than look smooth.
        triangles = max(40_000, int(10_000 * (wanted / 5_000) ** (2.0 / 3.0)))
        return _filled(rabbit_surface(triangles), wanted)
    if name == "sphere":
        return Made(generators.sphere(vertices or DEFAULT_VERTICES))
    if name == "cube":
        return _grid(generators.cube(vertices or DEFAULT_VERTICES), vertices)
    return _grid(generators.beam(vertices=vertices), vertices)


def _grid(mesh: TetMesh, asked: int | None) -> Made:
    found = len(mesh.points)
    off = asked is not None and abs(found - asked) > 0.05 * asked
    return Made(mesh, messages=[f"asked for {asked} vertices: the nearest grid has {found}"] if off else [])


def load(entry: Entry) -> Made | TriMesh:
    """Return what an entry holds, unfilled: a surface, or a tetrahedral mesh with messages.

    Procedural entries are made at their default size. Raises as `make_tets`.
    """
    if entry.path is None:
        return _generated(entry.name, None)
    path = readable(entry.path)
    if path.suffix.lower() in SURFACE_SUFFIXES:
        return _credited(read_surface(path), entry)
    raw = read_raw(path)
    counts = raw.counts()
    if not counts["tetra"] and set(counts) & {"triangle", "quad"}:
        return _credited(surface_of(raw, path), entry)
    mesh, messages = tets_of(raw, path)
    return Made(_credited(mesh, entry), messages=messages)


def _from_file(entry: Entry, vertices: int | None) -> Made:
    loaded = load(entry)
    if isinstance(loaded, TriMesh):
        return _filled(loaded, vertices or DEFAULT_VERTICES)
    if vertices is not None:
        raise InputError(
            "a tetrahedral mesh is used as it is, it cannot be given another number of vertices",
            where=entry.source,
            found=f"vertices = {vertices}, the file has {len(loaded.mesh.points)}",
            advice="leave the number out, or give a closed surface instead",
        )
    from meshes.quality import quality

    return replace(loaded, messages=loaded.messages + list(quality(loaded.mesh).warnings))


def _filled(surface: TriMesh, vertices: int) -> Made:
    from meshes.stuffing.tetrahedralise import tetrahedralise
    from meshes.surface import outward

    mesh, report = tetrahedralise(surface, vertices)
    messages = [report.warning] if report.warning else []
    return Made(replace(mesh, origin=surface.origin), outward(surface), report.as_dict(), messages)


def _credited(mesh: AnyMesh, entry: Entry) -> AnyMesh:
    origin = mesh.origin
    return replace(mesh, origin=Origin(entry.name, origin.source, origin.sha256, entry.terms))


def _log(mesh: TetMesh) -> None:
    origin = mesh.origin
    logging.getLogger("meshes").info(
        "mesh %s: %d vertices, %d tetrahedra from %s%s",
        origin.name,
        len(mesh.points),
        len(mesh.cells),
        origin.source,
        f", sha256 {origin.sha256}" if origin.sha256 else "",
    )
