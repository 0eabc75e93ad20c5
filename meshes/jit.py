# SPDX-License-Identifier: BSD-3-Clause
"""The two decorators behind every compiled function, and where their machine code is cached.

Numba keys its cache by the source of the decorated function's own file only, so editing a helper in another file
would silently run yesterday's code. Here the cache folder carries a hash of every source file of the package that
holds compiled functions: edit one and all are compiled anew.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config as _config

Function = TypeVar("Function", bound=Callable[..., Any])

# Fused multiply-adds only: no reassociation, so results do not depend on how a loop was vectorised.
_OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}


def kernel(function: Function) -> Function:
    """Compile an array kernel on first call: releases the GIL, cached on disk."""
    settings: Any = _config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_cache_folder(_package_of(function)))
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    finally:
        settings.CACHE_DIR = before


def scalar(function: Function) -> Function:
    """Compile a function of scalars that is always inlined into the kernel that calls it.

    Without forced inlining LLVM keeps the call and the loop around it stays scalar. CUDA kernels may call the same
    function as it is.
    """
    return numba.njit(forceinline=True, **_OPTIONS)(function)


def cache_root() -> Path:
    """Folder that holds femgal's caches: $FEMGAL_CACHE_DIR, else the user's cache folder."""
    chosen = os.environ.get("FEMGAL_CACHE_DIR")
    if chosen:
        return Path(chosen).expanduser()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "femgal"


def _package_of(function: Callable[..., Any]) -> Path:
    depth = function.__module__.count(".")
    return Path(function.__code__.co_filename).resolve().parents[max(depth - 1, 0)]


@cache
def _cache_folder(package: Path) -> Path:
    # Both packages count: femgal's kernels may inline functions of meshes.
    digest = hashlib.sha256()
    for root in sorted({package, Path(__file__).resolve().parent}):
        for source in sorted(root.rglob("*.py")):
            text = source.read_bytes()
            if b"meshes.jit" in text:
                digest.update(text)
    return cache_root() / "kernels" / digest.hexdigest()[:16]
