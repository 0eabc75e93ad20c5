# SPDX-License-Identifier: BSD-3-Clause
"""Plant a bug in a copy of the sources and run cases there, in a process of its own.

The copy stays where it is while its bugs come and go, so that kernels which a bug does not touch need no compiling. A
kernel folder is named by a digest of all sources that kernels are made of (`meshes.jit`): a planted bug has kernels
of its own, and no run sees those of another.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import femgal
from verify.planted.bugs import Bug

ROOMS = ("femgal", "meshes", "verify")

# A planted bug may make a loop endless.
LONGEST = 900.0


@dataclass(frozen=True)
class Catch:
    """What the cases said of a planted bug.

    Parameters
    ----------
    bug : The bug.
    red, green : Ids of the rows that failed and of those that passed.
    trouble : Why there are no rows: the process crashed or did not end; empty otherwise.
    seconds : Wall time, compilation included.
    """

    bug: Bug
    red: tuple[str, ...]
    green: tuple[str, ...]
    trouble: str
    seconds: float

    @property
    def caught(self) -> bool:
        """Whether a named case turned red."""
        return bool(self.red)


def copy_sources(folder: Path) -> Path:
    """Copy the packages into a folder; returns it."""
    root = Path(femgal.__file__).resolve().parents[1]
    for room in ROOMS:
        shutil.copytree(root / room, folder / room, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@contextmanager
def planted(bug: Bug, tree: Path) -> Iterator[None]:
    """A copy of the sources with the bug in it; as it was before, times of files included, afterwards.

    Raises
    ------
    ValueError
        The text that the bug replaces is not in its file exactly once.
    """
    file = tree / bug.file
    text = file.read_text(encoding="utf-8")
    if text.count(bug.old) != 1:
        raise ValueError(f"{bug.name}: {bug.file} has {text.count(bug.old)} times {bug.old!r}, not once")
    sound = file.with_suffix(".sound")
    shutil.copy2(file, sound)
    try:
        file.write_text(text.replace(bug.old, bug.new), encoding="utf-8")
        yield
    finally:
        sound.replace(file)


def run_cases(bug: Bug, tree: Path, cache: Path) -> Catch:
    """Run the rows that a bug names on the sources as they are in a tree."""
    began = time.perf_counter()
    environment = os.environ | {"PYTHONPATH": str(tree), "FEMGAL_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "verify.planted.rows", bug.cases]
    try:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return Catch(bug, (), (), f"did not end within {LONGEST:.0f} s", time.perf_counter() - began)
    seconds = time.perf_counter() - began
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return Catch(bug, (), (), f"exit code {done.returncode}: {last}", seconds)
    found = json.loads(done.stdout.splitlines()[-1])
    if Path(found["femgal"]).parents[1] != tree.resolve():
        raise RuntimeError(f"the copy in {tree} was not the one that ran: {found['femgal']}")
    rows = found["rows"]
    red = tuple(name for name, status in rows.items() if status == "FAIL")
    green = tuple(name for name, status in rows.items() if status == "PASS")
    return Catch(bug, red, green, "", seconds)


def run_planted(bug: Bug, tree: Path, cache: Path) -> Catch:
    """Plant a bug, run the rows that it names, and take it out again."""
    with planted(bug, tree):
        return run_cases(bug, tree, cache)
