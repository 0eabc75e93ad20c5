# SPDX-License-Identifier: BSD-3-Clause
"""The output folder: made, tried and protected before the first second of computing."""

from __future__ import annotations

import tempfile
from pathlib import Path

from femgal.output import checkpoint, runlog
from meshes.errors import InputError

_TRACES = (runlog.FILE_NAME, checkpoint.FILE_NAME, "frames.vtkhdf", "frames.pvd", "frames")


def prepare_output(folder: Path, *, resume: bool) -> Path:
    """Return the folder as an absolute path, existing and writable.

    Parameters
    ----------
    folder : Path
        Where the run shall write; made with its parents unless a run is resumed.
    resume : bool
        True: go on with the run that is there. False: refuse a folder that holds one.

    Raises
    ------
    InputError
        A file, not writable, holding an earlier run without `resume`, or `resume` without a checkpoint.
    """
    path = Path(folder).expanduser().absolute()
    if path.exists() and not path.is_dir():
        raise _error("output folder is a file", path, "a file", "a folder", "choose another --out")
    traces = [name for name in _TRACES if (path / name).exists()]
    if resume:
        _need_checkpoint(path, traces)
    elif traces:
        advice = "add --resume to go on with it, or choose another --out"
        raise _error("output folder holds an earlier run", path, ", ".join(traces), "a new or empty folder", advice)
    _try_writing(path)
    return path


def _need_checkpoint(path: Path, traces: list[str]) -> None:
    if checkpoint.FILE_NAME not in traces:
        found = ", ".join(traces) or ("nothing of a run" if path.is_dir() else "no such folder")
        advice = "leave out --resume to start from the beginning"
        raise _error("nothing to resume", path, found, f"a folder with {checkpoint.FILE_NAME}", advice)


def _try_writing(path: Path) -> None:
    # Asking os.access is no substitute: it says yes to root on a read-only file system's folders and knows no quota.
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path) as probe:
            probe.write(b"femgal")
    except (OSError, ValueError) as error:
        raise _error(
            "output folder cannot be written", path, error, "a writable folder", "choose another --out"
        ) from error


def _error(what: str, path: Path, found: object, allowed: str, advice: str) -> InputError:
    return InputError(what, where=str(path), found=found, allowed=allowed, advice=advice)
