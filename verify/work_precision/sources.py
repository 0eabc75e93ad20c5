# SPDX-License-Identifier: BSD-3-Clause
"""Digests of the sources that a run executes: a run of other sources is another run."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import femgal
import meshes
import verify
from femgal import __version__

# What decides where a converged explicit motion goes. Meshes, materials and start are in its key as arrays, and the
# passes that compute forces are tested against plain ones: how fast they are is no matter of the reference's.
_EXPLICIT = ("materials", "discretisation.py", "timestep/velocity_verlet.py", "timestep/state.py")

# Of verify a run of its solvers executes these, if they are there.
_OF_VERIFY = ("solvers", "reference", "work_precision/child.py", "work_precision/run_motion.py")
_OF_SUBSTEPS = ("work_precision/run_substep.py",)


@cache
def source_digest(*, with_reference_solvers: bool = False, with_substeps: bool = False) -> str:
    """Of everything that a run executes, 8 hexadecimal digits."""
    folders = [_folder(femgal), _folder(meshes)]
    files = [path for folder in folders for path in folder.rglob("*.py")]
    files += _below(_folder(verify), _OF_VERIFY if with_reference_solvers else _OF_VERIFY[2:])
    files += _below(_folder(verify), _OF_SUBSTEPS if with_substeps else ())
    return _digest(files)[:8]


@cache
def explicit_digest() -> str:
    """Of the sources that decide where a converged explicit motion goes, 16 hexadecimal digits."""
    return _digest(_below(_folder(femgal), _EXPLICIT))[:16]


def _folder(package: object) -> Path:
    return Path(str(getattr(package, "__file__", None))).parent


def _below(root: Path, names: Iterable[str]) -> list[Path]:
    paths = [root / name for name in names]
    return [file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path])]


def _digest(files: Iterable[Path]) -> str:
    digest = hashlib.sha256(__version__.encode())
    root = _folder(femgal).parent
    for file in sorted(files):
        digest.update(f"{file.relative_to(root)}\n".encode() + file.read_bytes())
    return digest.hexdigest()
