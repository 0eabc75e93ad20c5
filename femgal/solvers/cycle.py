# SPDX-License-Identifier: BSD-3-Clause
"""In which order a cycle smooths the layers.

Every layer is connected directly to the finest mesh and works on the current positions, so nothing is restricted or
interpolated between coarse layers: a cycle is a sequence of layers to smooth (Lu et al. 2025, section 5.3.2).

V and W gain more per cycle, but for equal work more steps with coarse-to-fine do as well with exact steps and better
with spectral ones (reports/published/motion-cycles.txt).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Literal

CycleKind = Literal["coarse-to-fine", "V", "F", "W"]

# Sequences are shown in full up to so many entries.
_LONGEST = 24


@dataclass(frozen=True)
class Cycle:
    """A kind of cycle and how often it smooths.

    Parameters
    ----------
    kind : "coarse-to-fine" goes up once, from the coarsest layer to the finest (Lu et al. 2025, Algorithm 4). "V" goes
        down and up once; "W" goes down and up twice from every layer between the finest and the coarsest; "F" does it
        first as F, then as V.
    pre : Smoothings of a layer before the coarser ones are visited; coarse-to-fine has none.
    post : Smoothings of a layer after that. The coarsest layer, where down and up meet, is smoothed max(pre, post)
        times at each visit: once in V(1, 1). With pre = 0, V is coarse-to-fine.
    """

    kind: CycleKind = "coarse-to-fine"
    pre: int = 0
    post: int = 1

    def __post_init__(self) -> None:
        assert self.pre >= 0 <= self.post
        assert self.pre + self.post > 0
        assert self.kind != "coarse-to-fine" or self.pre == 0

    def schedule(self, n_layers: int) -> tuple[int, ...]:
        """Layers in the order of smoothing, 0 the finest; a single one is smoothed max(pre, post) times."""
        kind = "V" if self.kind == "coarse-to-fine" else self.kind
        return self._visit(kind, 0, n_layers - 1)

    def _visit(self, kind: str, layer: int, coarsest: int) -> tuple[int, ...]:
        if layer == coarsest:
            return (layer,) * max(self.pre, self.post)
        inner = self._visit(kind, layer + 1, coarsest)
        # A second visit of the coarsest layer straight after the first would only be more smoothing there.
        if layer + 1 < coarsest and kind != "V":
            inner += inner if kind == "W" else self._visit("V", layer + 1, coarsest)
        return (layer,) * self.pre + inner + (layer,) * self.post

    def __str__(self) -> str:
        counts = f"{self.post}" if self.kind == "coarse-to-fine" else f"{self.pre}, {self.post}"
        return f"{self.kind}({counts})"


def shown(sequence: tuple[int, ...]) -> str:
    """A sequence of layers in words: ``0 1 2 1 0``, repetitions as ``2x3`` (layer 2 three times)."""
    runs = [(layer, len(list(times))) for layer, times in groupby(sequence)]
    words = [f"{layer}x{times}" if times > 2 else " ".join([f"{layer}"] * times) for layer, times in runs]
    if len(words) <= _LONGEST:
        return " ".join(words)
    return f"{' '.join(words[: _LONGEST - 4])} ... {' '.join(words[-3:])} ({len(sequence)} in all)"
