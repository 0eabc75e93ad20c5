# SPDX-License-Identifier: BSD-3-Clause
"""run.json: what was run, on what, and what every frame cost and reached.

The file is replaced as a whole after each frame, so it is valid JSON at any moment. Rows are encoded once; a frame
then costs one write of the text so far.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import numpy as np

from femgal.output.atomic import write_text
from femgal.output.environment import describe_environment
from meshes.errors import InputError

FILE_NAME = "run.json"
FORMAT_VERSION = 1

ROW_KEYS = (
    "frame",
    "time",
    "seconds",
    "passes",
    "eps18",
    "kinetic_energy",
    "elastic_energy",
    "total_energy",
    "min_J",
)
"""Keys that each row carries, null where the solver gave no number."""


class RunLog:
    """The log of one run; make it with `create` or `resume`.

    Parameters
    ----------
    path : Path
        The file.
    header : dict
        Everything but the frames.
    rows : list of str
        Frames so far, each as one line of JSON.
    """

    def __init__(self, path: Path, header: dict[str, Any], rows: list[str]) -> None:
        self._path, self._header, self._rows = path, header, rows

    @classmethod
    def create(cls, folder: Path, header: Mapping[str, Any]) -> Self:
        """Start `folder`/run.json.

        Parameters
        ----------
        folder : Path
            Output folder.
        header : mapping
            Settings, mesh counts and origins, warnings. Versions, status and start time are added.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        own = {"format_version": FORMAT_VERSION, "status": "running", "started": _now()}
        log = cls(folder / FILE_NAME, {**own, "versions": describe_environment(), **plain(header)}, [])
        log._write()
        return log

    @classmethod
    def resume(cls, folder: Path, keep_frames: int) -> Self:
        """Go on with the log in `folder`, keeping its first `keep_frames` rows.

        Raises
        ------
        InputError
            No log, not a log, or fewer rows.
        """
        content = read_log(folder)
        frames = content.pop("frames")
        if len(frames) < keep_frames:
            raise InputError(
                "run log has too few frames to resume",
                where=str(folder / FILE_NAME),
                found=f"{len(frames)} frames",
                allowed=f"{keep_frames} or more",
                advice="start anew with another --out",
            )
        resumed = [*content.get("resumed", []), {"frames_kept": keep_frames, "at": _now()}]
        header = {**content, "status": "running", "resumed": resumed, "versions": describe_environment()}
        log = cls(folder / FILE_NAME, header, [_encode(row) for row in frames[:keep_frames]])
        log._write()
        return log

    def append_frame(self, row: Mapping[str, Any]) -> None:
        """Add one frame; keys of `ROW_KEYS` that are missing become null."""
        self._rows.append(_encode({**dict.fromkeys(ROW_KEYS), **row}))
        self._write()

    def finish(self, status: str, **extra: Any) -> None:
        """Close the log with a status ("finished", "interrupted", "failed") and further entries."""
        self._header |= {"status": status, "finished": _now(), **plain(extra)}
        self._write()

    def _write(self) -> None:
        head = json.dumps(self._header, indent=2, allow_nan=False)[:-2]
        frames = ",\n".join(f"    {row}" for row in self._rows)
        write_text(self._path, f'{head},\n  "frames": [\n{frames}\n  ]\n}}\n')


def read_log(folder: Path) -> dict[str, Any]:
    """Return the content of `folder`/run.json.

    Raises
    ------
    InputError
        Missing, not JSON, of another format version, or without frames.
    """
    path = folder / FILE_NAME
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("run log cannot be read", where=str(path), found=error, allowed="a JSON file") from error
    found = content.get("format_version") if isinstance(content, dict) else None
    if found != FORMAT_VERSION or not isinstance(content.get("frames"), list):
        raise InputError(
            "not a run log of this version",
            where=str(path),
            found=f"format_version {found}",
            allowed=f"format_version {FORMAT_VERSION} and a list of frames",
        )
    return content


def plain(value: Any) -> Any:
    """Return `value` in JSON's types: NaN and infinity as None, arrays as lists, paths and the rest as text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _encode(row: Mapping[str, Any]) -> str:
    return json.dumps(plain(row), allow_nan=False)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
