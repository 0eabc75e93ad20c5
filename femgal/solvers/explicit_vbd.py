# SPDX-License-Identifier: BSD-3-Clause
"""Vertex block descent on an assembled matrix: coloured block Gauss-Seidel (Lu et al. 2025, Fig. 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.gauss_seidel.colours import colour_vertices
from femgal.gauss_seidel.matrix_sweep import relax
from femgal.kernels.cpu.node_work import SMALLEST_COLOUR
from femgal.kernels.cpu.threads import Workers
from femgal.solvers.linearised import Linearised
from femgal.solvers.vbd import require_relaxation

Floats = NDArray[np.float64]


@dataclass(eq=False)
class ExplicitVBD(Linearised):
    """One iteration visits every free vertex once: d_i += w A_ii^-1 (b - A d)_i.

    Parameters
    ----------
    w : Relaxation, 0 < w < 2.

    Raises
    ------
    InputError
        w is outside its range, or not a single sweep per system.
    """

    w: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_relaxation(self.w)
        disc = self.backend.disc
        self._colouring = colour_vertices(disc)
        self._row = self.backend.vertices.parent[self._colouring.vertex, 0].copy()
        self._workers = Workers(self.backend.threads)

    def sweep(self, d: Floats) -> Floats:
        """What a sweep over all colours adds to d [m], shape [k, 3]; d is overwritten."""
        pattern, change = self.matrix.pattern, np.empty_like(d)
        arguments = (self._row, pattern.ptr, pattern.column, pattern.diagonal, self.matrix.values, self._b, self.w)
        for first, count in self._colouring.ranges:
            self._workers.run(relax, count, first, *arguments, d, change, smallest_share=SMALLEST_COLOUR)
        return change
