# SPDX-License-Identifier: BSD-3-Clause
"""Launches that are repeated: as one CUDA graph where the installed packages can make it, else one by one."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from femgal.kernels.cuda.device import simulator_wanted
from femgal.kernels.cuda.stream import Launch

# Why graphs that were tried in this process could not be made; no other is tried then.
_failures: list[str] = []


def why_no_graphs() -> str:
    """Why launches are repeated one by one; empty where a graph is made of them."""
    if simulator_wanted():
        return "the simulator has no graphs"
    for module, name in (("cuda.core.graph", "GraphBuilder"), ("numba.cuda.cudadrv.driver", "_to_core_stream")):
        try:
            getattr(import_module(module), name)
        except (ImportError, AttributeError) as error:
            return str(error)
    return _failures[0] if _failures else ""


class Sequel:
    """Launches in their order, to be made again and again.

    Parameters
    ----------
    launches : What was recorded; the arrays that it works on are kept.
    """

    def __init__(self, launches: Sequence[Launch]) -> None:
        self.launches = tuple(launches)
        self._graph: Any = None
        self._tried = False

    @property
    def is_graph(self) -> bool:
        """Whether all is launched at once."""
        return self._graph is not None

    def run(self, stream: Any) -> None:
        """Launch everything in a stream of Numba's."""
        if not self._tried:
            self._tried = True
            self._graph = None if why_no_graphs() else _captured(self.launches)
        if self._graph is None:
            for launch in self.launches:
                launch.run(stream)
        else:
            self._graph.launch(_core_stream(stream))


def _captured(launches: Sequence[Launch]) -> Any:
    """The launches as a graph; None where that fails, and then why is kept.

    All kernels have been launched before, so nothing is compiled or loaded during the capture.
    """
    from cuda.core import Device  # type: ignore[import-untyped,import-not-found,unused-ignore]

    try:
        builder = Device().create_graph_builder()
        builder.begin_building("thread_local")
        for launch in launches:
            launch.run(builder)
        return builder.end_building().complete()
    except Exception as error:  # of the driver, of Numba or of cuda.core: whatever it is, the plain way works
        _failures.append(f"{type(error).__name__}: {error}")
        return None


def _core_stream(stream: Any) -> Any:
    return import_module("numba.cuda.cudadrv.driver")._to_core_stream(stream)
