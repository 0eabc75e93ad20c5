# SPDX-License-Identifier: BSD-3-Clause
"""Meshes that were made before, kept on disk: a run starts sooner when its surface need not be filled again.

A file is named by a hash of everything that the mesh depends on: the surface's bytes or the procedural name, the number
of vertices, every source file of this package and the version of NumPy. It holds the arrays as they were made, so a
kept mesh is the made one, bit for bit. What cannot be read, or is not whole, is made anew.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from meshes.cache import cache_root
from meshes.catalogue import Entry, resolve
from meshes.io.source import readable
from meshes.io.surfaces import SURFACE_SUFFIXES
from meshes.make import Made, make_tets
from meshes.types import Origin, TetMesh, TriMesh

MOST_BYTES = 2_000_000_000  # of all kept meshes; one of a million vertices has 0.15e9
_FILLED = ("rabbit", "sphere")  # procedural meshes that take longer to make than to read


def make_or_find_tets(name_or_path: str | os.PathLike[str], vertices: int | None = None) -> Made:
    """Return what `meshes.make.make_tets` makes, from disk where it was made before; arguments and errors are its."""
    entry = resolve(name_or_path)
    if not _is_filled(entry):
        return make_tets(name_or_path, vertices)
    file = mesh_folder() / f"{_key(entry, vertices)}.npz"
    found = _read(file)
    if found is not None:
        logging.getLogger("meshes").info("mesh %s: as made before, from %s", entry.name, file)
        return found
    made = make_tets(name_or_path, vertices)
    with suppress(OSError):  # no room, or no right to write: the mesh is there all the same
        _write(file, made)
    return made


def mesh_folder() -> Path:
    """Folder of the kept meshes."""
    return cache_root() / "meshes-made"


def _is_filled(entry: Entry) -> bool:
    return entry.name in _FILLED if entry.path is None else entry.path.suffix.lower() in SURFACE_SUFFIXES


def _key(entry: Entry, vertices: int | None) -> str:
    where = (entry.name, entry.source, entry.terms, vertices, np.__version__)
    digest = hashlib.sha256(json.dumps([*where, _sources()]).encode())
    if entry.path is not None:
        with readable(entry.path).open("rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()[:32]


@cache
def _sources() -> str:
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(f"{source.relative_to(package)} {source.stat().st_size}\n".encode() + source.read_bytes())
    return digest.hexdigest()


def _write(file: Path, made: Made) -> None:
    """Write to a temporary file and rename it, so that no one ever sees half a mesh; then make room."""
    file.parent.mkdir(parents=True, exist_ok=True)
    facts = {"origin": asdict(made.mesh.origin), "report": made.report, "messages": made.messages}
    arrays: dict[str, Any] = {"points": made.mesh.points, "cells": made.mesh.cells}
    if made.surface is not None:
        arrays |= {"surface_points": made.surface.points, "surface_cells": made.surface.cells}
        facts["surface_origin"] = asdict(made.surface.origin)
    with tempfile.NamedTemporaryFile(dir=file.parent, prefix=".part-", delete=False) as part:
        try:
            np.savez(part, facts=np.frombuffer(json.dumps(facts).encode(), np.uint8), **arrays)
            part.close()
            os.replace(part.name, file)
        finally:
            Path(part.name).unlink(missing_ok=True)
    _make_room(file)


def _read(file: Path) -> Made | None:
    """Return a kept mesh; None when it is not there or fails any check (the archive's own checksums among them)."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        made = _unpacked(arrays, json.loads(arrays["facts"].tobytes()))
    except FileNotFoundError:
        return None
    except Exception as error:  # whatever is wrong with a copy, the original can be made
        logging.getLogger("meshes").warning("%s cannot be used, the mesh is made anew: %s", file, error)
        return None
    with suppress(OSError):
        os.utime(file)  # used now: the last to go
    return made


def _unpacked(arrays: dict[str, Any], facts: dict[str, Any]) -> Made:
    surface = None
    if "surface_points" in arrays:
        surface = TriMesh(arrays["surface_points"], arrays["surface_cells"], Origin(**facts["surface_origin"]))
    mesh = TetMesh(arrays["points"], arrays["cells"], Origin(**facts["origin"]))
    return Made(mesh, surface, facts["report"], facts["messages"])


def _make_room(newest: Path) -> None:
    """Remove the meshes used longest ago until all take MOST_BYTES, and parts left by a process that was killed."""
    found = []
    for file in newest.parent.iterdir():
        with suppress(OSError):  # another process was quicker
            found.append((file.stat().st_mtime, file.stat().st_size, file))
    kept = 0
    for _, size, file in sorted(found, key=lambda entry: (entry[2] != newest, -entry[0])):
        kept += size
        if kept > MOST_BYTES:
            file.unlink(missing_ok=True)
