# SPDX-License-Identifier: BSD-3-Clause
"""The machine that a benchmark ran on, as far as its figures depend on it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from femgal.output.environment import describe_environment

_CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
_HUGE_PAGES = Path("/sys/kernel/mm/transparent_hugepage/enabled")


def describe_machine(caches: Path = _CACHES, huge_pages: Path = _HUGE_PAGES) -> dict[str, Any]:
    """Return CPU, versions, usable processors, last-level cache [bytes], huge pages, load and what Numba compiles for.

    Parameters
    ----------
    caches, huge_pages : Where Linux describes them; what is not there is None.
    """
    import llvmlite.binding

    return {
        **describe_environment(),
        "compiled_for": llvmlite.binding.get_host_cpu_name(),
        "processors": len(os.sched_getaffinity(0)),
        "last_level_cache": _last_level_cache(caches),
        "transparent_huge_pages": _chosen(huge_pages),
        "load_before": os.getloadavg()[0],
    }


def _last_level_cache(caches: Path) -> int | None:
    with suppress(OSError, ValueError):
        sizes = [(path / "size").read_text().strip() for path in caches.glob("index*")]
        return max(int(size.removesuffix("K")) * 1024 for size in sizes)
    return None


def _chosen(setting: Path) -> str | None:
    """The word in brackets of a line like "always [madvise] never"."""
    with suppress(OSError, IndexError):
        return setting.read_text().split("[")[1].split("]")[0]
    return None
