# SPDX-License-Identifier: BSD-3-Clause
"""HDF5 files that a mesh reader may safely open.

HDF5 lets a file point at other files (external links, external storage, virtual datasets): reading such a mesh would
return the bytes of any file of the machine. Declared sizes are compared with what is stored, because a file of one
kilobyte can declare terabytes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from meshes.errors import MeshError

# gzip does not compress further than about 1000 to 1.
_MAX_EXPANSION = 2000
_ALWAYS_ALLOWED_BYTES = 1 << 24
# What h5py raises on a file whose parts are missing, torn or of another type.
_DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, MemoryError)


def check_hdf5(path: Path) -> None:
    """Refuse external links, external or virtual storage and impossible sizes.

    Raises
    ------
    MeshError
        The file is not HDF5 or is damaged, or one of its objects is of a kind that is refused.
    """
    import h5py

    try:
        with h5py.File(path, "r", locking=False) as file:
            _check_objects(file, path)
    except MeshError:
        raise
    except _DAMAGE as error:
        raise MeshError(
            "is not a readable HDF5 file",
            where=str(path),
            found=_first_line(error),
            allowed="a whole HDF5 file",
            advice="the file is damaged or cut off: export it again",
        ) from error


def check_xdmf(path: Path) -> None:
    """Check the HDF5 files that an XDMF file names: only those in or below its own folder, and none raw binary.

    Raises
    ------
    MeshError
        Not XML, a raw binary reference, or a reference that leaves the folder.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the latter two: of unknown encodings
        raise MeshError("is not well-formed XML", where=str(path), found=_first_line(error)) from error
    for item in root.iter("DataItem"):
        kind = item.attrib.get("Format", "XML")
        if kind == "HDF":
            _check_reference(path, (item.text or "").strip())
        elif kind != "XML":
            raise _refused(path, f"a data item of format {kind}", "formats XML and HDF")


def _check_reference(path: Path, text: str) -> None:
    name = text.partition(":")[0]
    target = (path.parent / name).resolve()
    if not target.is_relative_to(path.parent.resolve()):
        raise _refused(path, f"a reference to {name}", "files in the same folder")
    if not os.path.isfile(target):  # false, not an error, for names that no file can have
        raise MeshError("names a file that is missing", where=str(path), found=name, allowed="a file beside it")
    check_hdf5(target)


def _check_objects(file: Any, path: Path) -> None:
    """Look at every object once: hard links may lead back to a group above, and groups may lie thousands deep."""
    import h5py

    visited, groups = {_address(file)}, [file]
    while groups:
        group = groups.pop()
        for place, item in _items(group, path):
            address = _address(item)
            if address in visited:
                continue
            visited.add(address)
            if isinstance(item, h5py.Group):
                groups.append(item)
            elif isinstance(item, h5py.Dataset):
                _check_dataset(item, place, path)


def _items(group: Any, path: Path) -> Iterator[tuple[str, Any]]:
    """Objects that a group holds under hard links, with their places."""
    import h5py

    for name in group:
        place = f"{group.name.rstrip('/')}/{name}"
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise _refused(path, f"external link {place} -> {link.filename}", "data stored in the file itself")
        if isinstance(link, h5py.HardLink):  # the target of a soft link is met under its own name
            yield place, group[name]


def _address(item: Any) -> int:
    import h5py

    return int(h5py.h5o.get_info(item.id).addr)


def _check_dataset(dataset: Any, place: str, path: Path) -> None:
    if dataset.external or dataset.is_virtual:
        raise _refused(path, f"dataset {place} stored in other files", "data stored in the file itself")
    stored = dataset.id.get_storage_size()
    if dataset.nbytes > _ALWAYS_ALLOWED_BYTES + _MAX_EXPANSION * stored:
        raise _refused(path, f"dataset {place} of {dataset.nbytes} bytes, {stored} stored", "sizes that match")


def _first_line(error: Exception) -> str:
    return f"{type(error).__name__}: {next(iter(str(error).splitlines()), 'no reason given')}"


def _refused(path: Path, found: str, allowed: str) -> MeshError:
    return MeshError(
        "refused: the file may reach outside itself or exhaust the memory",
        where=str(path),
        found=found,
        allowed=allowed,
        advice="copy the data into one plain file, for instance .vtu",
    )
