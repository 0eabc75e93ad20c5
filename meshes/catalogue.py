# SPDX-License-Identifier: BSD-3-Clause
"""Which mesh a name means: a file, the folders in FEMGAL_MESH_PATH, a procedural shape, or a downloaded file.

Nothing ever stands in for a mesh that is missing: an unknown name is an error that says where was looked.
"""

from __future__ import annotations

import difflib
import logging
import os
from dataclasses import dataclass
from pathlib import Path

from meshes.errors import MeshError
from meshes.remote import mesh_cache, registry

SUFFIXES = (".ply", ".obj", ".stl", ".msh", ".vtk", ".vtu", ".mesh", ".t")
PROCEDURAL = {
    "rabbit": "sitting rabbit, 1 m tall, looking along x, left ear higher (z up)",
    "sphere": "solid sphere, radius 0.5 m, around the origin",
    "cube": "unit cube from the origin",
    "beam": "beam along x, 3 x 1 x 1 m, from the origin",
}
_VARIABLE = "FEMGAL_MESH_PATH"


@dataclass(frozen=True)
class Entry:
    """One mesh of the catalogue.

    Parameters
    ----------
    name : Catalogue name, or the name of the file without suffix.
    kind : "file", "procedural", or "remote" for one that is not downloaded yet.
    source : Path, "procedural", or address.
    description, terms : For people.
    """

    name: str
    kind: str
    source: str
    description: str = ""
    terms: str = ""

    @property
    def path(self) -> Path | None:
        """The file; None for procedural and remote entries."""
        return Path(self.source) if self.kind == "file" else None


def resolve(name_or_path: str | os.PathLike[str]) -> Entry:
    """Find a mesh: an existing file, then FEMGAL_MESH_PATH, then procedural names, then the download cache.

    In each folder of FEMGAL_MESH_PATH, and in its sub-folder ``tets``, a file ``NAME`` with or without one of
    `SUFFIXES` is looked for, in that order.

    Raises
    ------
    MeshError
        Unknown name or missing file, with the places looked at and close matches; a remote mesh not yet downloaded.
    """
    name = os.fspath(name_or_path)
    entry = _as_path(name) or _in_folders(name) or _procedural(name) or _downloaded(name)
    if entry is None:
        raise _unknown(name)
    logging.getLogger("meshes").info("mesh %s: %s", entry.name, entry.source)
    return entry


def known() -> list[Entry]:
    """Every mesh that a name finds here and now, then those that can be downloaded."""
    entries: dict[str, Entry] = {}
    for folder in search_folders():
        for path in sorted(folder.iterdir(), key=lambda p: (p.stem, SUFFIXES.index(p.suffix) if _is_mesh(p) else 0)):
            if _is_mesh(path):
                entries.setdefault(path.stem, _file(path))
    for name in (*PROCEDURAL, *registry()):
        found = _procedural(name) or _downloaded(name) or _remote(name)
        entries.setdefault(name, found)
    return list(entries.values())


def search_folders() -> list[Path]:
    """Existing folders of FEMGAL_MESH_PATH, each followed by its sub-folder ``tets``."""
    named = [Path(part).expanduser() for part in os.environ.get(_VARIABLE, "").split(os.pathsep) if part]
    return [folder for root in named for folder in (root, root / "tets") if folder.is_dir()]


def _is_mesh(path: Path) -> bool:
    return path.suffix in SUFFIXES and path.is_file()


def _file(path: Path, name: str = "") -> Entry:
    return Entry(name or path.stem, "file", str(path), f"{path.suffix[1:]} file")


def _as_path(name: str) -> Entry | None:
    path = Path(name).expanduser()
    # A bare word never means a file without suffix: "rabbit" stays the rabbit whatever lies in the folder.
    return _file(path) if path.is_file() and (path.suffix or os.sep in name) else None


def _in_folders(name: str) -> Entry | None:
    if not name or os.sep in name:
        return None
    candidates = (folder / f"{name}{suffix}" for folder in search_folders() for suffix in ("", *SUFFIXES))
    return next((_file(path) for path in candidates if _is_mesh(path)), None)


def _procedural(name: str) -> Entry | None:
    return Entry(name, "procedural", "procedural", PROCEDURAL[name]) if name in PROCEDURAL else None


def _downloaded(name: str) -> Entry | None:
    remote = registry().get(name)
    if remote is None or not remote.cached.is_file():
        return None
    return Entry(name, "file", str(remote.cached), remote.description, f"{remote.credit}; {remote.terms}")


def _remote(name: str) -> Entry:
    remote = registry()[name]
    return Entry(name, "remote", remote.address, remote.description, f"{remote.credit}; {remote.terms}")


def _unknown(name: str) -> MeshError:
    if name in registry():
        return MeshError(
            "is known but not downloaded",
            where=name,
            found=f"no {registry()[name].cached}",
            advice=f"femgal mesh download {name}, or name a folder that holds {registry()[name].file} in {_VARIABLE}",
        )
    names = [entry.name for entry in known()]
    places = [str(folder) for folder in search_folders()] or [f"{_VARIABLE} (not set)"]
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    return MeshError(
        "no such file" if os.sep in name or Path(name).suffix in SUFFIXES else "no such mesh",
        where=name,
        found="no file of this name; looked in " + ", ".join([*places, str(mesh_cache())]),
        allowed="a path, or " + ", ".join(names),
        advice=f"did you mean {' or '.join(close)}?" if close else f"give a path, or name its folder in {_VARIABLE}",
    )
