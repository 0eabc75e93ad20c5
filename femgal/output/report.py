# SPDX-License-Identifier: BSD-3-Clause
"""A folder that holds a report and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from femgal.output.atomic import write_text
from femgal.output.folder import try_writing
from meshes.errors import InputError


def prepare_report(folder: Path, names: Iterable[str], *, force: bool) -> Path:
    """Return the folder as an absolute path, existing and writable.

    Parameters
    ----------
    folder : Where the report shall go; made with its parents.
    names : Files of a report; an older one is replaced.
    force : Whether other files may be there; they stay.

    Raises
    ------
    InputError
        A file, not writable, or holding anything but an older report without `force`.
    """
    path = Path(folder).expanduser().absolute()
    if path.exists() and not path.is_dir():
        raise InputError("report folder is a file", where=str(path), advice="choose another --report")
    others = sorted({entry.name for entry in path.iterdir()} - set(names)) if path.is_dir() else []
    if others and not force:
        raise InputError(
            "report folder holds other files",
            where=str(path),
            found=", ".join(others[:5]) + (" ..." if len(others) > 5 else ""),
            allowed="a new or empty folder, or one with an older report",
            advice="choose another --report, or write beside them with --force",
        )
    try_writing(path)
    return path


def write_report(folder: Path, files: Mapping[str, str]) -> None:
    """Write each file whole, or leave the older one as it was."""
    for name, text in files.items():
        write_text(folder / name, text)
