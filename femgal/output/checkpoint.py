# SPDX-License-Identifier: BSD-3-Clause
"""checkpoint.h5: the state from which a run goes on exactly as if it had never stopped."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from femgal.output.atomic import replacing
from femgal.output.hdf5 import local_object, open_for_reading
from meshes.errors import InputError

if TYPE_CHECKING:
    import h5py

FILE_NAME = "checkpoint.h5"
FORMAT_VERSION = 1
_ADVICE = "resume from another folder, or start anew with another --out"


def save_checkpoint(folder: Path, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
    """Write `folder`/checkpoint.h5; the earlier one stays until the new one is whole and on the disk.

    Parameters
    ----------
    folder : Path
        Output folder.
    arrays : mapping of name to array
        Numbers or booleans of any shape, kept bit for bit; "solver/w" makes a group.
    meta : mapping
        JSON values; `meta["fingerprint"]` names the scene and mesh that the state belongs to.

    Raises
    ------
    ValueError
        No fingerprint, or an array that does not hold numbers.
    OSError
        The file cannot be written; the earlier checkpoint is untouched.
    """
    import h5py

    if not isinstance(meta.get("fingerprint"), str):
        raise ValueError(f"checkpoint meta needs a fingerprint string, got {meta.get('fingerprint')!r}")
    text = json.dumps(dict(meta)).encode()
    with replacing(folder / FILE_NAME) as part, h5py.File(part, "w", locking=False) as file:
        file.attrs["femgal_checkpoint"] = FORMAT_VERSION
        _write(file, "meta", np.frombuffer(text, np.uint8))
        file.create_group("arrays")
        for name, array in arrays.items():
            _write(file["arrays"], name, np.asarray(array))


def load_checkpoint(folder: Path, *, fingerprint: str | None = None) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read `folder`/checkpoint.h5.

    Parameters
    ----------
    folder : Path
        Output folder.
    fingerprint : str, optional
        Scene and mesh that the state must belong to.

    Returns
    -------
    arrays, meta : dict, dict
        As they were saved, bit for bit.

    Raises
    ------
    InputError
        Missing, damaged, of another version, of another scene or mesh, or with data outside the file.
    """
    path = folder / FILE_NAME
    with open_for_reading(path, "checkpoint", _ADVICE) as file:
        _check(path, "checkpoint version", file.attrs.get("femgal_checkpoint"), FORMAT_VERSION)
        meta = json.loads(_read(path, file, "meta").tobytes())
        if fingerprint is not None:
            _check(path, "scene and mesh fingerprint", meta["fingerprint"], fingerprint)
        arrays = {name: _read(path, file, f"arrays/{name}") for name in _names(local_object(file, "arrays"))}
    return arrays, meta


def _write(file: h5py.Group, name: str, array: NDArray[Any]) -> None:
    if array.dtype.kind not in "biufc":
        raise ValueError(f"checkpoint array {name!r} holds {array.dtype}, needed numbers or booleans")
    data = file.create_dataset(name, data=array)
    data.attrs["crc32"] = _crc(array)


def _read(path: Path, file: h5py.File, name: str) -> NDArray[Any]:
    data = local_object(file, name)
    # Stored without compression, so a declared size that is not there is a damaged file.
    _check(path, f"stored bytes of {name}", data.id.get_storage_size(), data.nbytes)
    array = np.asarray(data[()], data.dtype)
    _check(path, f"checksum of {name}", int(data.attrs.get("crc32", -1)), _crc(array))
    return array


def _names(group: h5py.Group, prefix: str = "") -> Iterator[str]:
    for name in group:
        item = local_object(group, name)
        if hasattr(item, "keys"):
            yield from _names(item, f"{prefix}{name}/")
        else:
            yield prefix + name


def _crc(array: NDArray[Any]) -> int:
    return zlib.crc32(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)


def _check(path: Path, what: str, found: object, allowed: object) -> None:
    if found != allowed:
        raise InputError(f"{what} does not fit", where=str(path), found=found, allowed=allowed, advice=_ADVICE)
