# SPDX-License-Identifier: BSD-3-Clause
"""What has been found so far, in a file: a run that ends early goes on where it was."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

# Part, name within it, and the work that gives its figures.
Task = tuple[str, str, Callable[[], Any]]


class Journal:
    """Results by part and name.

    Parameters
    ----------
    file : Is read when it exists, and written after every task.
    environment : Of this run; results of another one are left out.
    """

    def __init__(self, file: Path, environment: dict[str, Any]) -> None:
        self._file = file
        self.found: dict[str, Any] = {"environment": json.loads(json.dumps(environment, default=str))}
        if file.is_file():
            before = json.loads(file.read_text(encoding="utf-8"))
            if _same(before.get("environment"), self.found["environment"]):
                self.found = before

    def work_through(self, tasks: Iterable[Task], seconds: float) -> bool:
        """Do what has not been done; begin nothing after so many seconds. Whether all is done."""
        began = time.perf_counter()
        for part, name, work in tasks:
            results = self.found.setdefault(part, {})
            if name in results:
                continue
            if time.perf_counter() - began > seconds:
                return False
            print(f"{part}: {name} ...", flush=True)
            results[name] = _done(work)
            self._file.write_text(json.dumps(self.found, indent=1, default=str), encoding="utf-8")
        return True

    @property
    def failures(self) -> list[str]:
        """Tasks that ended with an error."""
        parts = {part: results for part, results in self.found.items() if part != "environment"}
        return [f"{part}: {name}" for part, found in parts.items() for name in found if "failure" in found[name]]


def _done(work: Callable[[], Any]) -> dict[str, Any]:
    """What some work gives, with the seconds that it took; an error is a result, too."""
    began = time.perf_counter()
    try:
        found = work()
    except Exception:
        found = {"failure": traceback.format_exc()}
    return {**found, "seconds_taken": time.perf_counter() - began}


def _same(one: Any, other: Any) -> bool:
    """Whether two environments have the same device, versions and sizes."""
    keys = ("femgal", "python", "numba", "cpu", "size", "no_graphs")
    return bool(one) and all(one.get(key) == other.get(key) for key in keys)
