# SPDX-License-Identifier: BSD-3-Clause
"""Where downloads and compiled kernels are kept, and how outdated folders of kernels go away."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import time
from contextlib import suppress
from pathlib import Path

_KEPT_DAYS = 30
# A digest, or one whose removal was begun.
_OURS = re.compile(r"[0-9a-f]{16}(\.removed-[0-9a-f]+)?")


def cache_root() -> Path:
    """Folder that holds femgal's caches: $FEMGAL_CACHE_DIR, else the user's cache folder."""
    chosen = os.environ.get("FEMGAL_CACHE_DIR")
    if chosen:
        return Path(chosen).expanduser()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "femgal"


def kernel_folder(digest: str) -> Path:
    """Folder of the kernels that were compiled from the sources with this digest (16 hexadecimal digits).

    Each call marks the folder as used now. When it is new, its siblings that nobody marked for 30 days are removed:
    every edit of a kernel leaves a folder behind. A cache that cannot be written is left to the compiler to report.
    """
    folder = cache_root() / "kernels" / digest
    with suppress(OSError):
        new = not folder.is_dir()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        if new:
            _remove_unused(folder.parent)
    return folder


def _remove_unused(kernels: Path) -> None:
    oldest = time.time() - _KEPT_DAYS * 86400.0
    for folder in kernels.iterdir():
        with suppress(OSError):  # another process was quicker
            if _OURS.fullmatch(folder.name) and folder.stat().st_mtime < oldest:
                _remove(folder)


def _remove(folder: Path) -> None:
    # Renamed first, in one step: a process that still uses the folder finds it whole or not at all, and then compiles.
    doomed = folder.with_name(f"{folder.name[:16]}.removed-{secrets.token_hex(4)}")
    folder.rename(doomed)
    shutil.rmtree(doomed, ignore_errors=True)
