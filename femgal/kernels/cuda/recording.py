# SPDX-License-Identifier: BSD-3-Clause
"""A step that was taken once, to be taken again on other states without asking the solver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from femgal.kernels.backend import Passes
from femgal.kernels.cuda import nodes
from femgal.kernels.cuda.graphs import Sequel
from femgal.kernels.cuda.stream import THREADS, Launch, Stream, Upload, blocks_for


class Recording:
    """The launches of a step, from the arrays that it began with to those that it led to.

    Steps mostly follow each other: what the last one led to is then copied to where this one begins, and that is part
    of the graph.

    Parameters
    ----------
    stream : Where all is launched.
    launches, uploads : Of the step; uploads depend on the time at which it begins.
    inputs, outputs : Arrays of the states before and after it, in the same order.
    passes : Element passes that it made.
    """

    def __init__(
        self,
        stream: Stream,
        launches: Sequence[Launch],
        uploads: Sequence[Upload],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        passes: Passes,
    ) -> None:
        self.stream, self.uploads, self.passes = stream, tuple(uploads), passes
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self._first, self._next = Sequel(launches), Sequel([*_copies(outputs, inputs), *launches])

    @property
    def is_graph(self) -> bool:
        """Whether the step is launched as a graph."""
        return self._next.is_graph or self._first.is_graph

    def run(self, arrays: Sequence[Any], time: float) -> None:
        """Take the step from a state with these arrays at a time [s]; `outputs` are those of the state it leads to."""
        for upload in self.uploads:
            upload.run(self.stream, time)
        follows = all(array is output for array, output in zip(arrays, self.outputs, strict=True))
        if not follows:
            for copy in _copies(arrays, self.inputs):
                copy.run(self.stream.handle)
        sequel = self._next if follows else self._first
        sequel.run(self.stream.handle)
        self.stream.launches += 1 if sequel.is_graph else len(sequel.launches)


def _copies(sources: Sequence[Any], targets: Sequence[Any]) -> list[Launch]:
    """Copies of arrays into others, none overwritten before it has been read: what a step leaves may be what it had."""
    waiting = [(a, b) for a, b in zip(sources, targets, strict=True) if a is not b]
    ordered: list[Launch] = []
    while waiting:
        ready = [pair for pair in waiting if not any(source is pair[1] for source, _ in waiting)]
        assert ready, "arrays of a state in a circle"
        ordered += [Launch(nodes.copy_rows, blocks_for(len(a)), THREADS, 0, (a, b)) for a, b in ready]
        waiting = [pair for pair in waiting if not any(pair is done for done in ready)]
    return ordered
