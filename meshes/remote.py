# SPDX-License-Identifier: BSD-3-Clause
"""Meshes that are fetched once, on request, with their credit and terms: the registry and the download."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlsplit
from urllib.request import urlopen

from meshes.cache import cache_root
from meshes.errors import InputError, MeshError

_REGISTRY = Path(__file__).with_name("registry.json")
_TIMEOUT = 60.0
_CHUNK = 1 << 16


@dataclass(frozen=True)
class Remote:
    """A mesh elsewhere: where it is, how to know it, whom to credit and on which terms.

    Parameters
    ----------
    name, file : Catalogue name, and the name of the file in the cache.
    address : https, http or file address.
    bytes, sha256 : Size and digest of the file as published.
    description, credit, terms : For people; credit and terms are shown before and after the download.
    """

    name: str
    file: str
    address: str
    bytes: int
    sha256: str
    description: str
    credit: str
    terms: str

    @property
    def cached(self) -> Path:
        """Where the file lies after the download."""
        return mesh_cache() / self.file


Registry = Mapping[str, Remote]


def mesh_cache() -> Path:
    """Folder of downloaded meshes."""
    return cache_root() / "meshes"


@cache
def registry(path: Path = _REGISTRY) -> Registry:
    """Entries of a registry file by name.

    Raises
    ------
    MeshError
        The file is not a registry.
    """
    try:
        rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["meshes"]
        return {row["name"]: Remote(**row) for row in rows}
    except (OSError, ValueError, KeyError, TypeError) as error:
        allowed = ", ".join(entry.name for entry in fields(Remote))
        raise MeshError("is not a mesh registry", where=str(path), found=repr(error), allowed=allowed) from error


def download(name: str, *, accept_terms: bool, entries: Registry | None = None) -> Path:
    """Fetch a mesh into the user's cache; nothing is left behind unless size and SHA-256 agree.

    Parameters
    ----------
    name : Name in the registry.
    accept_terms : The user has read credit and terms, which the refusal shows.
    entries : Registry; the packaged one by default.

    Returns
    -------
    The cached file. A cached file whose digest agrees is not fetched again.

    Raises
    ------
    InputError
        Unknown name, or the terms were not accepted.
    MeshError
        The address cannot be reached, or sends something else.
    """
    entries = registry() if entries is None else entries
    if name not in entries:
        raise InputError("is not in the registry", where=name, allowed=", ".join(entries) or "nothing: it is empty")
    entry = entries[name]
    if not accept_terms:
        raise InputError(
            "has terms to accept before it is downloaded",
            where=name,
            found=f"credit: {entry.credit}; terms: {entry.terms}",
            advice="repeat with accept_terms=True, or --accept-terms on the command line",
        )
    if not (entry.cached.is_file() and _digest(entry.cached) == entry.sha256):
        _fetch(entry)
    logging.getLogger("meshes").info(
        "mesh %s: %s, sha256 %s, credit: %s, terms: %s", name, entry.address, entry.sha256, entry.credit, entry.terms
    )
    return entry.cached


def _fetch(entry: Remote) -> None:
    if urlsplit(entry.address).scheme not in {"https", "http", "file"}:
        raise MeshError("cannot be fetched", where=entry.name, found=entry.address, allowed="https, http, file")
    try:
        entry.cached.parent.mkdir(parents=True, exist_ok=True)
        with urlopen(entry.address, timeout=_TIMEOUT) as stream:
            _keep_checked(stream, entry)
    except MeshError:
        raise
    except (OSError, ValueError) as error:  # URLError is an OSError
        raise MeshError(
            "cannot be fetched",
            where=entry.name,
            found=f"{entry.address}: {getattr(error, 'reason', None) or error}",
            advice=f"fetch it elsewhere and name its folder in FEMGAL_MESH_PATH as {entry.file}",
        ) from error


def _keep_checked(stream: BinaryIO, entry: Remote) -> None:
    """Write to a temporary file beside the target and rename it once it is whole."""
    with tempfile.NamedTemporaryFile(dir=entry.cached.parent, prefix=".part-", delete=False) as part:
        try:
            _copy_checked(stream, part, entry)
            part.close()
            os.replace(part.name, entry.cached)
        finally:
            Path(part.name).unlink(missing_ok=True)


def _copy_checked(stream: BinaryIO, target: Any, entry: Remote) -> None:
    digest, received = hashlib.sha256(), 0
    while chunk := stream.read(_CHUNK):
        received += len(chunk)
        if received > entry.bytes:
            break
        digest.update(chunk)
        target.write(chunk)
    if received != entry.bytes or digest.hexdigest() != entry.sha256:
        raise MeshError(
            "the address sends another file than the registry knows",
            where=entry.name,
            found=f"{received} bytes, sha256 {digest.hexdigest()}",
            allowed=f"{entry.bytes} bytes, sha256 {entry.sha256}",
            advice="nothing was kept",
        )


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
