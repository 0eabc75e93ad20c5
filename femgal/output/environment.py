# SPDX-License-Identifier: BSD-3-Clause
"""On what a run was made: versions and machine, so that its figures can be judged later."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("femgal", "numpy", "scipy", "numba", "h5py", "meshio")


def describe_environment() -> dict[str, str | int | None]:
    """Return versions of Python and of the packages that a run uses, platform, CPU model and number of cores.

    Reads package metadata only: nothing is imported for it.
    """
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in _PACKAGES},
        "platform": platform.platform(),
        "cpu": _cpu_model(),
        "cpu_cores": os.cpu_count(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()
