# SPDX-License-Identifier: BSD-3-Clause
"""The file behind a mesh: that it can be read or written, its digest, its record."""

from __future__ import annotations

import hashlib
from pathlib import Path

from meshes.errors import InputError, MeshError
from meshes.types import Origin


def readable(path: str | Path) -> Path:
    """Return the path of an existing, non-empty file.

    Raises
    ------
    MeshError
        Nothing there, a folder, not readable, or empty.
    """
    path = Path(path).expanduser()
    try:
        if not path.is_file():
            what = "is a folder, not a mesh file" if path.is_dir() else "no such file"
            advice = "check the spelling; `femgal mesh info` lists known names, FEMGAL_MESH_PATH adds folders of yours"
            raise MeshError(what, where=str(path), advice=advice)
        with path.open("rb") as stream:
            if not stream.read(1):
                raise MeshError("the file is empty", where=str(path), found="0 bytes", allowed="a mesh")
    except OSError as error:
        raise MeshError("cannot be opened", where=str(path), found=error.strerror or str(error)) from error
    return path


def writable(path: str | Path, *, force: bool = True) -> Path:
    """Return the path when a file can be written there.

    Raises
    ------
    InputError
        The folder is missing, the target is a folder, or it exists and ``force`` is False.
    """
    path = Path(path).expanduser()
    if path.is_dir():
        raise InputError("is a folder", where=str(path), advice="name a file")
    if not path.parent.is_dir():
        raise InputError("the folder does not exist", where=str(path.parent), advice="create it first")
    if path.exists() and not force:
        raise InputError("exists already", where=str(path), advice="choose another name or overwrite with --force")
    return path


def file_origin(path: Path) -> Origin:
    """Record of a mesh file: name without suffix, path, SHA-256 of its bytes."""
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return Origin(name=path.name.removesuffix(path.suffix), source=str(path), sha256=digest)
