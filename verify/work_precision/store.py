# SPDX-License-Identifier: BSD-3-Clause
"""A folder of results: numbers as JSON, motions as NPZ, each under the name of its request."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.output.atomic import replacing, write_text
from meshes.errors import InputError
from verify.work_precision.request import Request


@dataclass(frozen=True, eq=False)
class Result:
    """What a run left behind.

    Parameters
    ----------
    numbers : Everything but arrays. `failure` is None, or what was seen; `failure_kind` is then "solver", "input",
        "crash", "killed" or "time limit".
    motion : File of the arrays; None where the run has none.
    older : Whether other sources made it.
    """

    numbers: dict[str, Any]
    motion: Path | None
    older: bool = False

    @property
    def failure(self) -> str | None:
        """What went wrong."""
        failure: str | None = self.numbers["failure"]
        return failure

    def arrays(self) -> dict[str, NDArray]:
        """mass [kg], part, held, displacement [m] of each frame after the start."""
        assert self.motion is not None
        with np.load(self.motion) as found:
            return dict(found)


class Store:
    """Results in a folder, which is made when it is not there.

    Parameters
    ----------
    folder : Where.
    keep_older : Take results of other sources where there are none of the present ones.
    retry_failed : Take no result that is a failure from earlier than this store.
    """

    def __init__(self, folder: Path, *, keep_older: bool = False, retry_failed: bool = False) -> None:
        self.folder, self._keep_older = folder, keep_older
        self._failures_since = time.time() if retry_failed else 0.0
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError("no folder for the runs", where=str(folder), found=error.strerror) from None

    def stem(self, request: Request) -> Path:
        """Path of a request's result, without suffix."""
        return self.folder / request.name

    def find(self, request: Request) -> Result | None:
        """The result of a request; None when it has to be run."""
        found = self._read(self.stem(request), request)
        if found is not None or not self._keep_older or request.identity:
            return found
        others = sorted(self.folder.glob(f"{request.key}-*.json"), key=lambda path: path.stat().st_mtime, reverse=True)
        older = (self._read(path.with_suffix(""), request, older=True) for path in others)
        return next((result for result in older if result is not None), None)

    def _read(self, stem: Path, request: Request, *, older: bool = False) -> Result | None:
        try:
            path = stem.with_suffix(".json")
            numbers, written = json.loads(path.read_text(encoding="utf-8")), path.stat().st_mtime
        except (OSError, ValueError):
            return None
        if numbers["failure"] and (written < self._failures_since or _may_go_on(numbers, request)):
            return None
        motion = stem.with_suffix(".npz")
        return Result(numbers, motion if motion.is_file() else None, older)

    def remove(self, request: Request) -> None:
        """Forget a result."""
        for suffix in (".json", ".npz"):
            self.stem(request).with_suffix(suffix).unlink(missing_ok=True)


def write_result(stem: Path, numbers: dict[str, Any], arrays: dict[str, NDArray] | None = None) -> None:
    """Write a result: the numbers last and at once, so that where they are the result is complete."""
    if arrays is not None:
        with replacing(stem.with_suffix(".npz")) as part:
            np.savez(part, **arrays)  # type: ignore[arg-type]
    write_text(stem.with_suffix(".json"), json.dumps(numbers))


def _may_go_on(numbers: dict[str, Any], request: Request) -> bool:
    """Whether the run was stopped by a shorter time limit than the request's."""
    if numbers.get("failure_kind") != "time limit":
        return False
    return request.time_limit is None or request.time_limit > numbers["time_limit"]
