# SPDX-License-Identifier: BSD-3-Clause
"""The output folder: made, tried and protected before the first second of computing."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from femgal.output import checkpoint, runlog
from meshes.errors import InputError

SCENE_FILE = "scene.toml"

_TRACES = (runlog.FILE_NAME, checkpoint.FILE_NAME, "frames.vtkhdf", "frames.pvd", "frames")


def prepare_output(folder: Path, *, resume: bool) -> Path:
    """Return the folder as an absolute path, existing and writable.

    Parameters
    ----------
    folder : Path
        Where the run shall write; made with its parents unless a run is resumed.
    resume : bool
        True: go on with the run that is there, from its start if it was killed before its first checkpoint. False:
        refuse a folder that holds one.

    Raises
    ------
    InputError
        A file, not writable, holding an earlier run without `resume`, or `resume` without a run.
    """
    path = Path(folder).expanduser().absolute()
    if path.exists() and not path.is_dir():
        raise _error("output folder is a file", path, "a file", "a folder", "choose another --out")
    traces = [name for name in _TRACES if (path / name).exists()]
    if resume:
        _need_run(path, traces)
    elif traces:
        advice = "add --resume to go on with it, or choose another --out"
        raise _error("output folder holds an earlier run", path, ", ".join(traces), "a new or empty folder", advice)
    try_writing(path)
    return path


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder while the block runs; a lock ends with its process, however that ends.

    Raises
    ------
    InputError
        Another run is writing there.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            advice = "wait for it, or choose another --out"
            raise _error(
                "another run is writing to this folder", folder, "a lock", "a folder of its own", advice
            ) from None
        yield
    finally:
        os.close(handle)


def has_checkpoint(folder: Path) -> bool:
    """Whether a run in this folder can go on, rather than begin again."""
    return (folder / checkpoint.FILE_NAME).exists()


def _need_run(path: Path, traces: list[str]) -> None:
    advice = "leave out --resume to start from the beginning"
    if not traces:
        found = "nothing of a run" if path.is_dir() else "no such folder"
        raise _error("nothing to resume", path, found, f"a folder with {runlog.FILE_NAME}", advice)
    if checkpoint.FILE_NAME in traces:
        return
    # The first checkpoint follows frame 0. Later frames without one were not left by a kill: they are kept.
    frames = len(runlog.read_log(path)["frames"])
    if frames > 1:
        allowed, advice = f"{checkpoint.FILE_NAME} beside them", "choose another --out"
        raise _error("nothing to resume from", path, f"{frames} frames without a checkpoint", allowed, advice)


def try_writing(path: Path) -> None:
    """Make a folder, with its parents, and write a file that nobody sees.

    Raises
    ------
    InputError
        The folder cannot be made or written.
    """
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
