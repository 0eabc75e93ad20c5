# SPDX-License-Identifier: BSD-3-Clause
"""Launches that are repeated, as one graph where the installed packages can make it."""

from __future__ import annotations

from importlib import import_module


def why_no_graphs() -> str:
    """What is missing for graphs; empty where nothing is."""
    for module, name in (("cuda.core.graph", "GraphBuilder"), ("numba.cuda.cudadrv.driver", "_to_core_stream")):
        try:
            getattr(import_module(module), name)
        except (ImportError, AttributeError) as error:
            return f"launches are repeated one by one: {error}"
    return ""
