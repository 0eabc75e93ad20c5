# SPDX-License-Identifier: BSD-3-Clause
"""Reading HDF5 files of ours, which may come from anywhere, may be torn, and may be growing while they are read.

`meshes.io.hdf5_guard` inspects all of a file before it is read. Here that would be wrong: behind the last counted
frame of a run that was killed, or is being written, there may be entries that point nowhere. So only what is asked
for is looked at.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshes.errors import InputError

if TYPE_CHECKING:
    import h5py

# Deflate compresses at most 1032 : 1; below the floor no file is worth a refusal.
_MAX_RATIO, _FLOOR_BYTES = 1032, 1 << 24
# What h5py and the code behind it raise on a file whose parts are missing, torn or of another type.
_DAMAGE = (OSError, KeyError, IndexError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError)


@contextmanager
def open_for_reading(path: Path, what: str, advice: str = "") -> Iterator[h5py.File]:
    """Open an HDF5 file without locking it, so that its writer is not disturbed, and close it at the end.

    Parameters
    ----------
    path : Path
        File to open.
    what : str
        What the file should be ("checkpoint"), for the message.
    advice : str
        What to do when it cannot be used.

    Raises
    ------
    InputError
        Missing, a folder, not HDF5, or damaged where the body of `with` reads it.
    """
    import h5py

    if not path.is_file():
        raise InputError(f"no {what} here", where=str(path), found="no such file", allowed="a file", advice=advice)
    try:
        with h5py.File(path, "r", locking=False) as file:
            yield file
    except InputError:
        raise
    except _DAMAGE as error:
        found = f"{type(error).__name__}: {error}"
        raise InputError(
            f"{what} cannot be read", where=str(path), found=found, allowed="a whole HDF5 file", advice=advice
        ) from error


def local_object(parent: h5py.Group, name: str) -> Any:
    """Return the group or dataset `name` of `parent`, refusing every way out of the file.

    Raises
    ------
    InputError
        Missing, behind a soft or external link, in external or virtual storage, or larger than the file can hold.
    """
    import h5py

    item: Any = parent
    for part in name.split("/"):
        link = item.get(part, getlink=True) if isinstance(item, h5py.Group) else None
        if not isinstance(link, h5py.HardLink):
            _refuse(parent, name, type(link).__name__ if link else "nothing", "an object stored in the file itself")
        item = item[part]
    if isinstance(item, h5py.Dataset):
        _check_storage(parent, name, item)
    return item


def _check_storage(parent: h5py.Group, name: str, data: h5py.Dataset) -> None:
    if data.external or data.is_virtual:
        _refuse(parent, name, "external or virtual storage", "data stored in the file itself")
    limit = max(_FLOOR_BYTES, _MAX_RATIO * Path(parent.file.filename).stat().st_size)
    if data.nbytes > limit:
        _refuse(parent, name, f"{data.shape} declared, {data.nbytes:.3g} bytes", f"at most {limit:.3g} bytes")


def _refuse(parent: h5py.Group, name: str, found: str, allowed: str) -> None:
    where = f"{parent.file.filename}: {parent.name.rstrip('/')}/{name}"
    raise InputError("not usable", where=where, found=found, allowed=allowed, advice="do not trust this file")
