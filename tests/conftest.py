# SPDX-License-Identifier: BSD-3-Clause
"""What all tests share: caches of their own, and where real meshes are."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

# Set before anything is compiled. Parallel workers must not write one another's cache files.
_worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
_root = Path(os.environ.get("FEMGAL_CACHE_DIR") or Path(tempfile.gettempdir()) / "femgal-tests")
os.environ["FEMGAL_CACHE_DIR"] = str(_root / _worker)


@pytest.fixture
def real_surface():
    """Return a function that resolves the name of a real surface, or skips the test with a reason."""

    def find(name: str) -> str:
        for folder in filter(None, os.environ.get("FEMGAL_MESH_PATH", "").split(os.pathsep)):
            for path in (Path(folder) / f"{name}.ply", Path(folder) / "tets" / f"{name}.msh"):
                if path.is_file():
                    return str(path)
        pytest.skip(f"{name} is not in FEMGAL_MESH_PATH")

    return find
