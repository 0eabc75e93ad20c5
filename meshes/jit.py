# SPDX-License-Identifier: BSD-3-Clause
"""The two decorators behind every compiled function, and where their machine code is cached.

Numba keys its cache by the source of the decorated function's own file only, so editing a helper in another file, or
a constant that is compiled in, would silently run yesterday's code. Here the cache folder carries a hash of every
source file that lies in one folder with compiled functions, of the function's package and of this one: edit one and
all are compiled anew. So what a compiled function takes from other files must lie in such a folder.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config as _config

from meshes.cache import kernel_folder

Function = TypeVar("Function", bound=Callable[..., Any])

# Fused multiply-adds only: no reassociation, so results do not depend on how a loop was vectorised.
_OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}

# Numba's CUDA simulator calls functions of scalars from Python, so each is compiled on its own there.
_SIMULATED = os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


def _skip_search_for_blas() -> None:
    """Keep Numba from importing SciPy's linear algebra, 0.2 s, when its first kernel is compiled or loaded.

    It does so only to know at once whether there is a BLAS. Who compiles np.dot in the same process still gets it: the
    search is made again there.
    """
    from numba.np import linalg

    if find_spec("scipy") is None or not hasattr(linalg, "ensure_blas"):
        return
    search = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath
    finally:
        linalg.ensure_blas = search
    arraymath.ensure_blas = search


_skip_search_for_blas()


def kernel(function: Function) -> Function:
    """Compile an array kernel on first call: releases the GIL, cached on disk."""
    with kernel_cache(function, _config):
        return numba.njit(cache=True, **_OPTIONS)(function)


@contextmanager
def kernel_cache(function: Function, settings: Any) -> Iterator[None]:
    """What is compiled by the settings' compiler in this block is cached where the sources of `function` say."""
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_cache_folder(_package_of(function)))
    try:
        yield
    finally:
        settings.CACHE_DIR = before


def scalar(function: Function) -> Function:
    """Compile a function of scalars that is always inlined into the kernel that calls it.

    Without forced inlining LLVM keeps the call and the loop around it stays scalar. CUDA kernels may call the same
    function as it is.
    """
    with kernel_cache(function, _config):
        return numba.njit(forceinline=True, cache=_SIMULATED, **_OPTIONS)(function)


def _package_of(function: Callable[..., Any]) -> Path:
    depth = function.__module__.count(".")
    return Path(function.__code__.co_filename).resolve().parents[max(depth - 1, 0)]


@cache
def _cache_folder(package: Path) -> Path:
    # Both packages count: femgal's kernels may inline functions of meshes.
    return kernel_folder(_source_digest({package, Path(__file__).resolve().parent}))


def _source_digest(packages: set[Path]) -> str:
    """Hash of the names and contents of all sources in the folders of compiled functions, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for package in sorted(packages):
        sources = {source: source.read_bytes() for source in sorted(package.rglob("*.py"))}
        folders = {source.parent for source, text in sources.items() if b"meshes.jit" in text}
        for source, text in sources.items():
            if source.parent in folders:
                digest.update(f"{source.relative_to(package)} {len(text)}\n".encode())
                digest.update(text)
    return digest.hexdigest()[:16]
